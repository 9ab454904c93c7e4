"""The hunting servo (hunting.py) in the terms of the engine: its vectors, its schemes, its cycles as phase sequences.

    x = (x1, x2, x3 [, x4]),    p = servo.PARAMETERS or PID_PARAMETERS [, STICK_BAND], whose length tells which

A cycle is half a period, closed by S = -I, or the whole of it: both mirrored halves, closed by S = I.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..collocation.scheme import Kind
from ..compiled import kept
from ..hybrid import System
from ..hybrid import system as engine
from ..hybrid.system import Cycle, Phase, Signature
from ..hybrid.vector_form import Always, Names
from . import hunting
from .controller import Controller
from .hunting import Model, hunting_system
from .servo import PARAMETERS, STICK_BAND, Servo
from .stick_band import band_system

SCHEMES: dict[str, tuple[int, Kind]] = {"switch": (8, "gauss"), "lugre": (7, "radau")}
"""Default collocation degree and kind: Gauss for the smooth slip, Radau IIA for the stiff bristle."""

SWITCH_HALF: Signature = (("slip+", "stop"), ("stick", "breakaway-"))
"""The phase sequence of the usual Switch hunting cycle."""

_FORMS = {len(form.names): form for form in (Servo(), Servo(controller=Controller().pid()))}
"""By the length of p, a servo with such a controller: no function depends on its numbers."""
_MIRROR = str.maketrans("+-", "-+")


@kept(maxsize=8)
def system_of(model: Model, parameters: int) -> System:
    """The servo as a system, its numbers those of any servo; parameters: the length of p, which tells its form."""
    if parameters in _FORMS:
        return hunting_system(_FORMS[parameters], model, 1.0)
    return band_system(_FORMS[parameters - len(STICK_BAND)], 1.0)


def names_of(model: Model, parameters: int) -> Names:
    """The entries of x and p by name."""
    return system_of(model, parameters).names


def automaton(model: Model, parameters: int) -> engine.System:
    """The servo for the engine.

    Returns its modes and exits; those of stick_band.py where p tells of a stick band.
    """
    return system_of(model, parameters).vector_form


def motor_torque(x: Any, p: Any) -> Any:
    """The torque of the motor.

    x: (n,) or (n, m) states of either model. Returns m [N m], one number or (m,).
    """
    names = names_of("switch", p.shape[0])
    return hunting.motor_torque(names.x(x, p), names.p(p))


def slips_back(x: np.ndarray, p: np.ndarray) -> bool:
    """Whether the Switch servo, stopped at x, is reversed at once by more torque than static friction holds.

    x: (3,) state with x2 = 0. Returns False where it sticks.
    """
    return automaton("switch", p.size).ways_out("slip+", "stop")[0].successor(x, p) != "stick"


def mirrored(signature: Signature) -> Signature:
    """The phase sequence of the motion -x(t)."""
    return tuple((mode.translate(_MIRROR), event.translate(_MIRROR)) for mode, event in signature)


def softened(signature: Signature, k: int) -> Signature | None:
    """The LuGre phase sequence with |x2| as it is in one phase.

    For a phase that holds reversals so weak and so close to touching zero that no phase boundary can be put on them.

    Returns the sequence; None where there is nothing to soften.
    """
    mode, event = signature[k]
    if mode not in ("slide+", "slide-"):
        return None
    return (*signature[:k], ("slide", event), *signature[k + 1 :])


def hunting_cycle(
    model: Model, signature: Signature, *, half: bool = True, parameters: tuple[str, ...] = PARAMETERS
) -> Cycle:
    """The symmetric hunting cycle with a given phase sequence.

    half: closed by x(T/2) = -x(0); False gives the full cycle, the sequence and its mirror image, closed by x(T) =
    x(0). Returns cycle of half a period (`repeats` 2) or of a whole one (1).
    """
    return closed_cycle(model, signature if half else signature + mirrored(signature), 2 if half else 1, parameters)


@kept(maxsize=256)
def closed_cycle(model: Model, signature: Signature, repeats: int, parameters: tuple[str, ...]) -> Cycle:
    """The hunting cycle with these phases, of half a period (repeats 2) or of a whole one (1), lopsided or not.

    Raises ValueError: a phase that the model does not have, or that the one before it cannot lead to.
    """
    form = automaton(model, len(parameters))
    n = len(form.states)
    # By its name alone: a softened slide ends with a reversal too, which is no exit of its mode.
    events = {way_out.event.name: way_out.event for mode in form.modes for way_out in form.exits[mode]}
    if any(mode not in form.modes or event not in events for mode, event in signature):
        raise ValueError(f"the {model} servo has no cycle with the phases {signature}")
    for (mode, event), (following, _) in zip(signature, signature[1:] + signature[:1], strict=True):
        if repeats == 2:
            break  # a motion that is no cycle may be closed by its mirror image: what comes of it is judged
        leads = [w.successor for w in form.ways_out(mode, event) if isinstance(w.successor, Always)]
        if any(one.name != following and "slide" not in (one.name, following) for one in leads):
            raise ValueError(f"{signature} are not the phases of a cycle of the {model} servo")
    return Cycle(
        name=f"{model} {'half' if repeats == 2 else 'full'} cycle",
        states=form.states,
        parameters=parameters,
        phases=tuple(Phase(form.modes[mode], events[event]) for mode, event in signature),
        closure=-np.eye(n) if repeats == 2 else np.eye(n),
        repeats=repeats,
    )
