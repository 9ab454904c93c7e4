"""Pictures of a tuning: the bifurcation diagram with the operating point, and the simulated tasks."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from ...continuation import Branch
from ...design.diagram import diagram
from ...design.sensitivity import fold_sensitivities
from ...design.tune.tasks import SimulatedTask
from ...design.tune.tuning import Tuning
from ...errors import NoOrbit
from .branches import diagram as drawn_diagram
from .fold_curve import elasticities
from .plotting import ALONE, NEUTRAL, SMALL, Array, Line2D, panels, picture, png

START = 0.1
"""Gain at which the diagram starts, in units of the fold gain."""
CHOSEN = "#1d6b3f"


@picture("two axes, amplitude above period")
def operating_point(tuning: Tuning, branch: Branch[Any], *, ax: Any = None) -> Array:
    """The diagram of the worst servo with the recommended gain and the fold gain plus margin.

    Parameters
    ----------
    tuning
        the tuning.
    branch
        of its worst servo.

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
        ax.axvline(tuning.gain, color=CHOSEN, linewidth=2.0, zorder=3)
        ax.set_xlim(low, reach)
    for text in list(both[0].texts):  # the label of the fold would stand where the line of the gain is
        text.set_visible(False)
    handles = [
        Line2D([], [], color=NEUTRAL, linestyle="", marker="o", label=f"hunting up to {tuning.fold_gain:.4g}"),
        Line2D([], [], color=CHOSEN, linewidth=2.0, label=f"recommended gain {tuning.gain:.4g}"),
        Line2D([], [], color="0.85", linewidth=8, label="margin"),
    ]
    both[0].legend(handles=handles, loc="lower center", fontsize=SMALL)
    return both


@picture("axes, one for every task")
def tasks(simulated: Sequence[SimulatedTask], *, ax: Any = None) -> Array:
    """Tasks with the tuned controller: distance from the set point [rad] against time [s].

    Parameters
    ----------
    simulated
        those with the nominal friction are drawn.

    Examples
    --------
    >>> from casahunt import Servo, tune, pictures
    >>> pictures.tasks(tune(Servo(), "switch").verification.tasks).size
    3
    """
    nominal = [task for task in simulated if task.friction == "nominal"]
    _, rows = panels(ax, len(nominal), sharex=True)
    for ax, task in zip(rows, nominal, strict=True):
        t, x = task.motion.dense(8)
        label = f"K = {task.motion.gain:.4g}: {task.motion.verdict.kind}"
        ax.plot(t, x[0], color=CHOSEN, linewidth=ALONE, label=label)
        ax.set_title(task.start, fontsize=SMALL + 1, loc="left")
        ax.axhline(0, color=NEUTRAL, linewidth=0.8)
        ax.grid(True, color="0.88", linewidth=0.6)
        ax.margins(x=0)
        ax.set_xlim(0, min(float(one.motion.times[-1]) for one in nominal))
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 0.3 * (high - low))  # room for the legend
        ax.legend(loc="upper right", fontsize=SMALL)
        ax.set_ylabel("θ - θ$_d$ [rad]".replace("-", "\N{MINUS SIGN}"))
    rows[-1].set_xlabel("time [s]")
    return rows


def evidence_images(tuning: Tuning) -> dict[str, bytes]:
    """The images of the evidence page.

    Returns PNG files by name (page.CAPTIONS); what cannot be drawn is left out.
    """
    images: dict[str, bytes] = {}
    fold = tuning.verification.fold
    if fold is not None and tuning.model is not None:
        with suppress(NoOrbit):  # a servo without a cycle at that gain: the page says its fold in numbers
            branch = diagram(tuning.worst, tuning.model, start=START * fold.gain)
            images["diagram"] = png(operating_point(tuning, branch))
        images["sensitivities"] = png(elasticities([fold], [fold_sensitivities(fold)]))
    if any(task.friction == "nominal" for task in tuning.verification.tasks):
        images["responses"] = png(tasks(tuning.verification.tasks))
    return images
