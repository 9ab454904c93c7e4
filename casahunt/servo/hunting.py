"""The hunting servo as a hybrid system: modes, events, and its cycles as phase sequences.

Controller (see controller.py):   m = -(kp x1 + kd x2 + ki x3),   J x2' = m - F,   x1' = x2,   x3' = x1.

Switch friction, states (x1, x2, x3), a Filippov system with eta -> 0:
    slip+, slip-   s x2 > 0:  F = s g(x2) + sigma2 x2, until x2 = 0 ("stop")
    stick          x2 = 0, x1 constant, x3' = x1, |m| <= Fs; closed form, until m = s Fs ("breakaway")
    at a stop with |m| > Fs the servo slips on with sign(m) at once: reversal without stick.
  Half cycle: slip+ | stick, closed by S = -I.

LuGre friction, states (x1, x2, x3, x4 = z), the kink |x2| split off as a mode:
    slide+, slide-  s x2 >= 0: |x2| = s x2, until x2 = 0 ("reversal")
    slide           |x2| as it is: once the net torque at a reversal is below `WEAK` Fs, the kink is too
                    weak to deserve a phase boundary, and tiny reversals come and go along a branch
  Half cycle: from x1 = 0 in mid-slip ("centre", always transversal) to the next one: slip, ring-down
  of alternating short slides, then the long stick and the take-off in the last phase.

Events are scaled to order one: velocities by vs, torques by Fs, x1 by Fs/kp.

Report: Hensen, van de Molengraft and Steinbuch, DCT 2001.021, sections 3.1 and 3.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import casadi as ca
import numpy as np

from ..collocation.scheme import Kind
from ..compiled import kept
from ..hybrid.system import Cycle, Event, Exit, Mode, Phase, Signature, System
from .controller import torque_gains_of_gains, torque_gains_of_times
from .friction import bristle_rate, stribeck
from .servo import PARAMETERS, PID_PARAMETERS, STICK_BAND

Model = Literal["switch", "lugre"]
MODELS: tuple[Model, ...] = ("switch", "lugre")
SCHEMES: dict[str, tuple[int, Kind]] = {"switch": (8, "gauss"), "lugre": (7, "radau")}
"""Default collocation degree and kind: Gauss for the smooth slip, Radau IIA for the stiff bristle."""


WEAK = 1e-8
"""A LuGre reversal whose net torque |J x2'| is below this part of Fs gets no phase boundary.

Measured at Table 1, tolerance 1e-9: with boundaries at every reversal above 1e-5 the mesh takes 80 to 110
intervals and 0.06 to 0.1 s and the multipliers are right to 1e-8; above 1e-2, 110 to 130 intervals, 0.5 to
1.1 s and 1e-4, because kinks inside intervals spoil the order."""


class _Symbols(NamedTuple):
    """The paper's letters, from the parameter vector p."""

    J: Any
    kp: Any
    kd: Any
    ki: Any
    Fs: Any
    Fc: Any
    vs: Any
    sigma2: Any
    sigma0: Any
    sigma1: Any


def _places(names: tuple[str, ...]) -> dict[str, int]:
    return {name.rsplit(".", 1)[-1]: i for i, name in enumerate(names)}


_PLACES = {
    len(names): _places(names)
    for own in (PARAMETERS, PID_PARAMETERS)
    for names in (own, own + STICK_BAND)
}
"""By the length of p: two forms of the controller, without and with a stick band."""
_VS = PARAMETERS.index("friction.stribeck_velocity")


def _symbols(p: Any) -> _Symbols:
    at = _PLACES[p.shape[0]]
    factor = p[at["gain"]] * p[at["motor_gain"]]
    if "kp" in at:
        kp, kd, ki = torque_gains_of_gains(factor, p[at["kp"]], p[at["ki"]], p[at["kd"]])
    else:
        kp, kd, ki = torque_gains_of_times(factor, p[at["lead_time"]], p[at["integral_time"]])
    return _Symbols(
        J=p[at["inertia"]],
        kp=kp,
        kd=kd,
        ki=ki,
        Fs=p[at["static"]],
        Fc=p[at["coulomb"]],
        vs=p[at["stribeck_velocity"]],
        sigma2=p[at["viscous"]],
        sigma0=p[at["stiffness"]],
        sigma1=p[at["damping"]],
    )


def motor_torque(x: Any, p: Any) -> Any:
    """The torque of the motor, m = -(kp x1 + kd x2 + ki x3), for CasADi symbols or numbers.

    Parameters
    ----------
    x
        (n,) state x1 [rad], x2 [rad/s], x3 [rad s] (and z, which it does not feel).
    p
        servo.PARAMETERS.

    Returns
    -------
    m [N m].
    """
    q = _symbols(p)
    return -(q.kp * x[0] + q.kd * x[1] + q.ki * x[2])


