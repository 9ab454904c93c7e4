"""The problems of the gallery for all who race: as casahunt has them, as the peers have them, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from casahunt.continuation import follow
from casahunt.hybrid import System
from casahunt.orbits import Options, SystemOrbit, find_cycle
from problems import (
    belt,
    bouncing_ball,
    canudas,
    circle,
    drill_string,
    dry_friction,
    impact_oscillator,
    relay,
    rossler,
    two_spirals,
    van_der_pol,
)
from problems.gallery import Truth
from scripts.peers import gallery_systems as systems


@dataclass(frozen=True)
class Entry:
    """A cycle of the gallery for all who race.

    Attributes
    ----------
    known : as its user of another program poses it.
    truth : what is known of it.
    system, mode : as casahunt has it.
    vary : the parameter in which a neighbour differs.
    parameters, start : of the search.
    settled : the start lies next to the cycle.
    methods : of solve_ivp, the best first.
    """

    known: systems.Known
    truth: Truth
    system: System
    vary: str
    parameters: Mapping[str, float]
    start: Mapping[str, float]
    mode: str | None = None
    settled: bool = False
    methods: tuple[str, ...] = ("DOP853",)

    def find(self, tol: float, factor: float = 1.0) -> SystemOrbit:
        """The cycle by casahunt, where `vary` is so many times as large."""
        p = {**self.parameters, self.vary: self.parameters[self.vary] * factor}
        return find_cycle(
            self.system, self.mode, tol=tol, parameters=p, follow=self.vary, settled=self.settled, start=self.start
        )

    def follow(self, neighbour: SystemOrbit, tol: float) -> SystemOrbit:
        """The cycle by casahunt from a neighbour."""
        to = self.parameters[self.vary]
        return follow(neighbour, self.vary, to=to, options=Options(tol=tol), monitors=()).orbits[-1]

    def error(self, period: float, largest: float) -> float:
        """The larger relative error."""
        low, high = next(iter(self.truth.extrema.values()))
        return max(abs(period / self.truth.period - 1), abs(largest / max(abs(low), abs(high)) - 1))


def _van_der_pol(mu: float) -> Entry:
    methods = ("LSODA", "Radau") if mu >= 100 else ("DOP853",)
    return Entry(
        systems.van_der_pol(mu), van_der_pol.TRUTH[mu], van_der_pol.SYSTEM, "mu", {"mu": mu}, {"x": 2.0, "v": 0.0},
        methods=methods,
    )  # fmt: skip


def _ball() -> Entry:
    a = 1.46 * bouncing_ball.fold(1) / bouncing_ball.SYSTEM.parameters["w"] ** 2
    truth, state = bouncing_ball.truth(a, 1, +1)
    start = {"x": state["x"] + 1e-6, "v": state["v"], "t": state["t"]}
    return Entry(
        systems.bouncing_ball(a, **start), truth, bouncing_ball.SYSTEM, "a", {"a": a}, start, settled=True
    )


def entries() -> dict[str, Callable[[], Entry]]:
    """All of them, by name."""
    third = relay.relay(*relay.THIRD_ORDER)
    stick = {"x": 1.0, "v": 0.0}
    return {
        "van der Pol, mu = 1": lambda: _van_der_pol(1.0),
        "van der Pol, mu = 10": lambda: _van_der_pol(10.0),
        "van der Pol, mu = 1000": lambda: _van_der_pol(1000.0),
        "circle": lambda: Entry(
            systems.circle(), circle.truth(1.0, 1.0, 0.1), circle.SYSTEM, "omega", circle.SYSTEM.parameters,
            {"x": 0.5, "y": 0.0, "z": 1.0},
        ),
        "Rossler": lambda: Entry(
            systems.rossler(), rossler.TRUTH[2.5, 1], rossler.SYSTEM, "c", {"c": 2.5}, {"x": -2.5, "y": 0.0, "z": 0.0}
        ),
        "two spirals": lambda: Entry(
            systems.two_spirals(), two_spirals.truth(1.0, 2.0, 1.5), two_spirals.SYSTEM, "beta",
            two_spirals.SYSTEM.parameters, {"x": -1.0, "y": 0.0}, "left",
        ),
        "relay": lambda: Entry(
            systems.relay(), relay.truth(*relay.THIRD_ORDER, 0.02, 3.0), third, "eps", {"eps": 0.02},
            dict.fromkeys(third.states, 0.1), "down",
        ),
        "belt": lambda: Entry(
            systems.belt(), belt.TRUTH[0.2], belt.BELT, "belt", belt.BELT.parameters, {"x": 0.0, "v": 0.0}, "slip"
        ),
        "drill string": lambda: Entry(
            systems.drill_string(), drill_string.TRUTH[0.8], drill_string.SYSTEM, "speed", {"speed": 0.8},
            {"phi": 0.0, "w1": 0.8, "w2": 0.0}, "sticks",
        ),
        "dry friction": lambda: Entry(
            systems.dry_friction(), dry_friction.TRUTH[1.5, 0.9, 1.1], dry_friction.SYSTEM, "f0",
            dry_friction.SYSTEM.parameters, stick, "stick",
        ),
        "impact oscillator": lambda: Entry(
            systems.impact_oscillator(), impact_oscillator.TRUTH[1.0, 1.0], impact_oscillator.SYSTEM, "d",
            {"w": 1.0, "d": 1.0}, {"x": 0.0, "v": 0.0},
        ),
        "bouncing ball": _ball,
        "canudas": lambda: Entry(
            systems.canudas(), canudas.TRUTH, canudas.SYSTEM, "ki", {"ki": 4.0},
            {"x": 1.0, "v": 0.0, "w": 0.0, "z": 0.0}, "backwards", methods=("LSODA",),
        ),
    }  # fmt: skip
