"""Figures 1 to 11 of the report, redrawn from the library: one PNG each, and captions.md with what agrees.

    python scripts/figures.py [--out DIR] [--only N [N ...]] [--quick]

Report: Hensen, van de Molengraft and Steinbuch, "Friction induced limit cycling: hunting", DCT 2001.021.  Nothing is
copied from it: no curve was read off its pages, and the measured record is not public, so that Figures 2 and 4 show a
simulated one beside the two averages that its section 2 prints.  Figures 1, 2, 4 and 5 have the subject that the
text gives them; the subjects of the others are chosen here, after the order of its sections, and say so.

Every number in a caption is computed in the run that draws the figure, or stands in problems/table1.py.  --quick
draws the same with shorter motions and diagrams that start near the fold.
"""

from __future__ import annotations

import argparse
import re
import sys
import textwrap
import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import (  # noqa: E402
    Branch,
    Measurement,
    Options,
    Orbit,
    Record,
    Servo,
    Trajectory,
    collect,
    diagram,
    find_orbit,
    measure,
    pictures_equilibria,
    pictures_loop,
    plotting,
    record_of,
    simulate,
)
from casahunt.diagram import DRAWING_STEP  # noqa: E402
from casahunt.equilibria import equilibria  # noqa: E402
from casahunt.friction_torque import friction_torque, sliding_torque  # noqa: E402
from casahunt.hunting import MODELS, Model  # noqa: E402
from casahunt.linear_loop import linear_loop, routh_hurwitz_gain  # noqa: E402
from casahunt.plotting import LOOKS, NAMES, NEUTRAL, SMALL, Figure, Line2D, new_figure  # noqa: E402
from problems import table1  # noqa: E402

GAIN = table1.REFERENCE["experiment"]["K"]
MEASURED_AMPLITUDE = table1.REFERENCE["experiment"]["amplitude"]
MEASURED_PERIOD = 1 / table1.REFERENCE["experiment"]["frequency_hz"]
BOUND = 0.0321
"""The report's lower bound on K (sections 2 and 5)."""
BELOW = 0.02
"""A gain below it."""
STOPPED: dict[Model, float] = {"switch": 0.634, "lugre": 0.615}
"""Gains on the unstable branch at which the report's shooting stopped."""
LOOP_GAINS = (BELOW, GAIN, 0.1, 0.6)
TRANSIENT = 40.0
"""Seconds of a motion that are left out of averages."""
MARK = "#b03020"
FINE_STEP = 0.025
"""Arclength between the points of the folds enlarged."""
WIDE = 132
"""Characters in a line of the text under a figure."""
LINE_HEIGHT = 0.155
"""[in]."""
CAPTION_SIZE = 8
DPI = 110
"""Keeps each file small enough for a repository."""
CHOSEN = "What the report draws under this number is not known to this project; the subject is chosen after its text."


T = TypeVar("T")


class Study:
    """What the figures share, each computed when first asked for."""

    def __init__(self, quick: bool) -> None:
        self.servo: Servo = table1.servo()
        self.seconds = 60.0 if quick else 120.0
        self.start = 0.55 if quick else BOUND
        self.tol = 1e-5 if quick else 1e-7
        self._kept: dict[tuple[str, ...], object] = {}

    def _once(self, key: tuple[str, ...], make: Callable[[], T]) -> T:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]  # type: ignore[return-value]

    def motion(self, model: Model, *, regularised: bool = False) -> Trajectory:
        """The regulator task theta_d = 1 rad from rest."""
        key = ("motion", model, str(regularised))
        return self._once(
            key,
            lambda: simulate(self.servo, model, GAIN, time=self.seconds, tol=self.tol, regularised=regularised),
        )

    def orbit(self, model: Model, gain: float = GAIN, branch: str = "stable") -> Orbit:
        """A hunting cycle."""
        options = Options(tol=self.tol)
        return self._once(
            ("orbit", model, str(gain), branch),
            lambda: find_orbit(self.servo, model, gain, branch=branch, options=options),
        )

    def branch(self, model: Model, start: float, step: float = DRAWING_STEP) -> Branch:
        """From the gain `start` round the fold and back."""
        options = Options(tol=self.tol)
        points = diagram(self.servo, model, start=start, options=options, largest_step=step)
        return self._once(("branch", model, str(start)), lambda: collect(self.servo, model, points))

    @cached_property
    def record(self) -> Record:
        """The position of the LuGre servo in the regulator task, in place of the measured one."""
        return record_of(self.motion("lugre"))

    @cached_property
    def measurement(self) -> Measurement:
        """Averages over its periods after the transient."""
        return measure(self.settled)

    @cached_property
    def settled(self) -> Record:
        """The record after the transient."""
        return self.record.after(min(TRANSIENT, self.seconds / 4))


