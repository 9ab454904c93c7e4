"""Every picture joins a user's figure: it draws into the axes that it is given, into nothing else, and returns them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import casahunt
from casahunt import InputError, Servo, pictures
from casahunt.cli import main
from casahunt.servo.parts import BY_DIRECTION, INERTIA, INTEGRATOR, PID_BY_TIMES, Loop

SERVO = Servo()


@cache
def fold() -> casahunt.Fold:
    return casahunt.find_fold(SERVO, "switch")


@cache
def branch() -> casahunt.Branch:
    return casahunt.diagram(SERVO, "switch", start=0.6)


@cache
def sampled_motion() -> casahunt.SampledMotion:
    drive = casahunt.Drive(sample_time=1e-3, encoder=2000)
    return casahunt.simulate_sampled(casahunt.Servo(), 0.04, drive, time=20.0)


@cache
def motion() -> casahunt.Trajectory:
    return casahunt.simulate(SERVO, "switch", 0.04, time=60.0)


@cache
def record() -> casahunt.Record:
    return casahunt.measure(motion()).record


@cache
def tuning() -> casahunt.Tuning:
    return casahunt.tune(SERVO, "switch")


@cache
def histogram_of() -> tuple[Any, ...]:
    uncertainty = casahunt.Uncertainty({"friction.static": (0.525, 0.535)})
    given = SERVO, "switch", uncertainty
    samples = casahunt.sample_fold_gains(*given, 6, fold=fold())
    worst = casahunt.worst_corner(*given, fold=fold())
    return fold(), samples, worst, casahunt.compare_uncertainty(fold(), uncertainty, samples, worst)


@cache
def leak() -> casahunt.Cures:
    return casahunt.remedies(SERVO, "switch", 0.04, only=["leak"])


def folds() -> casahunt.FoldMap:
    values = np.array([0.53, 0.535]), np.array([0.1, 0.11])
    return casahunt.fold_map(SERVO, "switch", ("friction.static", "friction.viscous"), *values, fold=fold())


DRAWN: dict[str, tuple[int, Callable[[], tuple[Any, ...]]]] = {
    "basin": (1, lambda: (casahunt.basin(SERVO, "switch", 0.5),)),
    "bode": (4, lambda: (
        SERVO, [casahunt.linear_loop(SERVO, gain) for gain in (0.1, 0.4)], casahunt.Drive(sample_time=0.01))),
    "cobweb": (1, lambda: (casahunt.fixed_points(SERVO, 0.6, 1e-3, 3e-3, points=10),)),
    "diagram": (2, lambda: ([branch()],)),
    "elasticities": (1, lambda: ([fold()], [casahunt.fold_sensitivities(fold())])),
    "equilibria": (1, lambda: (casahunt.equilibria(SERVO, "switch", 0.1),)),
    "fitted_records": (2, lambda: (
        casahunt.identify([record()], SERVO, 0.04, free=["friction.static"], advise=False),)),
    "fold_curves": (1, lambda: ([casahunt.fold_curve(
        SERVO, "switch", vary="friction.static", start=0.53, end=0.54, points=2)],)),
    "fold_map": (1, lambda: (folds(),)),
    "folded_record": (2, lambda: (casahunt.measure(motion()), casahunt.find_orbit(SERVO, "switch", 0.04))),
    "histogram": (1, histogram_of),
    "motion": (3, lambda: (motion(),)),
    "sampled_motion": (3, lambda: (sampled_motion(),)),
    "multipliers": (1, lambda: ([branch()],)),
    "operating_point": (2, lambda: (tuning(), branch())),
    "phase_portrait": (3, lambda: ([branch().orbits[0]],)),
    "remedy_sizes": (1, lambda: (leak(),)),
    "rest_positions": (1, lambda: (leak(),)),
    "tasks": (3, lambda: (tuning().verification.tasks,)),
    "time_traces": (3, lambda: ([branch().orbits[0]],)),
}  # fmt: skip
"""By name: panels, and what is drawn."""
LONG = ("operating_point", "tasks", "remedy_sizes")
"""What shows a tuning, or a table of remedies, takes more than a second."""
NAMES = [pytest.param(name, marks=pytest.mark.slow if name in LONG else ()) for name in DRAWN]


def figure_for(name: str, panels: int) -> tuple[Figure, np.ndarray]:
    """A figure of the user's with the panels and one more."""
    figure = Figure()
    FigureCanvasAgg(figure)
    space = {"projection": "3d"} if name == "phase_portrait" else {}
    first = figure.add_subplot(1, panels + 1, 1, **space)
    rest = [figure.add_subplot(1, panels + 1, i) for i in range(2, panels + 2)]
    return figure, np.array([first, *rest], dtype=object)


