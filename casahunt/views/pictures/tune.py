"""Pictures of a tuning: the bifurcation diagram with the operating point, and the tasks before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...design.diagram import diagram
from ...design.sensitivity import fold_sensitivities
from ...design.tune.tasks import SimulatedTask
from ...design.tune.tuning import Tuning
from ...errors import NoOrbit
from ...orbits import Options
from ...servo.branch import Branch
from .branches import diagram as drawn_diagram
from .fold import elasticities
from .plotting import ALONE, NEUTRAL, SMALL, Array, Line2D, panels, png

START = 0.1
"""Gain at which the diagram starts, in units of the fold gain."""
TASK_SWINGS = 6
"""Hunting periods that the picture of the tasks shows."""
BEFORE, AFTER = "#b03020", "#1d6b3f"


def operating_point(tuning: Tuning, branch: Branch, *, ax: Any = None) -> Array:
    """The diagram of the worst servo with the recommended gain and the fold gain plus margin.

    Parameters
    ----------
    tuning
        the tuning.
    branch
        of its worst servo.
    ax
        two axes to draw into; default: those of a new figure.

    Returns
    -------
    The two axes, amplitude above period.

    Raises
    ------
    InputError : what was given are no axes, or not as many as there are panels.

    Examples
    --------
    >>> from casahunt import Servo, diagram, tune, pictures
    >>> tuning = tune(Servo(), "switch")
    >>> branch = diagram(tuning.worst, "switch", start=0.6)
    >>> axes = pictures.operating_point(tuning, branch)
    >>> axes.shape
    (2,)
    """
    both = drawn_diagram([branch], equilibria=False, ax=ax)
    for ax in both:
        low, high = ax.get_xlim()
        reach = max(high, tuning.gain + 0.06 * (tuning.gain - low))
        if tuning.fold_gain:
            ax.axvspan(tuning.fold_gain, (1 + tuning.demands.margin) * tuning.fold_gain, color="0.9", zorder=0)
        ax.axvline(tuning.gain, color=AFTER, linewidth=2.0, zorder=3)
        ax.set_xlim(low, reach)
    for text in list(both[0].texts):  # the label of the fold would stand where the line of the gain is
        text.set_visible(False)
    handles = [
        Line2D([], [], color=NEUTRAL, linestyle="", marker="o", label=f"hunting up to {tuning.fold_gain:.4g}"),
        Line2D([], [], color=AFTER, linewidth=2.0, label=f"recommended gain {tuning.gain:.4g}"),
        Line2D([], [], color="0.85", linewidth=8, label="margin"),
    ]
    both[0].legend(handles=handles, loc="lower center", fontsize=SMALL)
    return both


def tasks(before: tuple[float, Sequence[SimulatedTask]], after: Sequence[SimulatedTask], *, ax: Any = None) -> Array:
    """The same tasks before and after: distance from the set point [rad] against time [s].

    Parameters
    ----------
    before
        gain and tasks.
    after
        tasks with the tuned controller.
    ax
        axes for every task, to draw into; default: those of a new figure.

    Returns
    -------
    The axes, one for every task.

    Raises
    ------
    InputError : what was given are no axes, or not as many as there are panels.

    Examples
    --------
    >>> from casahunt import Servo, tune, pictures
    >>> tuning = tune(Servo(), "switch")
    >>> tasks = tuning.verification.tasks
    >>> pictures.tasks((tuning.gain, tasks), tasks).size
    3
    """
    nominal = [task for task in after if task.friction == "nominal"]
    pairs = list(zip(before[1], nominal, strict=True))
    swings = [old.motion.verdict.period for old, _ in pairs if old.motion.verdict.kind == "hunting"]
    whole = min(float(task.motion.times[-1]) for pair in pairs for task in pair)
    shown = min(whole, TASK_SWINGS * max(swings)) if swings else whole
    _, rows = panels(ax, len(pairs), sharex=True)
    for ax, (old, new) in zip(rows, pairs, strict=True):
        for task, colour, width, dashes in ((old, BEFORE, ALONE, "-"), (new, AFTER, 2.2, (0, (5, 2)))):
            t, x = task.motion.dense(8)
            label = f"K = {task.motion.gain:.4g}: {task.motion.verdict.kind}"
            ax.plot(t, x[0], color=colour, linewidth=width, linestyle=dashes, label=label)
        t, x = old.motion.dense(8)
        size = 4 * float(np.max(np.abs(x[0, t >= t[-1] / 2])))
        if 0 < size < 0.5 * float(np.max(np.abs(old.motion.states[0]))):
            ax.set_ylim(-size, size)  # hunting is small beside the step
        ax.set_title(old.start, fontsize=SMALL + 1, loc="left")
        ax.axhline(0, color=NEUTRAL, linewidth=0.8)
        ax.grid(True, color="0.88", linewidth=0.6)
        ax.margins(x=0)
        ax.set_xlim(0, shown)
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 0.3 * (high - low))  # room for the legend
        ax.legend(loc="upper right", fontsize=SMALL, ncols=2)
        ax.set_ylabel("θ - θ$_d$ [rad]".replace("-", "\N{MINUS SIGN}"))
    rows[-1].set_xlabel("time [s]")
    return rows


def evidence_images(
    tuning: Tuning, before: tuple[float, Sequence[SimulatedTask]], options: Options | None = None
) -> dict[str, bytes]:
    """The images of the evidence page.

    Returns PNG files by name (page.CAPTIONS); what cannot be drawn is left out.
    """
    images: dict[str, bytes] = {}
    fold = tuning.verification.fold
    if fold is not None:
        try:
            branch = diagram(tuning.worst, tuning.model, start=START * fold.gain, options=options)
            images["diagram"] = png(operating_point(tuning, branch))
        except NoOrbit:
            pass  # a servo without a cycle at that gain: the page says its fold in numbers
        images["sensitivities"] = png(elasticities([fold], [fold_sensitivities(fold)]))
    if any(task.friction == "nominal" for task in tuning.verification.tasks):
        images["responses"] = png(tasks(before, tuning.verification.tasks))
    return images