Drawn = tuple[Figure, str, str]
"""A figure, its title and its caption."""


def figure1(study: Study) -> Drawn:
    """Bode diagram of the controller of fixed shape, and of the loop."""
    loops = [linear_loop(study.servo, gain) for gain in LOOP_GAINS]
    below = loops[0]
    caption = (
        "The report's Figure 1, as far as its text tells: the controller of fixed shape (tau_i = tau_d = 1/(2 pi) s, "
        "Table 1) for given gains; the loop on the right is added. Agrees: without viscous friction the loop is stable "
        f"above K = {routh_hurwitz_gain(study.servo):.6g}, the report's {BOUND}. Does not agree: with the viscous "
        "friction of Table 1 the loop is stable at every K > 0; at "
        f"K = {BELOW}, below that bound, the phase margin is {below.gain_crossovers[0].margin:.3g} degrees and the "
        f"slowest pole has the real part {below.poles[0].real:.3g} 1/s."
    )
    return pictures_loop.bode(study.servo, loops), "Controller and loop", caption


def figure2(study: Study) -> Drawn:
    """Hunting: position against time."""
    record, found = study.record, study.measurement
    figure = new_figure()
    above, below = figure.subplots(2, 1, height_ratios=(1, 1.2))
    look = LOOKS["lugre"]
    above.plot(record.times, record.position, color=look.colour, linewidth=1.6, zorder=3)
    above.axhline(1.0, color=NEUTRAL, linewidth=1.0, linestyle=(0, (5, 2)), zorder=2)
    above.set(xlabel="time [s]", ylabel="position θ [rad]")
    settled = study.settled
    below.plot(settled.times, settled.position, color=look.colour, linewidth=1.6, zorder=3)
    for edge in found.crossings:
        below.axvline(edge, color="0.8", linewidth=0.7, zorder=1)
    for sign in (1, -1):
        below.axhline(1 + sign * MEASURED_AMPLITUDE, color=MARK, linewidth=1.2, linestyle=(0, (2, 2)), zorder=2)
    below.axhline(1.0, color=NEUTRAL, linewidth=1.0, linestyle=(0, (5, 2)), zorder=2)
    below.set(xlabel="time [s]", ylabel="position θ [rad], enlarged")
    for axes in (above, below):
        axes.margins(x=0, y=0.12)
        axes.grid(True, color="0.9", linewidth=0.6)
    handles = [
        Line2D([], [], color=look.colour, linewidth=1.6, label="simulated, LuGre"),
        Line2D([], [], color=NEUTRAL, linestyle=(0, (5, 2)), label="set point"),
        Line2D([], [], color=MARK, linestyle=(0, (2, 2)), label="measured average amplitude (report)"),
        Line2D([], [], color="0.8", label="periods averaged over"),
    ]
    figure.legend(handles=handles, loc="outside upper center", fontsize=SMALL, frameon=False, ncols=4)
    figure.align_ylabels([above, below])
    caption = (
        f"The report's Figure 2, as far as its text tells: hunting at K = {GAIN}, regulator task theta_d = 1 rad. "
        "The measured record is not public: this one is simulated with the LuGre model from rest at theta = 0. Agrees: "
        f"the servo ends hunting about the set point. Does not agree: averaged over {found.periods.size} periods the "
        f"amplitude is {found.amplitude:.3g} rad and the frequency {found.frequency:.3g} Hz, measured were "
        f"{MEASURED_AMPLITUDE} rad and {1 / MEASURED_PERIOD:.3g} Hz; and the simulated periods are all alike."
    )
    return figure, f"Hunting at K = {GAIN}", caption