def content(axes: Axes) -> list[tuple[str, Any]]:
    """What has been drawn: the data of every line, and how many things of other kinds there are."""
    points = [line.get_data_3d() if hasattr(line, "get_data_3d") else line.get_data() for line in axes.get_lines()]
    lines = [("line", np.array([np.asarray(x, float) for x in line]).tolist()) for line in points]
    return [*lines, ("others", len(axes.collections) + len(axes.patches)), ("label", axes.get_ylabel())]


def test_every_picture_is_tested():
    assert sorted([*DRAWN, "save"]) == pictures.__all__


@pytest.mark.parametrize("name", DRAWN)
def test_every_picture_takes_ax(name):
    """One name, by keyword, for one panel and for several."""
    taken = inspect.signature(getattr(pictures, name)).parameters
    assert taken["ax"].kind is inspect.Parameter.KEYWORD_ONLY and "axes" not in taken


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_is_drawn_into_the_axes_given(name):
    panels, what = DRAWN[name]
    draw, given = getattr(pictures, name), what()
    figure, all_of_them = figure_for(name, panels)
    mine, other = all_of_them[:panels], all_of_them[panels]
    one = not isinstance(own := draw(*given), np.ndarray)
    drawn = draw(*given, ax=mine[0] if one else mine)
    assert drawn is mine[0] if one else list(drawn) == list(mine)
    assert not other.has_data() and other.get_legend() is None and not figure.legends
    assert set(figure.axes) - set(all_of_them) == ({figure.axes[-1]} if name == "fold_map" else set())

    alone = np.ravel(np.asarray(own, dtype=object))[0].get_figure()
    assert alone is not figure and isinstance(alone, Figure)
    for a, b in zip(np.ravel(own), np.ravel(drawn), strict=True):
        assert str(content(a)) == str(content(b))
        assert a.has_data() or name == "phase_portrait"


@pytest.mark.parametrize("name", [name for name in NAMES if DRAWN[str(name.values[0])][0] > 1])
def test_too_few_axes_are_refused(name):
    panels, what = DRAWN[name]
    _, axes = figure_for(name, panels)
    with pytest.raises(InputError, match=f"must be {panels} matplotlib axes"):
        getattr(pictures, name)(*what(), ax=axes[: panels - 1])


def test_what_are_no_axes_is_refused():
    with pytest.raises(InputError, match="axes = 'here': must be matplotlib axes"):
        pictures.multipliers([branch()], ax="here")
    with pytest.raises(InputError, match="three dimensions"):
        pictures.phase_portrait([branch().orbits[0]], ax=Figure().subplots(3))


@pytest.mark.parametrize("words", [["--gain", "0.5"], ["--gain", "0.5", "--model", "lugre"]])
def test_the_picture_of_a_border_shows_its_motions(words, tmp_path, capsys):
    """The command writes it; its lines are the stick positions, its levels those of the two cycles."""
    assert main(["basin", *words, "--plot", str(tmp_path / "basin.png")]) == 0
    assert (tmp_path / "basin.png").stat().st_size > 10_000
    found = casahunt.basin(SERVO, words[-1] if len(words) > 2 else "switch", 0.5)
    outside, inside, border, cycle = (line.get_ydata() for line in pictures.basin(found).get_lines())
    assert list(outside) == list(found.outside.positions) and set(inside) <= set(found.inside.positions)
    assert border[0] == found.border < cycle[0] == found.outer_position


