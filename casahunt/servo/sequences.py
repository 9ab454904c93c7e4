"""The next phase sequence of a hunting cycle, where the one at hand has stopped being a motion.

Along a branch phases are born and die: a Switch slip ends with more torque than friction holds and slips
back without sticking; a LuGre ring-down gains or loses a pair of reversals.  Given a root of the
equations of the wrong sequence, or the moment where a phase has shrunk to nothing, these functions build
a starting point for the right one (orbits/restart.py).  All return None where they have nothing to offer.

    remarch           follow the real motion for half a cycle and take the phases that it has
    split_reversals   put phase boundaries where x2 changes sign inside a LuGre phase
    merge_vanishing   take out a phase that has shrunk to nothing: a LuGre slide with two reversals, a Switch stick
    harden            the opposite of soften, once the grazing is past
    soften            leave the kink |x2| unsplit in one LuGre phase, for reversals that graze zero
"""

from __future__ import annotations

import numpy as np

from ..collocation.mesh import evaluate_phase
from ..collocation.scheme import Kind
from ..collocation.transcription import Setting, Transcription
from ..hybrid.system import Cycle, Signature
from ..motion import MarchFailure, Segment, march
from ..orbits.restart import Start, assembled, breaks_of, cut, from_segments, merged, piece, relabelled
from .cycles import automaton, closed_cycle, hunting_cycle, mirrored, softened
from .hunting import Model
from .servo import PARAMETERS, PID_PARAMETERS

Array = np.ndarray

SHORT_STICK = 0.1  # duration of a stick, in units of the slips', below which it may be about to vanish
SIGN_POINTS = 65  # points per interval at which x2 is searched for changes of sign


def next_sequence(
    model: Model, t: Transcription, u: Array, setting: Setting, phase: int, *, soft: bool
) -> list[Start]:
    """Starting points for other phase sequences where one has stopped being a motion.

    phase: index of the phase where the sequence fails; soft: also phases with the kink unsplit, the last resort: they
    converge everywhere, but slowly. Returns starting points, most promising first.
    """
    if model == "switch":
        start = remarch(model, t, u, setting)
        found = [start if start is None or start[0].cycle.signature != t.cycle.signature else None]
    else:
        found = [
            split_reversals(model, t, u, setting, phase),
            merge_vanishing(model, t, u, setting),
            soften(model, t, u, setting, phase) if soft else None,
        ]
    return [start for start in found if start is not None]


def from_half_cycle(
    model: Model, segments: list[Segment], p: Array, dp: Array, *, degree: int, kind: Kind, half: bool
) -> Start:
    """Starting point from a marched half cycle (with its mirror image for a full one).

    A march that starts with negative velocity is mirrored first, so that every cycle starts its phase
    sequence with the positive slip.

    p, dp: parameter vector, and the direction in which a free parameter moves; half: a half cycle; False for a full
    one, with the mirror image of the march.
    """
    signature = tuple((s.mode, s.event) for s in segments)
    sign = 1.0
    if signature[0][0].endswith("-"):
        signature, sign = mirrored(signature), -1.0
    factors = (sign,) if half else (sign, -sign)
    passes = [(factor, segment) for factor in factors for segment in segments]
    names = PID_PARAMETERS if p.size == len(PID_PARAMETERS) else PARAMETERS
    cycle = hunting_cycle(model, signature, half=half, parameters=names)
    return from_segments(cycle, passes, p, dp, degree=degree, kind=kind)


def remarch(model: Model, t: Transcription, u: Array, setting: Setting) -> Start | None:
    """The phases that the motion from the start of u really has in half a cycle.

    Returns starting point; None where the march fails or comes to rest.
    """
    x = t.nodes_of(u)[0] * setting.scale
    try:
        segments = march(
            automaton(model, setting.p.size), t.cycle.phases[0].mode.name, x, setting.p, scale=setting.scale,
            until=lambda s: s.mode == "stick" if model == "switch" else s.event == "centre",
            tol=1e-5, degree=t.degree, kind=t.kind,
        )  # fmt: skip
    except MarchFailure:
        return None
    if segments[-1].event == "":
        return None
    return from_half_cycle(model, segments, setting.p, setting.dp, degree=t.degree, kind=t.kind, half=True)