def figure3(study: Study) -> Drawn:
    """Friction against velocity in the two models."""
    f = study.servo.friction
    figure = new_figure()
    panels = figure.subplots(1, 2)
    limit = {0: 0.30, 1: 5e-3}
    for i, axes in enumerate(panels):
        v = np.linspace(0, limit[i], 400)
        for sign in (1, -1):
            steady = sliding_torque(f, sign * v[1:])
            axes.plot(sign * v[1:], steady, color=MARK, linewidth=1.1, linestyle=(0, (4, 4)), zorder=6)
        for model in ("lugre", "switch"):
            motion, look = study.motion(model), LOOKS[model]
            t, x = motion.dense(6)
            last = t >= t[-1] - study.orbit(model).period
            torque = friction_torque(motion, t[last])
            axes.plot(x[1, last], torque, color=look.colour, linewidth=look.width, zorder=look.zorder)
        axes.set_xlim(-limit[i], limit[i])
        axes.set_xlabel("velocity θ' [rad/s]")
        axes.grid(True, color="0.9", linewidth=0.6)
    panels[0].set_ylabel("friction torque F [N m]")
    panels[0].set_title("one hunting period", fontsize=10)
    panels[1].set_title("near standstill", fontsize=10)
    handles = [
        Line2D([], [], color=LOOKS[m].colour, linewidth=LOOKS[m].width, label=f"{NAMES[m]}, hunting") for m in MODELS
    ]
    handles.append(Line2D([], [], color=MARK, linestyle=(0, (4, 4)), label="steady sliding, both models"))
    figure.legend(handles=handles, loc="outside upper center", fontsize=SMALL, frameon=False, ncols=3)
    motion = study.motion("lugre")
    t, x = motion.dense(6)
    last = t >= t[-1] - study.orbit("lugre").period
    peak = float(np.max(np.abs(friction_torque(motion, t[last]))))
    away = friction_torque(motion, t[last]) - sliding_torque(f, x[1, last])
    sliding = np.abs(x[1, last]) > f.stribeck_velocity
    caption = (
        f"The report's section 3, friction against velocity. {CHOSEN} Agrees: both models have the same sliding curve, "
        f"from Fs = {f.static:g} N m at breakaway to Fc = {f.coulomb:g} N m with the Stribeck velocity "
        f"{f.stribeck_velocity:g} rad/s (Table 1), and one hunting period at K = {GAIN} runs along it. Switch may have "
        "any torque in [-Fs, Fs] at standstill; LuGre opens a loop: the friction of its slip lags, beyond "
        f"the Stribeck velocity it is off the curve by {np.max(np.abs(away[sliding])):.2g} N m at most, and "
        f"its peak is {peak:.3g} N m. Does not agree: the bristle equation as printed in section 3.1 lacks sigma0, the "
        "force F of section 3.2 lacks sigma2 x2 in slip; drawn is the state equation, which is right."
    )
    return figure, "Friction models", caption