@pytest.mark.parametrize(("gain", "off"), [(0.8808, True), (0.04, False)])
def test_torque_can_be_read_beside_its_peak(gain, off):
    """At the first gain a step takes 28 N m, 0.53 N m hold the servo: the friction is a tenth of the panel at least."""
    found = casahunt.simulate(SERVO, "switch", gain, time=20.0)
    panel = pictures.motion(found)[2]
    low, high = panel.get_ylim()
    assert high - low < 10 * 2 * SERVO.friction.static
    said = [text.get_text() for text in panel.texts]
    assert said == ([f"off the scale, farthest: {found.peak_torque:.3g} N m"] if off else [])
    assert off or high > found.peak_torque


def test_hunting_can_be_seen_beside_the_step_that_it_follows():
    """It is a hundredth of a step of 1 rad: a tenth of the panel at least; without a step all is shown."""
    found = casahunt.simulate(SERVO, "switch", 0.2, time=200.0)
    above = pictures.motion(found)[0]
    low, high = above.get_ylim()
    assert found.verdict.amplitude < high - found.set_point < 10 * found.verdict.amplitude
    assert found.set_point - low == pytest.approx(high - found.set_point)
    assert [text.get_text() for text in above.texts] == ["off the scale, farthest: 0 rad"]
    resting = pictures.motion(casahunt.simulate(SERVO, "switch", 0.8808, time=200.0))[0]
    assert not resting.texts and resting.get_ylim()[0] < 0  # of rest to the last digit there is nothing to see
    start = {"position": found.set_point - found.verdict.amplitude}
    again = pictures.motion(casahunt.simulate(SERVO, "switch", 0.2, time=60.0, **start))[0]
    assert not again.texts


def test_the_jacobian_takes_two_axes():
    pair = Figure().subplots(1, 2)
    drawn = pictures.equilibria(casahunt.equilibria(SERVO, "lugre", 0.1), ax=pair)
    assert list(drawn) == list(pair) and all(ax.has_data() for ax in pair)


def test_subfigures_are_written_with_their_figure(tmp_path):
    figure = Figure()
    FigureCanvasAgg(figure)
    ax = figure.subfigures(1, 2)[0].subplots()
    pictures.save(pictures.multipliers([branch()], ax=ax), tmp_path / "both.png")
    assert (tmp_path / "both.png").stat().st_size > 1000


def test_there_is_nothing_else_in_the_module():
    with pytest.raises(AttributeError, match="no attribute 'draw'"):
        pictures.draw  # noqa: B018
    assert set(pictures.__all__) <= set(dir(pictures))


@pytest.mark.parametrize(("gain", "position", "whole"), [(0.8808, 0.0, False), (0.04, 0.0, True), (0.04, 0.9999, True)])
def test_the_time_axis_goes_to_where_something_happens(gain, position, whole):
    """A step at rest after 2 s of 100 is drawn so far, and the axis says it; of what is stuck and winds up, all."""
    found = casahunt.simulate(SERVO, "switch", gain, time=100.0, position=position)
    panels = pictures.motion(found)
    end, said = panels[0].get_xlim()[1], panels[2].get_xlabel()
    assert (end == pytest.approx(100.0)) == whole == (said == "time [s]")
    if not whole:
        slips = [event.time for event in found.events if event.name == "stop"]
        assert slips[0] < end < 5.0 and said.endswith("nothing more happens until 100 s")
        late = found.times[:-1] > end
        t, x = found.dense(4)
        assert late.any() and np.abs(x[0][t > end]).max() < 1e-3


def test_each_direction_of_viscous_friction_has_its_phase():
    """Both crossovers lie on a curve: that of a motion back lay beside the one that was drawn for both."""
    loop = Loop((INERTIA, BY_DIRECTION, PID_BY_TIMES, INTEGRATOR), {"viscous_back": 0.2})
    _, phase = pictures.bode(loop, [casahunt.linear_loop(loop, back=back) for back in (False, True)])
    curves = [line for line in phase.lines if np.size(line.get_xdata()) > 2]
    dots = [line for line in phase.lines if line.get_marker() == "o"]
    assert len(curves) == len(dots) == 2
    for dot in dots:
        beside = [np.interp(dot.get_xdata()[0], *curve.get_data()) - dot.get_ydata()[0] for curve in curves]
        assert np.abs(beside).min() < 0.1 and np.abs(beside).max() > 5
