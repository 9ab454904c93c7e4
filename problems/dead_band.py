"""A servo that hunts, with a dead band in its integrator: the cycles end where the band is almost as wide as they are.

    x1' = x2,   J x2' = m - F,   x3' = x1 where |x1| > delta, else 0        m = -(kp x1 + kd x2 + ki x3)

with Switch friction: F = s g(x2) + b x2 while the servo slips with the sign s, g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2),
and any |m| <= Fs while it sticks.  The set point is x1 = 0.  Outside of the band a stuck servo waits until the
integrator has wound up to the static friction; inside, it rests for ever.  Half a hunting cycle, closed by its mirror
image, has four phases: a slip outside of the band, across it, and behind it, and a stick.

The stable cycle and an unstable one merge in a fold: a wider band stops the hunting.  Below delta = 0.0393 the unstable
cycle creeps through the band ever longer, and a disturbance grows by 1e10 and more in half a period.

Source of the servo: Hensen, van de Molengraft and Steinbuch, DCT report 2001.021, TU Eindhoven, Table 1, at the gain
K = 0.04.  The fold is that of the event map P of scipy's DOP853 with events, at tolerances of 1e-12 and less: of the
stick position a at one breakaway, P(a) is that at the next, and cycles are its fixed points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import casadi as ca

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course

GAIN, TIME, MOTOR = 0.04, 1 / (2 * math.pi), 16.0
"""K [V/rad]; the lead and the integral time [s]; torque of the motor [N m/V]."""
PARAMETERS = {
    "delta": 0.005, "kp": 2 * GAIN * MOTOR, "kd": GAIN * MOTOR * TIME, "ki": GAIN * MOTOR / TIME,
    "J": 0.026, "Fs": 0.53, "Fc": 0.44, "vs": 0.02, "b": 0.1,
}  # fmt: skip
"""Table 1 [rad, N m, s]."""

FOLD = 0.0433457242337
"""delta [rad] at which the stable and the unstable cycle merge."""
NARROW = 0.005
"""delta [rad] at which the branch begins, and ends."""


def torque(x: Any, p: Any) -> Any:
    """The torque of the motor [N m]."""
    return -(p.kp * x.x1 + p.kd * x.x2 + p.ki * x.x3)


def slip(x: Any, p: Any) -> dict[str, Any]:
    """The slip outside of the band, with the sign of its mode."""
    friction = p.sign * (p.Fc + (p.Fs - p.Fc) * ca.exp(-((x.x2 / p.vs) ** 2))) + p.b * x.x2
    return {"x1": x.x2, "x2": (torque(x, p) - friction) / p.J, "x3": x.x1}


def slip_inside(x: Any, p: Any) -> dict[str, Any]:
    """The same inside, where the integrator rests."""
    return slip(x, p) | {"x3": 0.0}


def edge(x: Any, p: Any) -> Any:
    """Above zero outside of the band."""
    return x.x1**2 / p.delta**2 - 1


def after_stop(x: Any, p: Any) -> str:
    """The mode behind a stop."""
    m, inside = float(torque(x, p)), edge(x, p) < 0
    if abs(m) <= p.Fs:
        return "rest" if inside else "stick"
    return ("slip+" if m > 0 else "slip-") + (" inside" if inside else "")


def slips(sign: int, inside: bool) -> Mode:
    """A slip in one direction, inside of the band or outside.

    sign: +1 or -1; inside: where.
    """
    name = "slip+" if sign > 0 else "slip-"
    leaves = Event("leaves", edge, +1, to=name) if inside else Event("enters", edge, -1, to=f"{name} inside")
    return Mode(
        f"{name} inside" if inside else name, slip_inside if inside else slip, sign=sign,
        holds=lambda x, p: p.sign * x.x2 / p.vs,
        feature=lambda x, p: ca.exp(-((x.x2 / p.vs) ** 2)),
        ends=(Event("stop", lambda x, p: x.x2 / p.vs, -sign, to=after_stop), leaves),
    )  # fmt: skip


SYSTEM = System(
    "servo with a dead band", ("x1", "x2", "x3"), PARAMETERS,
    (
        slips(+1, False), slips(+1, True), slips(-1, False), slips(-1, True),
        Mode("stick", flow=lambda x, t, p: {"x1": x.x1, "x2": 0.0, "x3": x.x3 + t * x.x1},
             holds=lambda x, p: 1 - (torque(x, p) / p.Fs) ** 2,
             ends=(Event("breakaway+", lambda x, p: torque(x, p) / p.Fs - 1, +1, to="slip+"),
                   Event("breakaway-", lambda x, p: torque(x, p) / p.Fs + 1, -1, to="slip-"))),
        Mode("rest", flow=lambda x, t, p: {"x1": x.x1, "x2": 0.0, "x3": x.x3}),
    ),
)  # fmt: skip


def stable_cycle(tol: float = 1e-9) -> SystemOrbit:
    """The hunting cycle of the narrow band."""
    return find_cycle(SYSTEM, "stick", follow="delta", tol=tol, x1=-0.02, x2=0.0, x3=0.0)


def branches() -> Iterator[Course]:
    """Round the fold and back."""
    yield Course("dead band", stable_cycle, "delta", 1.0, (("fold", FOLD),), ("range",), {"back": NARROW}, within=1e-9)