def figure4(study: Study) -> Drawn:
    """One period of the record beside the predicted cycles."""
    record, found = study.settled, study.measurement
    figure = new_figure()
    axes = figure.subplots()
    t, y, level = record.times, record.position, found.level
    dots = {"linestyle": "none", "marker": "o", "markersize": 3.0, "color": "0.6", "zorder": 2}
    edge, own = found.crossings[0], found.periods[0]
    here = np.flatnonzero((t >= edge - own / 4) & (t < edge + 3 * own / 4))[::8]
    axes.plot(t[here] - edge, (y - level)[here], **dots)
    handles = [Line2D([], [], label="simulated record (LuGre), one period", **dots)]
    ratios = []
    for model in ("lugre", "switch"):
        orbit, look = study.orbit(model), LOOKS[model]
        times, states = plotting.rolled(*orbit.sample(16))
        width = 1.3 if model == "switch" else 2.2
        axes.plot(times, states[0], color=look.colour, linewidth=width, zorder=look.zorder)
        label = f"{NAMES[model]}: amplitude {orbit.amplitude:.4g} rad, period {orbit.period:.4g} s"
        handles.append(Line2D([], [], color=look.colour, linewidth=width, label=label))
        ratios.append((orbit.amplitude / MEASURED_AMPLITUDE - 1, orbit.period / MEASURED_PERIOD - 1))
    dashed = {"color": MARK, "linewidth": 1.2, "linestyle": (0, (4, 2))}
    for sign in (1, -1):
        axes.axhline(sign * MEASURED_AMPLITUDE, zorder=1, **dashed)
    start = -MEASURED_PERIOD / 4
    for edge in (start, start + MEASURED_PERIOD):
        axes.axvline(edge, zorder=1, **dashed)
    text = f"measured averages: amplitude {MEASURED_AMPLITUDE} rad, period {MEASURED_PERIOD:.3g} s"
    handles.append(Line2D([], [], label=text, **dashed))
    axes.set(xlabel="time from the rise through the set point [s]", ylabel="position − set point [rad]")
    axes.grid(True, color="0.92", linewidth=0.6)
    axes.margins(x=0.02, y=0.1)
    figure.legend(handles=handles, loc="outside upper center", fontsize=SMALL, frameon=False, ncols=2)
    (lugre_a, lugre_t), (switch_a, switch_t) = ratios
    caption = (
        "The report's Figure 4, as far as its text tells: one period of the record beside the predicted cycle, "
        f"K = {GAIN}. The record is simulated with LuGre, the measured one is not public; the frame shows the measured "
        "averages. Agrees: the shape, short slips and long sticks on both sides, and a compared period of about 10 s "
        f"({study.orbit('switch').period:.4g} and {study.orbit('lugre').period:.4g} s). Does not agree: that is not "
        f"the measured average of {MEASURED_PERIOD:.2g} s (section 3.4). Against the measured averages the amplitude "
        f"is {100 * switch_a:+.0f} % (Switch) and {100 * lugre_a:+.0f} % (LuGre), the period {100 * switch_t:+.0f} % "
        f"and {100 * lugre_t:+.0f} %."
    )
    return figure, "Record and predicted cycle", caption


def figure5(study: Study) -> Drawn:
    """The stick region of Switch."""
    found = equilibria(study.servo, "switch", GAIN)
    figure = pictures_equilibria.picture(found)
    (axes,) = figure.axes
    _, states = study.orbit("switch").sample(16)
    look = plotting.MORE_LOOKS[1]
    axes.plot(
        states[0] / found.position_limit, states[2] / found.integral_limit, color=look.colour, linewidth=1.6, zorder=6,
        label="hunting cycle (slips with x2 ≠ 0)",
    )  # fmt: skip
    axes.legend(fontsize=SMALL, loc="upper right")
    caption = (
        "The report's Figure 5, as far as its text tells: the bound on the stick region of the Switch servo, "
        f"|kp x1 + ki x3| <= Fs at x2 = 0, in units of Fs/kp = {found.position_limit:.4g} rad and Fs/ki = "
        f"{found.integral_limit:.4g} rad s at K = {GAIN}. Agrees: the bound, and the equilibria x1 = 0, |x3| <= Fs/ki "
        "inside it. Does not agree: the stick force u - alpha x2 printed in section 3.2 lacks J and has the wrong sign "
        "(the stick rows of its state equation are right). All of the strip but the equilibria is left after a finite "
        "time; the hunting cycle enters and leaves it at "
        f"|x1| = {study.orbit('switch').amplitude / found.position_limit:.3g} Fs/kp."
    )
    return figure, "Stick region of the Switch model", caption


