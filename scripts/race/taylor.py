"""heyoka on the servo's scenes: its patient user's work (peers/servo_heyoka.py), and the same with its compiler's time.

Stable cycles from nothing; the unstable one from that of a neighbour; the fold from nearby.  The scene "gains" has
casahunt and heyoka on the stable branch up to next to the fold, from nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from casahunt import NoOrbit, Options, find_orbit
from problems import table1
from scripts.race.rows import GAINS, Row, best_of, orbit_error, reference

METHOD = "heyoka, reduced by hand"
TOLERANCES = {"switch": (1e-6, 1e-9, 1e-12, 2.2e-16), "lugre": (1e-9, 1e-12, 2.2e-16)}
NEIGHBOUR, NEARBY = 1.025, 1.003
"""Gain of the neighbour of an unstable cycle, and what the guess of the fold is off, in gain and in amplitude."""
ALONG, ALONG_TOLERANCE, ALONG_TAYLOR = (0.04, 0.1, 0.2, 0.4, 0.6), 1e-8, (1e-9, 1e-12)
"""Gains of the scene "gains", casahunt's tolerance and heyoka's."""


def taylor_rows(scene: str, model: str, repeats: int) -> list[Row]:
    """heyoka on a scene; nothing where it has no such way.

    Parameters
    ----------
    scene, model
        the scene, "diagram" excepted, and the friction model.
    repeats
        how often a thing is timed at least.

    Returns
    -------
    Rows; where heyoka is missing, one with the reason.
    """
    if model == "lugre" and scene != "orbit-stable":
        return []
    rows = []
    for tol in TOLERANCES[model]:
        rows += _timed(scene, model, f"tol {tol:.0e}", tol, _asked(scene, model, GAINS.get(scene, 0.0)), repeats)
    return rows


def along_rows(model: str, repeats: int) -> list[Row]:
    """The scene "gains".

    Parameters
    ----------
    model, repeats
        as in `taylor_rows`.

    Returns
    -------
    Rows.
    """
    rows = []
    for gain in ALONG:
        row = reference(model, "orbit-stable", gain)

        def ours(gain: float = gain) -> Any:
            return find_orbit(table1.servo(), model, gain, options=Options(tol=ALONG_TOLERANCE))  # type: ignore[arg-type]

        setting = f"K = {gain:g}, {ALONG_TOLERANCE:.0e}"
        try:
            seconds, orbit = best_of(repeats, ours)
            rows.append(Row("gains", model, "casahunt", setting, seconds, orbit_error(orbit, row)))
        except NoOrbit as error:
            rows.append(Row("gains", model, "casahunt", setting, None, None, None, str(error)[:160]))
        for tol in ALONG_TAYLOR:
            setting = f"K = {gain:g}, {tol:.0e}"
            rows += _timed("gains", model, setting, tol, _asked("orbit-stable", model, gain), repeats)
    return rows


Asked = Callable[[Any], float]
"""What a scene asks of an engine; gives the relative error."""


def _asked(scene: str, model: str, gain: float) -> Asked:
    servo, row = table1.servo(), reference(model, scene, gain)
    if scene == "fold":

        def fold(engine: Any) -> float:
            found, _ = engine.fold(servo, NEARBY * row["K"], NEARBY * row["amplitude"])
            return abs(found / row["K"] - 1)

        return fold
    if scene == "orbit-stable":
        return lambda engine: orbit_error(engine.cycle(servo, gain), row)
    near = find_orbit(servo, model, NEIGHBOUR * gain, branch="unstable", options=Options(tol=1e-6)).amplitude  # type: ignore[arg-type]
    return lambda engine: orbit_error(engine.unstable_cycle(servo, gain, near), row)


def _timed(scene: str, model: str, setting: str, tol: float, asked: Asked, repeats: int) -> list[Row]:
    """With an engine that is there, and with one that has to be compiled."""
    try:
        import heyoka

        from scripts.peers import servo_heyoka as peer
        from scripts.peers.shooting import Failed
    except ImportError as error:
        return [Row(scene, model, METHOD, setting, None, None, None, f"left out: {error}")]
    make = peer.SwitchTaylor if model == "switch" else peer.LugreTaylor

    def first() -> float:
        heyoka.llvm_state.clear_memcache()
        return asked(make(tol))

    engine = make(tol)
    rows = []
    for method, action in ((METHOD, lambda: asked(engine)), (f"{METHOD}, first time", first)):
        try:
            seconds, error = best_of(repeats if method == METHOD else 1, action)
            rows.append(Row(scene, model, method, setting, seconds, error))
        except (Failed, np.linalg.LinAlgError, ZeroDivisionError) as why:
            rows.append(Row(scene, model, method, setting, None, None, None, f"fails: {why}"))
    return rows
