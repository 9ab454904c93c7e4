"""What is measured of a cycle, its amplitude, and the error of that beside the error of the period.

a number of a state    the largest magnitude of that state at the ends of the phases
a function g(x; p)     the largest |g| over the whole cycle, inside the phases too (extrema.py)
"""

from __future__ import annotations

import numpy as np

from ..collocation.error_estimate import SMALL_AMPLITUDE, Estimate, amplitude_row, estimate
from ..collocation.transcription import Setting, Transcription
from .extrema import largest_magnitude

Array = np.ndarray


def amplitude_off(t: Transcription, u: Array, setting: Setting, known: float) -> float:
    """By how much the amplitude of a solution differs from a known one, in the units of its error estimate.

    Returns the difference, relative.
    """
    g = t.cycle.measured
    if not callable(g):
        return abs(amplitude_row(t, u)[0] * float(setting.scale[g]) / known - 1)
    found = largest_magnitude(t, u, setting, g)
    return abs(found.value - known) / found.size


def measured(t: Transcription, u: Array, setting: Setting) -> float:
    """The amplitude alone.

    Returns its value, in physical units.
    """
    g = t.cycle.measured
    if callable(g):
        return largest_magnitude(t, u, setting, g).value
    return amplitude_row(t, u)[0] * float(setting.scale[g])


def estimated(
    t: Transcription, u: Array, setting: Setting, *, border: Array | None = None, accepted: float = np.inf
) -> Estimate:
    """The errors of period and amplitude (error_estimate.py), whatever the cycle measures.

    border, accepted: as in `estimate`.
    """
    g = t.cycle.measured
    measured = largest_magnitude(t, u, setting, g) if callable(g) else None
    return estimate(t, u, setting, border=border, accepted=accepted, amplitude=measured)


def row_sums(columns: Array) -> Array:
    """(B,) sums of (B, k) columns, one after the other: the same additions whatever B is."""
    out = columns[:, 0].copy()
    for k in range(1, columns.shape[1]):
        out += columns[:, k]
    return out


def _at_phase_ends(t: Transcription, u: Array, settings: Setting, i: int) -> tuple[Array, Array]:
    """(B,) largest magnitudes of state i over the phase ends, physical, and (B,) the nodes where."""
    values = np.abs(u[:, t.node_index[t.phase_ends, i]])
    best = values.argmax(axis=1)
    return values[np.arange(len(u)), best] * settings.scale[:, i], t.phase_ends[best]


def goals_of_many(t: Transcription, u: Array, settings: Setting) -> tuple[Array, Array, Array]:
    """Period and amplitude of many solutions, and what their errors are functionals of.

    t, u, settings: transcription, (B, size) unknowns, and settings.
    Returns ((B, 2, y) rows of the relative errors of period and amplitude, periods (B,), amplitudes (B,)).
    """
    B, E, n, P, g = len(u), t.elements, t.n, t.phases, t.cycle.measured
    goals = np.zeros((B, 2, t.system.size))
    durations = row_sums(u[:, -P:])
    goals[:, 0, (E + 1) * n : (E + 1) * n + P] = 1 / durations[:, None]
    if callable(g):
        found = [largest_magnitude(t, u[b], settings.of(b), g) for b in range(B)]
        for b, one in enumerate(found):
            goals[b, 1] = one.row / one.size
        return goals, durations * t.cycle.repeats, np.array([one.value for one in found])
    amplitude, node = _at_phase_ends(t, u, settings, g)
    stages = np.abs(u[:, : t.intervals * t.rows].reshape(B, -1, n)[:, :, g]).max(axis=1, initial=0.0)
    scale = settings.scale[:, g]
    goals[np.arange(B), 1, node * n + g] = scale / np.maximum(amplitude, SMALL_AMPLITUDE * stages * scale)
    return goals, durations * t.cycle.repeats, amplitude


def amplitudes_off(t: Transcription, u: Array, settings: Setting, known: Array) -> Array:
    """By how much the amplitudes of many solutions differ from known ones: `amplitude_off` of each.

    t, u, settings: transcription, (B, size) unknowns, and settings; known: (B,) the other amplitudes.
    Returns (B,) the differences, relative.
    """
    g = t.cycle.measured
    if callable(g):
        return np.array([amplitude_off(t, u[b], settings.of(b), float(known[b])) for b in range(len(u))])
    return np.abs(_at_phase_ends(t, u, settings, g)[0] / known - 1)