def figure6(study: Study) -> Drawn:
    """The regulator task simulated with both models."""
    figure = new_figure()
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 1, 1))
    band = study.motion("switch", regularised=True)
    drawn = {"lugre": study.motion("lugre"), "switch": band}
    static = study.servo.friction.static
    handles = []
    for name, motion in drawn.items():
        t, x = motion.dense(6)
        look = LOOKS[name]
        style = {"color": look.colour, "linewidth": 2.2 if name == "lugre" else 1.1, "zorder": look.zorder}
        for axes, values in zip(panels, (1 + x[0], x[1], motion.torque(x)), strict=True):
            axes.plot(t, values, **style)
        label = "Switch with stick band" if name == "switch" else "LuGre"
        handles.append(Line2D([], [], label=f"{label}: {motion.verdict.kind}", **style))
    dashed = {"color": NEUTRAL, "linewidth": 1.0, "linestyle": (0, (5, 2)), "zorder": 2}
    panels[0].axhline(1.0, **dashed)
    for sign in (1, -1):
        panels[2].axhline(sign * static, **dashed)
    handles.append(Line2D([], [], label="set point; ±Fs", **dashed))
    for axes, label in zip(panels, ("position θ [rad]", "velocity θ' [rad/s]", "motor torque m [N m]"), strict=True):
        axes.set_ylabel(label)
        axes.grid(True, color="0.9", linewidth=0.6)
        axes.margins(x=0, y=0.08)
    panels[1].set_ylim(-0.45, 0.45)
    panels[2].set_ylim(-1.6, 1.6)
    panels[2].set_xlabel("time [s]")
    figure.align_ylabels(panels)
    figure.legend(handles=handles, loc="outside upper center", fontsize=SMALL, frameon=False, ncols=3)
    exact = study.motion("switch").verdict
    peak = max(float(np.max(np.abs(m.dense(6)[1][1]))) for m in drawn.values())
    caption = (
        f"The report's section 3, simulated: the regulator task at K = {GAIN} with both models, Switch with the "
        f"report's stick band eta = {study.servo.friction.stick_band:g} rad/s. {CHOSEN} The first swing, up to "
        f"{peak:.3g} rad/s, leaves the two lower panels. Agrees: both models end hunting with nearly the same cycle, "
        f"{_pair(band.verdict)} and {_pair(drawn['lugre'].verdict)}; without the band Switch has {_pair(exact)}. "
        f"Does not agree: the measured averages, {MEASURED_AMPLITUDE} rad and {MEASURED_PERIOD:.2g} s; and the model "
        "as printed: the u of section 3.2 is a torque of the opposite sign to the voltage u of section 2, and with it "
        "the transition branch pushes the wrong way (harmless as eta tends to 0). Simulated is a consistent form."
    )
    return figure, "Regulator task", caption


def figure7(study: Study) -> Drawn:
    """Phase portrait of the limit cycles."""
    orbits = [study.orbit(model) for model in MODELS]
    a, b = orbits
    low = study.orbit("switch", BELOW)
    caption = (
        f"The hunting cycles of both models at K = {GAIN} in phase space. {CHOSEN} Agrees: a stable cycle of slip, "
        "stick, reverse slip and stick in both models, close to each other: amplitudes "
        f"{a.amplitude:.5g} and {b.amplitude:.5g} rad, periods {a.period:.5g} and {b.period:.5g} s, half multipliers "
        f"{a.half_multiplier:.3g} and {b.half_multiplier:.3g}, all inside the unit circle. Does not agree: section 5 "
        f"starts hunting at K = {BOUND}; at K = {BELOW} the same cycle exists, amplitude "
        f"{low.amplitude:.5g} rad, period {low.period:.5g} s (Switch)."
    )
    return plotting.phase_portrait(orbits), "Limit cycles in phase space", caption