# Fields, flows and admissibility conditions: module-level functions, so that whoever compiles them can
# keep the compiled form by their identity.


def switch_slip(x: Any, p: Any, sign: Any) -> Any:
    """Slip of the Switch servo with friction direction `sign`.

    Parameters
    ----------
    x
        (3,) state x1 [rad], x2 [rad/s], x3 [rad s].
    p
        servo.PARAMETERS.
    sign
        +1 or -1, that of x2.

    Returns
    -------
    (3,) x'.
    """
    q = _symbols(p)
    F = sign * stribeck(x[1], q.Fs, q.Fc, q.vs) + q.sigma2 * x[1]
    return ca.vertcat(x[1], (motor_torque(x, p) - F) / q.J, x[0])


def switch_stick(x: Any, p: Any, sign: Any) -> Any:
    """Stick of the Switch servo: only the integrator moves.

    Parameters
    ----------
    x
        (3,) state x1 [rad], x2 [rad/s], x3 [rad s].
    p, sign
        not used: a stick has no parameters and no direction.

    Returns
    -------
    (3,) x' = (0, 0, x1).
    """
    return ca.vertcat(0, 0, x[0])


def switch_stick_flow(x: Any, duration: Any, p: Any) -> Any:
    """Closed form of the stick mode.

    Parameters
    ----------
    x
        (3,) state at the start of the stick.
    duration
        its length [s].
    p
        not used.

    Returns
    -------
    (3,) state at its end.
    """
    return ca.vertcat(x[0], x[1], x[2] + duration * x[0])


def lugre_slide(x: Any, p: Any, sign: Any) -> Any:
    """Motion of the LuGre servo.

    Parameters
    ----------
    x
        (4,) state x1 [rad], x2 [rad/s], x3 [rad s], z [rad].
    p
        servo.PARAMETERS.
    sign
        that of x2: |x2| = sign x2; 0 takes |x2| as it is.

    Returns
    -------
    (4,) x'.
    """
    q = _symbols(p)
    speed = ca.if_else(sign == 0, ca.fabs(x[1]), sign * x[1])
    rate = bristle_rate(x[1], speed, x[3], stribeck(x[1], q.Fs, q.Fc, q.vs), q.sigma0)
    F = q.sigma0 * x[3] + q.sigma1 * rate + q.sigma2 * x[1]
    return ca.vertcat(x[1], (motor_torque(x, p) - F) / q.J, x[0], rate)


def _moves_forward(x: Any, p: Any, sign: Any) -> Any:
    return sign * x[1] / p[_VS]


def _slides_forward(x: Any, p: Any, sign: Any) -> Any:
    """s x2 as the reversal strength of a ring-down with that peak speed: x2 sqrt(sigma0 J)/Fs."""
    q = _symbols(p)
    return sign * x[1] * np.sqrt(q.sigma0 * q.J) / q.Fs


def _stribeck_drop(x: Any, p: Any) -> Any:
    """exp(-(x2/vs)^2), (n, m) -> (m,): invisible to an interval whose points all lie beyond a few vs."""
    with np.errstate(over="ignore"):  # far above vs the square may overflow; the exponential is zero all the same
        return np.exp(-((x[1] / p[_VS]) ** 2))


def _torque_below_static(x: Any, p: Any, sign: Any) -> Any:
    return 1 - np.abs(motor_torque(x, p)) / _symbols(p).Fs


def _velocity(x: Any, duration: Any, p: Any) -> Any:
    return x[1] / p[_VS]


def _position(x: Any, duration: Any, p: Any) -> Any:
    q = _symbols(p)
    return x[0] * q.kp / q.Fs


def _torque_up(x: Any, duration: Any, p: Any) -> Any:
    return motor_torque(x, p) / _symbols(p).Fs - 1


def _torque_down(x: Any, duration: Any, p: Any) -> Any:
    return motor_torque(x, p) / _symbols(p).Fs + 1


STOP = Event("stop", _velocity)
REVERSAL = Event("reversal", _velocity)
CENTRE = Event("centre", _position)
BREAKAWAY_UP = Event("breakaway+", _torque_up)
BREAKAWAY_DOWN = Event("breakaway-", _torque_down)


def _after_stop(x: np.ndarray, p: np.ndarray) -> str:
    m, static = float(motor_torque(x, p)), float(_symbols(p).Fs)
    return "stick" if abs(m) <= static else ("slip+" if m > 0 else "slip-")


def slips_back(x: np.ndarray, p: np.ndarray) -> bool:
    """Whether the Switch servo, stopped at x, is reversed at once by more torque than static friction holds.

    Parameters
    ----------
    x
        (3,) state with x2 = 0.
    p
        servo.PARAMETERS.

    Returns
    -------
    False where it sticks.
    """
    return _after_stop(x, p) != "stick"


