"""What many servos at once cost: against their number, the intervals of the mesh and the degree, as straight lines.

    seconds ~ c x^slope,    the slope by least squares over the larger half of the points, in logarithms

Folds of servos +-2 % about that of Table 1, from its fold; one Newton step of 48 members on a Switch cycle for the
other two.  heyoka's loop solves the same Switch folds one after the other by Newton's method on the reduced problem
(peers/servo_heyoka.py), each from 0.3 % off: from the fold of Table 1 it does not get there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from casahunt import Options, find_fold, find_orbit
from casahunt.collocation.mesh import transfer
from casahunt.collocation.transcription import Setting, Transcription, settings_of, transcribe
from casahunt.design.ensemble import fold_ensemble
from casahunt.orbits.orbit import unknowns_of
from problems import table1
from scripts.race.rows import Row, best_of
from scripts.race.taylor import NEARBY

SCENE = "ensemble"
SERVOS, SPREAD, TOLERANCE = {"switch": (1, 4, 16, 64, 256, 1024), "lugre": (1, 4, 16, 64, 256)}, 0.02, 1e-8
MEMBERS, INTERVALS, DEGREES = 48, (4, 8, 16, 32, 64, 128), (2, 3, 4, 5, 6, 7, 8, 9)
REPEATS = 2


def scaling_rows() -> list[Row]:
    """Seconds by servos, intervals and degree; the setting is what they are against, points the value."""
    rows = []
    for model, counts in SERVOS.items():
        for count in counts:
            seconds, found = best_of(REPEATS, lambda m=model, n=count: _folds(m, n))  # type: ignore[misc]
            note = f"{found.how.count('batch')} in the batch, {found.how.count('alone')} alone"
            error = float(found.gain_errors.max())
            rows.append(Row(SCENE, model, "folds together", "servos", seconds, error, count, note))
    rows += heyoka_rows(SERVOS["switch"][-1])
    for against, values in (("intervals", INTERVALS), ("degree", DEGREES)):
        for value in values:
            t, u, setting = _on_mesh(**{against: value})
            many, p = (np.repeat(one[None], MEMBERS, axis=0) for one in (u, setting.p))
            settings = settings_of(setting, p, np.zeros_like(p))
            fixed = np.repeat(t.system.border(parameter=1.0)[None], MEMBERS, axis=0)

            def step(t: Transcription = t, many: Any = many, settings: Any = settings, fixed: Any = fixed) -> Any:
                return t.linearise(many, settings).step(fixed)[0]

            seconds, _ = best_of(REPEATS, step)
            rows.append(Row(SCENE, "switch", f"a Newton step of {MEMBERS}", against, seconds, None, value))
    return rows


def _folds(model: Any, count: int) -> Any:
    """The folds of so many servos; the known one is found once."""
    if model not in _known:
        _known[model] = find_fold(table1.servo(), model, options=Options(tol=TOLERANCE))
    names, rows = servos(model, count)
    return fold_ensemble(table1.servo(), model, names, rows, options=Options(tol=TOLERANCE), fold=_known[model])


_known: dict[str, Any] = {}


def servos(model: str, count: int, seed: int = 0) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the parameters that a model has, and rows of them within `SPREAD`.

    Parameters
    ----------
    model, count, seed
        the friction model, how many rows, and of the random numbers.

    Returns
    -------
    Names (k), and (count, k) values.
    """
    own = table1.servo()
    bristle = ("friction.stiffness", "friction.damping") if model == "switch" else ()
    names = tuple(name for name in own.names if name not in ("gain", *bristle))
    values = dict(zip(own.names, own.parameters(1.0), strict=True))
    ways = np.random.default_rng(seed).uniform(-1, 1, (count, len(names)))
    return names, np.array([values[name] for name in names]) * (1 + SPREAD * ways)


