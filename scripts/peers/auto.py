"""AUTO-07p as a peer: compile the model once, run it in a folder, read the branch back.

Needs Debian's packages auto-07p and gfortran.  AUTO starts from an orbit of casahunt at the first gain, and
is timed from the start of its own process to its end.  OMP_NUM_THREADS = 1.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casahunt import Orbit

LIBRARY = Path("/usr/lib/auto-07p/lib")
HERE = Path(__file__).parent
TYPES = {5: "LP", 1: "BP", 6: "BP", 7: "PD", 8: "TR", 9: "EP", -9: "MX", -4: "UZ"}
"""AUTO's types of points."""


class Missing(Exception):
    """AUTO-07p or a Fortran compiler is not installed; the message says which."""


@dataclass(frozen=True, eq=False)
class AutoBranch:
    """What AUTO computed.

    Attributes
    ----------
    gains, amplitudes, periods : (m,) along the branch.
    kinds : (m,) AUTO's label of each point, "" for regular ones.
    seconds : wall time of the process.
    ended : how the run ended, in words.
    """

    gains: np.ndarray
    amplitudes: np.ndarray
    periods: np.ndarray
    kinds: tuple[str, ...]
    seconds: float
    ended: str

    @property
    def fold(self) -> int | None:
        """Index of the limit point, or None."""
        return next((i for i, kind in enumerate(self.kinds) if kind == "LP"), None)


COMMON = """\
dat='start'
IRS=0, ILP=1, NTST={intervals}, NCOL={points}, ISP=1, ISW=1, IPLT=0, NINT=0
NPR=0, MXBF=0, IID=2, ITMX=9, ITNW=7, NWTN=3, IADS=1
RL0={low}, RL1=1e3, A0=-1e9, A1=1e9, THU={{}}, UZR={{}}, UZSTOP={{}}
"""
CONSTANTS = {
    "switch": COMMON
    + """\
NDIM=3, IPS=4, ICP=[1, 2, 12, 13], NBC=4, JAC=0, IAD=3, NMX=3000
EPSL=1e-9, EPSU=1e-9, EPSS=1e-7, DS=0.01, DSMIN=1e-6, DSMAX=0.1, THL={{}}
""",
    "lugre": COMMON
    + """\
NDIM=4, IPS=2, ICP=[1, 11, 14], NBC=0, JAC=1, IAD=1, NMX=6000
EPSL=1e-7, EPSU=1e-7, EPSS=1e-5, DS=0.01, DSMIN=1e-7, DSMAX=0.05, THL={{11: 0.0}}
""",
}
"""AUTO's settings; the LuGre period is left out of the arclength, as casahunt leaves it out."""
COLUMNS = {"switch": (-2, -1), "lugre": (-1, -2)}
"""Where amplitude and period stand in AUTO's output."""


def compiled(model: str, folder: Path) -> Path:
    """The executable of a model: switch, lugre, or another equations file of this folder."""
    if not any(LIBRARY.glob("*.o")):
        raise Missing("AUTO-07p is not installed (Debian package auto-07p)")
    if shutil.which("gfortran") is None:
        raise Missing("gfortran is not installed (Debian package gfortran)")
    exe = folder / f"{model}.exe"
    command = ["gfortran", "-O3", "-fopenmp", str(HERE / f"{model}.f90"), *map(str, sorted(LIBRARY.glob("*.o")))]
    subprocess.run([*command, "-o", str(exe)], check=True, capture_output=True, cwd=folder)
    return exe


def run(exe: Path, orbit: Orbit, *, intervals: int, points: int, low: float, time_limit: float = 900.0) -> AutoBranch:
    """Follow the branch from `orbit` upwards, round the fold and back down to the gain `low`.

    Parameters
    ----------
    exe
        from `compiled`.
    orbit
        where to start.
    intervals, points
        NTST and NCOL.
    low
        gain at which the run ends.
    time_limit
        [s].
    """
    folder = exe.parent
    (folder / "fort.7").unlink(missing_ok=True)
    s, c, f = orbit.servo, orbit.servo.controller, orbit.servo.friction
    plant = [s.inertia, s.motor_gain, c.lead_time, c.integral_time, f.static, f.coulomb, f.stribeck_velocity, f.viscous]
    times, states = orbit.sample(12)
    if orbit.model == "switch":
        inside = times <= orbit.arcs[0].duration * (1 + 1e-12)
        times, states = times[inside], states[:, inside]
        parameters = [orbit.gain, orbit.arcs[0].duration, *plant]
    else:
        states = states * np.array([1.0, 1.0, 1.0, f.stiffness])[:, None]
        parameters = [orbit.gain, 0.0, *plant, orbit.period, f.stiffness, f.damping]
    rows = np.column_stack([times / times[-1], states.T])
    (folder / "parameters.txt").write_text(" ".join(repr(float(x)) for x in parameters) + "\n")
    (folder / "start.dat").write_text("\n".join(" ".join(f"{x:.17e}" for x in row) for row in rows) + "\n")
    text = CONSTANTS[orbit.model].format(intervals=intervals, points=points, low=repr(low * (1 - 1e-9)))
    (folder / "fort.2").write_text(text)
    command = [str(exe)]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    began = time.perf_counter()
    try:
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=time_limit)
        ended = "" if done.returncode == 0 else f"exit code {done.returncode}"
    except subprocess.TimeoutExpired:
        ended = f"stopped after {time_limit:g} s"
    seconds = time.perf_counter() - began
    return _read(folder / "fort.7", COLUMNS[orbit.model], seconds, ended, low)


def _read(path: Path, columns: tuple[int, int], seconds: float, ended: str, low: float) -> AutoBranch:
    """The branch in AUTO's file fort.7: columns branch, point, type, label, then what ICP asks for."""
    rows, kinds = [], []
    for line in path.read_text().splitlines() if path.exists() else []:
        words = line.split()
        if words and int(words[0]) != 0:
            kinds.append(TYPES.get(int(words[2]), ""))
            rows.append([float(re.sub(r"(\d)([+-]\d)", r"\1E\2", word)) for word in words[4:]])
    if not rows:
        return AutoBranch(np.zeros(0), np.zeros(0), np.zeros(0), (), seconds, ended or "no point was computed")
    table = np.array(rows)
    gains = table[:, 0]
    if not ended:
        complete = gains[-1] <= low and gains.max() > 2 * low
        ended = "complete" if complete else f"stopped at K = {gains[-1]:.4g}"
    return AutoBranch(gains, table[:, columns[0]], table[:, columns[1]], tuple(kinds), seconds, ended)