def _branch_figure(study: Study, model: Model) -> Drawn:
    branch = study.branch(model, study.start)
    figure = plotting.diagram([branch])
    stop = STOPPED[model]
    for axes in figure.axes[:2]:
        axes.axvline(stop, color=MARK, linewidth=1.0, linestyle=(0, (2, 2)), zorder=1)
    figure.axes[1].text(
        stop - 0.004, 0.97, f"shooting stopped,\nK = {stop}", color=MARK, fontsize=SMALL, ha="right", va="top",
        transform=figure.axes[1].get_xaxis_transform(),
    )  # fmt: skip
    fold = _fold(branch)
    last = branch.orbits[-1]
    caption = (
        f"Amplitude and period of the {NAMES[model]} cycles against the gain. {CHOSEN} Agrees: a stable branch that "
        f"ends in a cyclic fold beyond the gain at which the report's shooting stopped on the unstable branch, K = "
        f"{stop}. Does not agree, or is new: the fold is at K = {fold.gain:.6g} (amplitude {fold.amplitude:.5g} rad, "
        f"period {fold.period:.5g} s); the unstable branch goes on below the stop down to K = {last.gain:.4g} at "
        f"least, where its period is {last.period:.4g} s and its amplitude {last.amplitude:.3g} rad; and K = "
        f"{study.start}, where the figure begins, is no end of the stable branch either (Figure 7)."
    )
    return figure, f"Bifurcation diagram, {NAMES[model]}", caption


def figure8(study: Study) -> Drawn:
    """Bifurcation diagram of Switch."""
    return _branch_figure(study, "switch")


def figure9(study: Study) -> Drawn:
    """Bifurcation diagram of LuGre."""
    return _branch_figure(study, "lugre")


def figure10(study: Study) -> Drawn:
    """Floquet multipliers against the gain."""
    branches = [study.branch(model, study.start) for model in MODELS]
    parts = []
    for branch in branches:
        mu = branch.half_multipliers
        stable = mu[branch.stable]
        special = ", ".join(f"{s.kind} at K = {s.orbit.gain:.5g}" for s in branch.special)
        parts.append(
            f"{NAMES[branch.model]}: on the stable branch mu falls from {stable[0]:.3g} at K = {branch.gains[0]:.4g} "
            f"to {stable.min():.3g} before it turns up to +1, on the unstable one it reaches {mu.max():.2g} (lambda = "
            f"{mu.max() ** 2:.2g}); {special}"
        )
    caption = (
        "The nontrivial Floquet multiplier along both branches, as the half multiplier mu; lambda = mu^2 belongs to "
        f"the whole period. {CHOSEN} Agrees: a stable branch, |mu| < 1, that loses its stability in a cyclic fold, "
        f"mu = +1. {'. '.join(parts)}. Does not agree: the lower bound K > {BOUND}: neither multiplier "
        "comes near the unit circle towards it."
    )
    return plotting.multipliers(branches), "Floquet multipliers", caption