def heyoka_rows(count: int) -> list[Row]:
    """The same Switch folds one after the other by heyoka; where that is missing, the reason."""
    method = "folds one by one, heyoka"
    try:
        from scripts.peers.servo_heyoka import SwitchTaylor
        from scripts.peers.shooting import Failed
    except ImportError as error:
        return [Row(SCENE, "switch", method, "servos", None, None, None, str(error))]
    names, rows = servos("switch", count)
    engine, ours = SwitchTaylor(1e-12), _folds("switch", count)

    def loop() -> np.ndarray:
        gains = np.full(count, np.nan)
        for i, row in enumerate(rows):
            servo = table1.servo().replace(**dict(zip(names, map(float, row), strict=True)))
            try:
                gains[i] = engine.fold(servo, NEARBY * ours.gains[i], NEARBY * ours.amplitudes[i])[0]
            except (Failed, ValueError, np.linalg.LinAlgError):
                continue
        return gains

    seconds, gains = best_of(1, loop)
    off = np.abs(gains / ours.gains - 1)
    note = f"{int(np.isnan(gains).sum())} failed, {int((off > 1e-6).sum())} at another fold"
    return [Row(SCENE, "switch", method, "servos", seconds, float(np.nanmedian(off)), count, note)]


def _on_mesh(intervals: int = 8, degree: int = 8) -> tuple[Transcription, Any, Setting]:
    """A Switch cycle on so many equal intervals of a degree, as far as the known one tells."""
    t, u, setting = unknowns_of(find_orbit(table1.servo(), "switch", 0.4, options=Options(tol=TOLERANCE)))
    counts = tuple(intervals if count else 0 for count in t.counts)
    target = transcribe(t.cycle, counts, degree, t.kind)
    breaks = [np.linspace(0, 1, intervals + 1)] * sum(count > 0 for count in counts)
    t, u, fractions = transfer(t, u, setting.fractions, breaks, target=target)
    return t, u, Setting(fractions, setting.p, setting.scale, setting.dp)


def slopes(rows: list[Row]) -> dict[tuple[str, str, str], float]:
    """{(model, method, against): slope} of the lines."""
    found = {}
    for key, line in _lines(rows).items():
        tail = np.log(line[:, line.shape[1] // 2 :])
        if tail.shape[1] > 1:
            found[key] = float(np.polyfit(*tail, 1)[0])
    return found


def _lines(rows: list[Row]) -> dict[tuple[str, str, str], np.ndarray]:
    """(2, m) values and seconds of each line."""
    lines: dict[tuple[str, str, str], list[tuple[float, float]]] = {}
    for r in rows:
        if r.scene == SCENE and r.seconds is not None and r.points:
            lines.setdefault((r.model, r.method, r.setting), []).append((r.points, r.seconds))
    return {key: np.array(points).T for key, points in lines.items()}


def drawn(rows: list[Row], path: Path) -> None:
    """Write the picture of the lines.

    Parameters
    ----------
    rows, path
        of `scaling_rows`, and the PNG.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    lines, found = _lines(rows), slopes(rows)
    if not lines:
        return
    shown = [against for against in ("servos", "intervals", "degree") if any(key[2] == against for key in lines)]
    figure, axes = plt.subplots(1, len(shown), figsize=(3.7 * len(shown), 3.6), layout="constrained", squeeze=False)
    for ax, against in zip(axes[0], shown, strict=True):
        for (model, method, setting), (x, y) in lines.items():
            if setting != against:
                continue
            slope = found.get((model, method, setting))
            said = method if slope is None else f"{method}: slope {slope:.2f}"
            ax.loglog(x, y, "o-" if x.size > 1 else "*", ms=5 if x.size > 1 else 11, label=f"{model}, {said}")
        ax.set(xlabel=against, ylabel="processor time [s]")
        ax.grid(which="both", alpha=0.25)
        ax.legend(fontsize=7, frameon=False, loc="upper left")
        ax.set_ylim(top=ax.get_ylim()[1] * 4)
        if against == "degree":
            ticks = [value for value in DEGREES if value != 7]
            ax.set_xticks(ticks, [str(value) for value in ticks])
            ax.xaxis.set_minor_formatter("")
    figure.savefig(path, dpi=110)
    plt.close(figure)
