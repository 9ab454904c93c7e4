"""Shooting on the gallery with Taylor series (heyoka, extra `bench`) instead of solve_ivp, in double precision.

Every piece is an integrator that heyoka compiles once, for all parameters; its events are roots of Taylor polynomials.
"""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import heyoka as hy
import numpy as np

from .gallery_shooting import LONG, MOST_PIECES, Cycle, Failed, settled, shoot
from .gallery_systems import Known

Array = np.ndarray
WAY = {1: hy.event_direction.positive, -1: hy.event_direction.negative}
TURNS: list[float] = []
"""Values of the first state where it may be extreme; here because heyoka copies what a callback is bound to."""


def _turn(integrator: Any, when: float, sign: int) -> None:
    integrator.update_d_output(when)
    TURNS.append(float(integrator.d_output[0]))


class Taylor:
    """Motions by heyoka; see gallery_shooting.Engine.

    Parameters
    ----------
    known
        the system.
    tol
        of the integrators.

    Attributes
    ----------
    compiling : seconds that building them took.
    """

    def __init__(self, known: Known, tol: float) -> None:
        began = time.perf_counter()
        self.known, self.tol = known, tol
        names = [f"y{i}" for i in range(len(known.start[2]))]
        y = hy.make_vars(*names)
        p = SimpleNamespace(**{name: hy.par[i] for i, name in enumerate(vars(known.p))})
        functions = SimpleNamespace(sin=hy.sin, cos=hy.cos, exp=hy.exp, sqrt=hy.sqrt)
        self._seeing: dict[str, Any] = {}
        self._watching: dict[str, Any] = {}
        self._blind: dict[str, Any] = {}
        for name, piece in known.pieces.items():
            rates = [hy.expression(0.0) + r for r in piece.field(hy.time, y, p, functions)]
            equations = list(zip(y, rates, strict=True))
            ends = [
                hy.t_event(way.function(hy.time, y, p, functions), direction=WAY[way.direction]) for way in piece.ways
            ]

            def built(equations: Any = equations, **events: Any) -> Any:
                return hy.taylor_adaptive(equations, [0.0] * len(y), tol=tol, **events)

            self._seeing[name] = built(t_events=ends)
            if piece.blind:
                self._blind[name] = built()
            if hy.get_variables(rates[0]):
                self._watching[name] = built(nt_events=[hy.nt_event(rates[0], callback=_turn)])
        self.compiling = time.perf_counter() - began

    def at(self, known: Known) -> Taylor:
        """The same integrators at other parameters."""
        self.known = known
        return self

    def _begun(self, integrator: Any, t: float, y: Array) -> Any:
        integrator.time, integrator.state[:] = t, y
        integrator.pars[:] = list(vars(self.known.p).values())[: len(integrator.pars)]
        return integrator

    def run(self, piece: str, t: float, y: Any, watch: bool = False) -> tuple[float, Array, float]:
        """See gallery_shooting.Engine."""
        left, y = self.known.times, np.array(y, float)
        TURNS.clear()
        for _ in range(MOST_PIECES):
            here = self.known.pieces[piece]
            if here.blind:
                blind = self._begun(self._blind[piece], t, y)
                blind.propagate_until(t + here.blind)
                t, y = blind.time, blind.state.copy()
            seeing = self._begun(self._seeing[piece], t, y)
            seeing.reset_cooldowns()
            outcome = seeing.propagate_until(t + LONG)[0]
            if watch and piece in self._watching:
                self._begun(self._watching[piece], t, y).propagate_until(seeing.time)
            TURNS.append(float(y[0]))
            t, y = seeing.time, seeing.state.copy()
            TURNS.append(float(y[0]))
            index = -int(outcome) - 1
            if not 0 <= index < len(here.ways):
                raise Failed(f"the motion does not leave {piece}: {outcome}")
            way = here.ways[index]
            left -= way.name == self.known.until
            if left == 0:
                return t, y, max(map(abs, TURNS))
            y = y if way.behind is None else np.array(way.behind(t, y.tolist(), self.known.p))
            piece = self.known.next_piece(way.to, t, y)
        raise Failed(f"the section is not met in {MOST_PIECES} pieces")


def solve(engine: Taylor, known: Known, guess: Array | None = None) -> Cycle:
    """The cycle by Taylor series: from a near-by one's unknowns, or from the start.

    Parameters
    ----------
    engine
        what was compiled for the system.
    known
        the system.
    guess
        (k,) unknowns; None follows the motion from the start.

    Returns
    -------
    Cycle.

    Raises
    ------
    gallery_shooting.Failed : there is none.
    """
    engine.at(known)
    return shoot(engine, settled(engine) if guess is None else guess, max(10 * engine.tol, 1e-14))
