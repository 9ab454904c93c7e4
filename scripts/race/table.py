"""The rows as text, as the promised ratios, and as work-precision diagrams."""

from __future__ import annotations

from pathlib import Path

from casahunt.servo.friction import MODELS
from scripts.race.rows import ALONE, Row
from scripts.race.taylor import METHOD as TAYLOR


def table(rows: list[Row]) -> str:
    """The rows as text."""
    titles = f"{'scene':15s} {'model':7s} {'method':36s} {'setting':18s} {'seconds':>9s} {'error':>9s} {'points':>6s}"
    lines = [f"{titles}  note"]
    for r in rows:
        seconds = f"{r.seconds:9.4f}" if r.seconds is not None else f"{'-':>9s}"
        error = f"{r.error:9.1e}" if r.error is not None else f"{'-':>9s}"
        points = f"{r.points or '':>6}"
        line = f"{r.scene:15s} {r.model:7s} {r.method:36s} {r.setting:18s} {seconds} {error} {points}  {r.note}"
        lines.append(line.rstrip())
    return "\n".join(lines)


def ratios(rows: list[Row]) -> list[str]:
    """The comparisons that the project has promised, from the rows of this run."""

    def fastest(scene: str, model: str, method: str, error: float, setting: str = "") -> Row | None:
        fit = [r for r in rows if (r.scene, r.model, r.method) == (scene, model, method) and r.seconds is not None
               and r.error is not None and r.error <= error and (not setting or r.setting == setting)]  # fmt: skip
        return min(fit, key=lambda r: r.seconds or 0, default=None)

    out = []
    for model, error, setting, goal in (("lugre", 1e-8, "1200 x 4", 0.1), ("switch", 1e-10, "50 x 4", 1.0)):
        ours = fastest("diagram", model, "casahunt", error)
        peer = fastest("diagram", model, "AUTO-07p", 1.0, setting)
        if ours and peer and peer.seconds and ours.seconds:
            out.append(
                f"diagram, {model}: casahunt {ours.seconds:.3f} s ({ours.points} points, fold {ours.error:.0e}) / "
                f"AUTO-07p {setting} {peer.seconds:.3f} s ({peer.points} points, fold {peer.error:.0e}) = "
                f"{ours.seconds / peer.seconds:.3f}  (goal {goal})"
            )
    for scene, model, error in (
        ("orbit-stable", "switch", 1e-8), ("orbit-unstable", "switch", 1e-7), ("fold", "switch", 1e-9),
        ("orbit-stable", "lugre", 1e-8),
    ):  # fmt: skip
        ours, peer = (fastest(scene, model, method, error) for method in ("casahunt", TAYLOR))
        if ours and peer and ours.seconds and peer.seconds:
            out.append(
                f"{scene} to {error:.0e}, {model}: casahunt {1e3 * ours.seconds:.3g} ms / {TAYLOR} "
                f"{1e3 * peer.seconds:.3g} ms = {ours.seconds / peer.seconds:.1f}"
            )
    for model, goal in (("switch", 10), ("lugre", 5)):
        ours = fastest("orbit-stable", model, "casahunt", 1e-8)
        peer = fastest("orbit-stable", model, "solve_ivp shooting", 1e-8)
        if ours and ours.seconds and peer and peer.seconds:
            out.append(
                f"one stable orbit to 1e-8, {model}: shooting {peer.seconds:.3f} s / casahunt {ours.seconds:.3f} s = "
                f"{peer.seconds / ours.seconds:.1f}  (goal {goal})"
            )
    return out


COLOURS = {
    "casahunt": "#0b2f6b", "AUTO-07p": "#b3440c", "solve_ivp shooting": "#6b8e23", "solve_bvp": "#8a2be2",
    TAYLOR: "#c2185b",
}  # fmt: skip
FLOOR = 1e-15
"""Errors below this are drawn here: the reference values have sixteen digits."""
DECADES = 30.0
"""The time axes span this factor at least."""
MARKERS = {"casahunt": "o", "AUTO-07p": "s", "solve_ivp shooting": "^", "solve_bvp": "D", TAYLOR: "v"}


def picture(rows: list[Row], path: Path) -> None:
    """Work-precision diagrams, one per scene and model."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    scenes = [scene for scene in ALONE if any(r.scene == scene for r in rows)]
    models = [model for model in MODELS if any(r.model == model for r in rows)]
    figure = Figure(figsize=(4.2 * len(scenes), 3.6 * len(models)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(models), len(scenes), squeeze=False)
    for line, model in zip(grid, models, strict=True):
        for axes, scene in zip(line, scenes, strict=True):
            for method, colour in COLOURS.items():
                found = [r for r in rows if (r.scene, r.model, r.method) == (scene, model, method)]
                done = [(r.seconds, max(r.error, FLOOR)) for r in found if r.seconds and r.error is not None]
                if done:
                    x, y = zip(*done, strict=True)
                    axes.loglog(x, y, MARKERS[method] + "-", color=colour, label=method, markersize=5)
                elif found:
                    axes.plot([], [], MARKERS[method], color=colour, label=f"{method}: fails")
            axes.set_title(f"{scene}, {model}")
            axes.set_xlabel("run time [s]")
            axes.set_ylabel("relative error")
            axes.grid(True, which="major", alpha=0.3)
            low, high = axes.get_xlim()
            widen = max(1.0, DECADES * low / high) ** 0.5  # narrow ranges would drown in tick labels
            axes.set_xlim(low / widen, high * widen)
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.legend(fontsize=8)
    figure.savefig(path, dpi=130)