def split_reversals(
    model: Model, t: Transcription, u: Array, setting: Setting, phase: int
) -> Start | None:
    """Phase boundaries where x2 changes sign inside a slide; the polynomials stay what they are.

    Returns starting point; None where the phase is no slide, or x2 does not change sign an even number of times in it.
    """
    signature, k = t.cycle.signature, phase
    mode, event = signature[k]
    if mode not in ("slide+", "slide-"):
        return None
    cuts = _sign_changes(t, u, setting, phase)
    if cuts.size == 0 or cuts.size % 2:
        return None
    other = "slide-" if mode == "slide+" else "slide+"
    modes = [mode if i % 2 == 0 else other for i in range(cuts.size + 1)]
    pieces = tuple((m, "reversal") for m in modes[:-1]) + ((modes[-1], event),)
    cycle = _like(model, t, signature[:k] + pieces + signature[k + 1 :])
    return cut(cycle, t, u, setting, {k: cuts})


def _like(model: Model, t: Transcription, signature: Signature) -> Cycle:
    """The cycle with other phases, closed as that of `t` is."""
    return closed_cycle(model, signature, t.cycle.repeats, t.cycle.parameters)


def _sign_changes(t: Transcription, u: Array, setting: Setting, phase: int) -> Array:
    """Fractions of the phase at which x2 changes sign strictly inside it."""
    breaks = breaks_of(t, setting, phase)
    times = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0, 1, SIGN_POINTS)).ravel()
    x2 = evaluate_phase(t, u, setting.fractions, phase, times)[:, 1]
    sign = -1.0 if t.cycle.phases[phase].mode.name == "slide-" else 1.0
    backwards = sign * x2 < 0
    # The ends of the phase are zeros of x2 themselves, up to rounding.
    top = float(np.max(np.abs(x2)))
    backwards &= np.abs(x2) > 1e-14 * top
    edges = np.flatnonzero(np.diff(backwards.astype(int)))
    cuts = []
    for i in edges:
        a, b = times[i], times[i + 1]
        fa, fb = x2[i], x2[i + 1]
        cuts.append(a - fa * (b - a) / (fb - fa) if fb != fa else (a + b) / 2)
    return np.array([c for c in cuts if 0 < c < 1])


def merge_vanishing(model: Model, t: Transcription, u: Array, setting: Setting) -> Start | None:
    """Take out the shortest inner slide with its two reversals: three phases become one; or a Switch stick.

    Returns starting point; None where no phase is short enough to be taken out.
    """
    if model == "switch":
        return _without_stick(t, u, setting)
    phases = t.cycle.signature
    durations = t.durations_of(u)
    candidates = [
        k for k in range(1, len(phases) - 1)
        if phases[k][0] in ("slide+", "slide-") and phases[k - 1][0] == phases[k + 1][0]
        and phases[k - 1][1] == phases[k][1] == "reversal"
    ]  # fmt: skip
    if not candidates:
        return None
    k = min(candidates, key=lambda j: durations[j])
    if durations[k] > 0.5 * float(np.median(durations)):
        return None
    cycle = _like(model, t, phases[: k - 1] + (phases[k + 1],) + phases[k + 2 :])
    return merged(cycle, t, u, setting, [k])


def _without_stick(t: Transcription, u: Array, setting: Setting) -> Start | None:
    """A Switch half cycle whose stick has shrunk to nothing: the servo stops and is reversed at once."""
    half = t.cycle.signature
    durations = t.durations_of(u)
    if t.cycle.repeats != 2 or half[-1][0] != "stick" or durations[-1] > SHORT_STICK * np.sum(durations[:-1]):
        return None
    slips = [piece(t, u, setting, k) for k in range(t.phases - 1)]
    return assembled(_like("switch", t, half[:-1]), t, setting, slips, t.nodes_of(u)[-2])


def soften(model: Model, t: Transcription, u: Array, setting: Setting, phase: int) -> Start | None:
    """The same unknowns for the sequence with the kink left unsplit in `phase` (cycles.softened).

    Returns starting point; None where the phase is no slide.
    """
    softer = softened(t.cycle.signature, phase)
    return None if softer is None else relabelled(_like(model, t, softer), t, u, setting)


def harden(model: Model, t: Transcription, u: Array, setting: Setting) -> Start | None:
    """The same unknowns with every unsplit phase given the sign that x2 mostly has in it.

    Returns starting point; None where no phase is unsplit.
    """
    phases = t.cycle.signature
    if all(mode != "slide" for mode, _ in phases):
        return None
    signature = []
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    for k, (mode, event) in enumerate(phases):
        forward = float(np.sum(w[t.phase_intervals(k), :, 1])) > 0
        signature.append((mode if mode != "slide" else ("slide+" if forward else "slide-"), event))
    return relabelled(_like(model, t, tuple(signature)), t, u, setting)