def reversal_strength(x: Any, p: Any) -> Any:
    """How strongly the LuGre servo is driven through x2 = 0.

    Parameters
    ----------
    x
        (4,) state with x2 = 0.
    p
        servo.PARAMETERS.

    Returns
    -------
    Net torque J x2' / Fs; its sign is that of the motion to come.
    """
    q = _symbols(p)
    return (motor_torque(x, p) - (q.sigma0 * x[3] + q.sigma1 * x[1])) / q.Fs


def _after_reversal(x: np.ndarray, p: np.ndarray) -> str:
    strength = float(reversal_strength(x, p))
    return "slide" if abs(strength) < WEAK else ("slide+" if strength > 0 else "slide-")


def _always(name: str) -> Callable[[np.ndarray, np.ndarray], str]:
    return lambda x, p: name


_SLIP = {
    name: Mode(name, switch_slip, sign, admissible=_moves_forward, feature=_stribeck_drop)
    for name, sign in (("slip+", 1.0), ("slip-", -1.0))
}
_SLIDE = {
    name: Mode(name, lugre_slide, sign, admissible=_slides_forward, slack=10 * WEAK, feature=_stribeck_drop, stiff=True)
    for name, sign in (("slide+", 1.0), ("slide-", -1.0))
} | {"slide": Mode("slide", lugre_slide, 0.0, smooth=False, feature=_stribeck_drop, stiff=True)}

SWITCH = System(
    "switch",
    ("x1", "x2", "x3"),
    _SLIP | {"stick": Mode("stick", switch_stick, flow=switch_stick_flow, admissible=_torque_below_static)},
    {
        "slip+": (Exit(STOP, -1, _after_stop),),
        "slip-": (Exit(STOP, +1, _after_stop),),
        "stick": (
            Exit(BREAKAWAY_UP, +1, _always("slip+")),
            Exit(BREAKAWAY_DOWN, -1, _always("slip-")),
        ),
    },
)

LUGRE = System(
    "lugre",
    ("x1", "x2", "x3", "x4"),
    _SLIDE,
    {
        "slide+": (Exit(REVERSAL, -1, _after_reversal), Exit(CENTRE, +1, _always("slide+"), mark=True)),
        "slide-": (Exit(REVERSAL, +1, _after_reversal), Exit(CENTRE, -1, _always("slide-"), mark=True)),
        "slide": (Exit(CENTRE, +1, _always("slide+"), mark=True), Exit(CENTRE, -1, _always("slide-"), mark=True)),
    },
)

SYSTEMS: Mapping[str, System] = {"switch": SWITCH, "lugre": LUGRE}
_EVENTS = {e.name: e for e in (STOP, REVERSAL, CENTRE, BREAKAWAY_UP, BREAKAWAY_DOWN)}

SWITCH_HALF: Signature = (("slip+", "stop"), ("stick", "breakaway-"))
"""The phase sequence of the usual Switch hunting cycle."""

_MIRROR = str.maketrans("+-", "-+")


def mirrored(signature: Signature) -> Signature:
    """The phase sequence of the motion -x(t)."""
    return tuple((mode.translate(_MIRROR), event.translate(_MIRROR)) for mode, event in signature)


def softened(signature: Signature, k: int) -> Signature | None:
    """The LuGre phase sequence with |x2| as it is in one phase.

    For a phase that holds reversals so weak and so close to touching zero that no phase boundary can be put on them.

    Parameters
    ----------
    signature
        phase sequence.
    k
        index of the phase.

    Returns
    -------
    The sequence; None where there is nothing to soften.
    """
    mode, event = signature[k]
    if mode not in ("slide+", "slide-"):
        return None
    return (*signature[:k], ("slide", event), *signature[k + 1 :])


@kept(maxsize=256)
def hunting_cycle(
    model: Model, signature: Signature, *, half: bool = True, parameters: tuple[str, ...] = PARAMETERS
) -> Cycle:
    """The hunting cycle with a given phase sequence.

    Parameters
    ----------
    model
        "switch" or "lugre".
    signature
        phase sequence of half a period.
    half
        closed by x(T/2) = -x(0); False gives the full cycle, the sequence and its mirror image, closed
        by x(T) = x(0).
    parameters
        servo.PARAMETERS or servo.PID_PARAMETERS.

    Returns
    -------
    Cycle of half a period (`repeats` 2) or of a whole one (1).
    """
    system = SYSTEMS[model]
    n = len(system.states)
    sequence = signature if half else signature + mirrored(signature)
    return Cycle(
        name=f"{model} {'half' if half else 'full'} cycle",
        states=system.states,
        parameters=parameters,
        phases=tuple(Phase(system.modes[mode], _EVENTS[event]) for mode, event in sequence),
        closure=-np.eye(n) if half else np.eye(n),
        repeats=2 if half else 1,
    )
