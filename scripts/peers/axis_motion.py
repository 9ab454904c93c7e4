"""Motions of an axis with Switch friction, by a C program of its own (axis.c; needs cc): nothing of the program.

    turns   places at which x1 turns back, at stops;   a motion repeats where its last turns do, n by n
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray
NAMES = ("J", "JL", "k", "d", "seen", "kp", "kd", "ki", "Tf", "kind", "w", "z", "depth", "M", "way", "Tu",
         "Fs", "Fs_back", "Fc", "Fc_back", "b", "b_back", "vs", "longest_step", "leak")  # fmt: skip
STATES = 8
TOL, REPEATS, GONE, GROWN = 1e-11, 1e-7, 1e-3, 1e3
"""Error of a step, difference of turns that repeat, in sizes; what is gone, in Fs/kp, and has grown, in starts."""
LEAST, SHRANK, LATE = 8, 0.9, 300
"""Turns at the end of the time: so few, or shrinking so, and it rests; growing so, it grows; so many, and it hunts
irregularly."""
PATTERN, FIRST_LOOK, MOST_STOPS, MOST_PHASES = 200, 64, 900, 100_000
"""Turns of a pattern at most; stops of a first look, each next one being twice as long; stops and phases at most."""


@cache
def compiled() -> Any:
    """axis.c as a library."""
    if shutil.which("cc") is None:
        raise FileNotFoundError("cc is not installed (Debian package gcc)")
    library = Path(tempfile.mkdtemp()) / "axis.so"
    source = Path(__file__).with_name("axis.c")
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"], check=True)
    found = ctypes.CDLL(str(library))
    found.built.restype = ctypes.c_long
    return found


@dataclass
class Fate:
    """What became of a motion: "hunts", "irregular", "rests", "grows" or "unclear"; from its late turns (k,) at times.

    period, amplitude and n, the turns of the pattern, where it hunts; motion: where it can be followed from.
    """

    verdict: str
    turns: Array
    times: Array
    amplitude: float = math.nan
    period: float = math.nan
    n: int = 0


class AxisMotion:
    """One motion of the axis of these numbers, by the names of `NAMES`."""

    def __init__(self, numbers: Mapping[str, float], state: Array, scale: float, tol: float = TOL) -> None:
        self.numbers = (ctypes.c_double * len(NAMES))(*(numbers[name] for name in NAMES))
        self.y, self.size = np.array(state, float), np.abs(state) + 1e-12 * np.abs(state).max()
        self.sign, self.at, self.time = ctypes.c_int(2), ctypes.c_int(0), ctypes.c_double(0.0)
        self.start, self.gone, self.tol = float(np.abs(self.y[[0, 3]]).max()), GONE * scale, tol

    def on(self, stops: int, until: float) -> Array:
        """Time and state (m, 9) of the next stops."""
        out, phases = np.zeros((stops, STATES + 1)), ctypes.c_long(MOST_PHASES)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (self.y, self.size, out)]
        many = compiled().motion(
            self.numbers, pointers[0], ctypes.byref(self.sign), ctypes.byref(self.at), ctypes.byref(self.time),
            ctypes.c_double(until), ctypes.c_double(self.tol), pointers[1], ctypes.c_double(self.gone), stops,
            ctypes.byref(phases), pointers[2],
        )  # fmt: skip
        return out[: max(many, 0)]

    def fate(self, longest: float, most: int = MOST_STOPS) -> Fate:
        """What becomes of it within a time and so many stops."""
        turns = times = np.zeros(0)
        seen, look = 0, FIRST_LOOK
        while seen < most:
            stops = self.on(look, longest)
            seen += len(stops)
            x, t = np.append(turns, stops[:, 1]), np.append(times, stops[:, 0])
            turned = np.append(np.flatnonzero(np.diff(x)[1:] * np.diff(x)[:-1] < 0) + 1, x.size - 1) if x.size else []
            turns, times = x[turned][-4 * PATTERN :], t[turned][-4 * PATTERN :]
            for known, at in ((turns, times), (turns[:-1], times[:-1])):  # at the end it need not have turned
                if n := pattern(known):
                    period = float(at[-1] - at[-1 - n])
                    return Fate("hunts", known, at, float(np.abs(known[-n:]).max()), period, n)
            if len(stops) < look:
                far = np.abs(turns)
                if not self.sign.value and (not times.size or self.time.value > 2 * times[-1]):
                    return Fate("rests", turns, times)  # stuck for longer than all before
                shrank = far.size < LEAST or far[-2:].max() < SHRANK * far[-8:-6].max()
                if far.size >= LEAST and SHRANK * far[-2:].max() > far[-8:-6].max():
                    return Fate("grows", turns, times)
                rests = abs(self.y[0]) <= self.gone or not self.sign.value and shrank
                return Fate("rests" if rests else "irregular" if far.size > LATE else "unclear", turns, times)
            if turns.size and np.abs(turns[-1]) > GROWN * self.start:
                return Fate("grows", turns, times)
            if np.ptp(stops[:, 1]) <= REPEATS * self.gone:  # where it breaks away by rounding alone, it stays
                return Fate("rests", turns, times)
            look *= 2
        return Fate("irregular" if turns.size > LEAST else "unclear", turns, times)


def built(
    numbers: Mapping[str, float], drive: Mapping[str, float], state: Array, noise: Array, far: float, tol: float = TOL
) -> Array:
    """(m, 2) x1 and torque of the axis as a drive runs it, at its samples, as long as it is not farther than `far`.

    drive: sample_time, delay, count and set_point; noise: (m,) what the readings are off by.
    """
    T, late = drive["sample_time"], int(drive["delay"] / drive["sample_time"] + 1e-9)
    part = max(drive["delay"] - late * T, 0.0)
    y, noise, out = np.array(state, float), np.ascontiguousarray(noise, float), np.zeros((noise.size, 2))
    known = (ctypes.c_double * len(NAMES))(*(numbers[name] for name in NAMES))
    many = compiled().built(
        known, *map(ctypes.c_double, (T, drive["count"], drive["set_point"])), ctypes.c_long(late),
        ctypes.c_double(part), y.ctypes.data_as(ctypes.c_void_p), ctypes.c_long(noise.size), ctypes.c_double(tol),
        ctypes.c_double(far), noise.ctypes.data_as(ctypes.c_void_p), out.ctypes.data_as(ctypes.c_void_p),
    )  # fmt: skip
    return out[: max(many, 0)]


def pattern(turns: Array) -> int:
    """After how many turns a motion repeats, three times; 0 for none."""
    for n in range(2, min(PATTERN, turns.size // 4) + 1, 2):
        late = turns[-4 * n :].reshape(4, n)
        if np.ptp(late, axis=0).max() <= REPEATS * np.ptp(late):
            return n
    return 0