def figure11(study: Study) -> Drawn:
    """The folds, enlarged."""
    branches = [study.branch(model, 0.58, FINE_STEP) for model in MODELS]
    figure = plotting.diagram(branches, equilibria=False)
    words = []
    for branch in branches:
        model = branch.model
        stop = study.orbit(model, STOPPED[model], "unstable")
        for axes, value in zip(figure.axes[:2], (stop.amplitude, stop.period), strict=True):
            axes.plot(stop.gain, value, marker="X", markersize=10, color=MARK, markeredgecolor="black", zorder=10)
        fold = _fold(branch)
        words.append(
            f"{NAMES[model]}: fold at K = {fold.gain:.6g}; the cycle at the stop, K = {stop.gain}, has the period "
            f"{stop.period:.5g} s, the amplitude {stop.amplitude:.4g} rad, mu = {stop.half_multiplier:.4g} and "
            f"lambda = {stop.half_multiplier**2:.2g}"
        )
    above, below = figure.axes[:2]
    above.set_yscale("linear")
    for text in list(above.texts):  # placed for the logarithmic axis
        text.remove()
    for branch in branches:
        fold = _fold(branch)
        above.annotate(
            f"{NAMES[branch.model]} fold\nK = {fold.gain:.6g}", (fold.gain, fold.amplitude), (12, 0), fontsize=SMALL,
            textcoords="offset points", va="center",
        )  # fmt: skip
    above.plot([], [], marker="X", linestyle="none", color=MARK, markeredgecolor="black", markersize=9,
               label="where the report's shooting stopped")  # fmt: skip
    above.legend(loc="upper right", fontsize=SMALL, frameon=False)
    caption = (
        f"The cyclic folds of both models, and where the report's shooting stopped on the unstable branches. {CHOSEN} "
        "Agrees: both models have a fold, that of LuGre at a lower gain, each a little above its stop. Does not agree, "
        f"or is new: the stops are no property of the servo. {'; '.join(words)}: shooting over one period "
        "multiplies its errors by lambda = mu^2, which grows further on (Figure 10); collocation does not."
    )
    return figure, "The folds", caption


def _fold(branch: Branch) -> Orbit:
    return next(s.orbit for s in branch.special if s.kind == "fold")


def _pair(verdict: object) -> str:
    return f"{verdict.amplitude:.5g} rad, {verdict.period:.5g} s"  # type: ignore[attr-defined]


FIGURES: dict[int, Callable[[Study], Drawn]] = {
    int(name.removeprefix("figure")): function
    for name, function in list(globals().items())
    if name.startswith("figure") and name != "figure"
}


def captioned(figure: Figure, text: str) -> Figure:
    """The figure with its caption as text underneath, and the height for it."""
    lines = textwrap.wrap(text, WIDE)
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + LINE_HEIGHT * (len(lines) + 1))
    figure.supxlabel("\n".join(lines), fontsize=CAPTION_SIZE, x=0.015, ha="left", linespacing=1.35)
    return figure


def _written(path: Path) -> dict[int, str]:
    """The captions of figures drawn before, so that drawing one does not lose the others."""
    if not path.is_file():
        return {}
    parts = re.split(r"^(?=## Figure (\d+):)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {int(n): part.rstrip() + "\n" for n, part in zip(parts[::2], parts[1::2], strict=True)}


def main() -> None:
    """Draw the figures asked for and write the captions."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures", metavar="DIR")
    parser.add_argument("--only", type=int, nargs="+", choices=sorted(FIGURES), metavar="N", default=sorted(FIGURES))
    parser.add_argument("--quick", action="store_true", help="shorter motions, diagrams from near the fold")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    study = Study(options.quick)
    text = options.out / "captions.md"
    captions = _written(text)
    for n in sorted(set(options.only)):
        began = time.perf_counter()
        figure, title, caption = FIGURES[n](study)
        path = options.out / f"figure{n:02d}.png"
        captioned(figure, f"Figure {n}. {title}. {caption}").savefig(path, dpi=DPI, format="png")
        captions[n] = f"## Figure {n}: {title}\n\n![{title}]({path.name})\n\n{textwrap.fill(caption, 118)}\n"
        print(f"{path}  {path.stat().st_size / 1000:.0f} kB  {time.perf_counter() - began:.1f} s", flush=True)
    head = (
        "# The report's figures, redrawn\n\n"
        + textwrap.fill(
            "Hensen, van de Molengraft and Steinbuch, *Friction induced limit cycling: hunting*, DCT 2001.021. "
            "Written by `python scripts/figures.py`; every number is computed in that run, except those marked as the "
            "report's or as measured.",
            118,
        )
        + "\n\n"
    )
    text.write_text(head + "\n".join(captions[n] for n in sorted(captions)), encoding="utf-8")


if __name__ == "__main__":
    main()
