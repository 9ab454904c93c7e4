"""AUTO-07p on the smooth problems of the gallery: from the cycle of a neighbour to the parameter, and no further.

The largest value of the first state is that of AUTO's own polynomials (fort.8), read outside the time.
"""

from __future__ import annotations

import os
import resource
import subprocess
from pathlib import Path

import numpy as np

from .auto import Missing, compiled
from .gallery_shooting import Cycle, Failed

Array = np.ndarray
SMOOTH = {"van der Pol": "van_der_pol", "Rossler": "rossler"}
"""The equations file of a title's beginning."""
CONSTANTS = """\
dat='start'
NDIM={states}, IPS=2, ICP=[1, 11], NBC=0, JAC=1, IAD=1, NMX=200
IRS=0, ILP=0, NTST={intervals}, NCOL={points}, ISP=0, ISW=1, IPLT=0, NINT=0
NPR=0, MXBF=0, IID=2, ITMX=9, ITNW=7, NWTN=3, IADS=1
EPSL={small}, EPSU={small}, EPSS={small}, DS={step}, DSMIN={least}, DSMAX={most}
RL0={low}, RL1={high}, A0=-1e9, A1=1e9, THL={{11: 0.0}}, THU={weights}, UZR={{}}, UZSTOP={{1: {target}}}
"""
BESIDES = 1e-3
"""The range of the parameter ends this far behind the target, relative to it."""


def ready(title: str, folder: Path) -> Path:
    """The executable for a problem of the gallery.

    Parameters
    ----------
    title
        of the problem.
    folder
        where it is compiled.

    Returns
    -------
    Its path.

    Raises
    ------
    Missing : AUTO-07p or a compiler is not installed, or there are no equations for the problem.
    """
    for name, file in SMOOTH.items():
        if title.startswith(name):
            return compiled(file, folder)
    raise Missing(f"{title}: no equations file for AUTO-07p")


def run(
    exe: Path, orbit: Array, times: Array, values: tuple[float, float], *, intervals: int, points: int, stiff: bool
) -> tuple[float, Cycle]:
    """Follow the cycle of a neighbour to the parameter.

    Parameters
    ----------
    exe
        from `ready`.
    orbit, times
        (n, m) states of the neighbour over one period, (m,) times from 0.
    values
        of the parameter: the neighbour's, the target.
    intervals, points
        NTST and NCOL.
    stiff
        a looser corrector, the second state out of the arclength: without that it goes nowhere at mu = 1000.

    Returns
    -------
    Processor time of the process, and the cycle.

    Raises
    ------
    Failed : AUTO does not get there.
    """
    folder, (here, target) = exe.parent, values
    for name in ("fort.7", "fort.8"):
        (folder / name).unlink(missing_ok=True)
    rows = np.column_stack([times / times[-1], orbit.T])
    (folder / "parameters.txt").write_text(f"{here!r} {float(times[-1])!r}\n")
    (folder / "start.dat").write_text("\n".join(" ".join(f"{x:.17e}" for x in row) for row in rows) + "\n")
    step = target - here
    low, high = sorted((here - step, target + step * BESIDES))
    text = CONSTANTS.format(
        states=len(orbit), intervals=intervals, points=points, small=1e-7 if stiff else 1e-10,
        step=step, least=abs(step) * 1e-4, most=abs(step) * 2, low=low, high=high, target=repr(target),
        weights="{2: 0.0}" if stiff else "{}",
    )  # fmt: skip
    (folder / "fort.2").write_text(text)
    began = _of_children()
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run([str(exe)], cwd=folder, env=environment, capture_output=True, text=True, timeout=60.0)
    except subprocess.TimeoutExpired:
        raise Failed("AUTO does not end in a minute") from None
    seconds = _of_children() - began
    found = _last(folder / "fort.8")
    if done.returncode or found is None or abs(found[0] / target - 1) > 1e-6:
        at = "nowhere" if found is None else f"at {found[0]:.6g}"
        raise Failed(f"AUTO stopped {at}, not at {target:g}")
    return seconds, Cycle(np.zeros(0), found[1], found[2])


def _of_children() -> float:
    """Processor time [s] of the processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _last(path: Path) -> tuple[float, float, float] | None:
    """(parameter, period, largest size of the first state) of the last solution in a file fort.8."""
    if not path.exists():
        return None
    found, lines = None, path.read_text().splitlines()
    while lines:
        head = [int(word) for word in lines[0].split()]
        rows, width, length, intervals, degree, count = head[6], head[7], head[8], head[9], head[10], head[11]
        body = [float(word.replace("D", "E")) for line in lines[1 : length + 1] for word in line.split()]
        lines = lines[length + 1 :]
        states = np.array(body[: rows * width]).reshape(rows, width)[:, 1]
        rest = body[-count:]
        largest = max(_peak(states[j * degree : (j + 1) * degree + 1]) for j in range(intervals))
        found = rest[0], rest[10], largest
    return found


def _peak(values: Array) -> float:
    """Largest size of the polynomial through equidistant values, on their interval."""
    s = np.linspace(-1, 1, values.size)
    polynomial = np.polynomial.Polynomial.fit(s, values, values.size - 1, domain=[-1, 1])
    turns = polynomial.deriv().roots()
    inside = turns[(np.abs(turns.imag) < 1e-9) & (np.abs(turns.real) <= 1)].real
    return float(np.max(np.abs(np.concatenate([values, polynomial(inside)]))))
