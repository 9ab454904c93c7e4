"""casahunt equilibria: where the servo can stand still, and what linearising there proves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ...axis_units import label, quantity, several, shown, word
from ...results import tables_of
from ...servo.equilibria import PROVES, Equilibria, equilibria
from ...servo.parts.loop import breakaway_of
from ..answers.answer import Answer, angle, at_gain, called, item, parts_of, record_of, short
from .arguments import Asked, add_command
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    add_command(
        commands, "equilibria", "where the servo can stand still", gain=True, tol=False, model="",
        csv="the limits and conditions", plot="the places of rest, or of the eigenvalues",
    )  # fmt: skip


def run(options: Asked) -> int:
    """Compute and print; returns the exit code."""
    asked = options.subject(gain=True)
    found = equilibria(*asked)
    record = found.to_dict(table=False) | record_of(asked[0])
    give(options, record, equilibria_answer(found), table=tables_of([found]), picture=("equilibria.equilibria", found))
    return 0


# What `casahunt equilibria` says of where the servo can stand still

AT_THE_SET_POINT = 1e-9
"""Of a servo that stands as near to its set point as that [rad], it stands there."""


def equilibria_answer(found: Equilibria) -> Answer:
    """What is said of the equilibria at a gain."""
    low, high = found.ranges.get("x1", (math.nan, math.nan))
    plain = [f"{called(found.loop)} {at_gain(found.gain)}: {_where(low, high)}", *parts_of(found.loop)]
    if math.isfinite(found.integral_limit):
        least, most = found.ranges["x3"]
        integral = f"up to {quantity(most, 'rad s', short)}"  # what is the same to both sides is said once
        if not _alike(-least, most):
            integral = f"from {several((least, most), 'rad s', short, ' to ')}"
        plain.append(item("there", f"with any integral of the error {integral}"))
    elif "torque" in found.ranges:
        between = _between(*found.ranges["torque"], "N m")
        plain.append(item("there", f"with a {word('torque')} of the motor of {between}"))
    if max(abs(low), abs(high)) <= AT_THE_SET_POINT and math.isfinite(max(found.position_limits)):
        alone = "friction alone" + ", beside an integral that carries the load," * _carries_a_load(found)
        below, above = map(angle, found.position_limits)
        away = "away" if _alike(*found.position_limits) else f"below and {above} above"
        held = f"{alone} holds it up to {below} {away}, but the integral grows"
        plain.append(item("stuck beside it", f"{held} until it breaks away"))
    if math.isinf(high - low):
        held = "as far as friction and the controller go: what was wound up before it stood tells where"
        plain.append(item("no limit", f"{held}; casahunt simulate follows a motion"))
    plain += [item("not answered", text) for text in found.not_answered]
    return Answer([*plain, item("does it hunt?", "this does not say: casahunt orbit does")], _details(found))


def _where(low: float, high: float) -> str:
    if math.isnan(low):
        return "no place was found at which it can stand still for ever"
    if max(abs(low), abs(high)) <= AT_THE_SET_POINT:
        return "it can stand still for ever at the set point alone"
    if math.isinf(high - low):
        return "it can stand still for ever anywhere that friction holds it"
    if abs(low + high) <= AT_THE_SET_POINT * high:
        return f"it can stand still for ever up to {angle(high)} from the set point"
    return f"it can stand still for ever from {angle(low)} to {angle(high)} beside the set point"


def _between(low: float, high: float, unit: str = "") -> str:
    if not math.isfinite(high - low):
        return f"no limit {label(unit)}".rstrip()
    return several((low, high), unit, short, " to ").rstrip()


def _carries_a_load(found: Equilibria) -> bool:
    return any(found.loop.at_rest(0.0).values())


def _alike(below: float, above: float) -> bool:
    """Whether two limits differ by no more than rounding."""
    return abs(below - above) <= AT_THE_SET_POINT * abs(above)


def _details(found: Equilibria) -> Iterator[str]:
    yield item("state", "x1 position from the set point, x2 velocity, x3 integral of x1")
    for each in found.rests:
        extent = "; ".join(
            f"{name} {_between(x.min(), x.max(), 'N m' if name == 'torque' else found.loop.unit_of(name))}"
            for name, x in zip(each.names, each.corners.T, strict=True) if name not in ("x2", "load_rate")
        )  # fmt: skip
        yield item("equilibria", f"{each.mode}, {each.corners.shape[0]} corners: {extent}")
    if math.isfinite(max(found.position_limits)):
        below, above = (quantity(limit, "rad", ".10g") for limit in found.position_limits)
        up_to = f"|x1| <= {above}" if _alike(*found.position_limits) else f"-{below} <= x1 <= {above}"
        m, nothing = ("m - load", "nothing but for the load") if _carries_a_load(found) else ("m", "nothing")
        forward, back = breakaway_of(found.loop)
        held = f"|{m}| <= Fs" if forward == back else f"-{back:.10g} <= {m} <= {forward:.10g} N m"
        yield item("stick region", f"x2 = 0, {held}: with {nothing} wound up {up_to}")
        yield item("elsewhere in it", "something goes on until the servo breaks away, after a finite time, or rests")
    linear = "is not linear" if found.linear_stable is None else "is stable" if found.linear_stable else "is unstable"
    yield item("linear loop", f"without dry friction it {linear}")
    if found.model == "switch":
        yield item("linearising", "has no answer: while it sticks no eigenvalue tells of friction, which is exact")
        return
    yield item("bristle", f"z = F/sigma0, |z| <= Fs/sigma0 = {quantity(found.bristle_limit, 'rad', '.10g')}")
    zeros = max((each.directions for each in found.rests), default=0)
    yield item(
        "linearising",
        f"friction has a kink at x2 = 0: the generalised Jacobian has {zeros} eigenvalue{'s' * (zeros > 1)} 0; of the "
        f"others, over {found.c.size} of its members, the largest real part is {found.largest_real_part:.8g} 1/s",
    )
    for name, text, sides, unit, says in (
        ("sharp", "kd + sigma2 > J ki/kp", found.sharp, "N m s/rad", "necessary and sufficient"),
        ("simple", "sigma2/J > ki/kp", found.simple, "1/s", "sufficient, and for all K > 0"),
    ):
        if math.isnan(sides[0]):
            continue
        than, holds = (">", "it holds") if sides[0] > sides[1] else ("<=", "it does not hold")
        said = [shown().number(side, unit) for side in sides]
        yield item(
            f"{name} condition",
            f"{text}, {says} for all members to be stable but for the zero: {said[0]:.8g} {than} {said[1]:.8g} "
            f"{label(unit)}, {holds}",
        )
    if found.threshold:
        least = f"1 - (2 alpha - 1) sigma0 z/Fs < {found.threshold:.4g}, at the ends of the bristle's range"
        yield item("unstable members", least)
    for sentence in PROVES.split(". "):
        about, _, text = sentence.rstrip(".").partition(": ")
        yield item("not proved" if "not" in about else "proved", text)
