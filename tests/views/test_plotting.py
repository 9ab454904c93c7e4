"""Pictures: computing makes none, every function draws into axes given or into its own, bad paths are refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import casahunt
from casahunt.continuation import Branch, SpecialPoint
from casahunt.errors import InputError
from casahunt.orbits.orbit import Orbit
from casahunt.servo.find_orbit import find_orbit
from casahunt.servo.servo import Servo
from casahunt.views.pictures import plotting
from casahunt.views.pictures.branches import _curves, diagram, multipliers
from casahunt.views.pictures.orbits import DRAWN_POINTS, phase_portrait, rolled, time_traces

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def switch() -> list[Orbit]:
    """Switch cycles along the branch: three stable ones and, behind the fold, an unstable one."""
    stable = [find_orbit(Servo(), "switch", gain) for gain in (0.1, 0.3, 0.6)]
    return [*stable, find_orbit(Servo(), "switch", 0.6, branch="unstable")]


@pytest.fixture(scope="module")
def fold() -> Orbit:
    """A cycle next to the fold, K = 0.6473."""
    return find_orbit(Servo(), "switch", 0.647)


@pytest.fixture(scope="module")
def lugre() -> list[Orbit]:
    return [find_orbit(Servo(), "lugre", gain) for gain in (0.3, 0.6)]


@pytest.fixture(scope="module")
def branches(switch: list[Orbit], fold: Orbit, lugre: list[Orbit]) -> list[Branch]:
    special = (
        SpecialPoint("fold", fold, "the largest gain with a cycle", behind=switch[2]),
        SpecialPoint("of my own", switch[1], "a user's function is zero"),
    )
    return [
        Branch("gain", tuple(switch), special),
        Branch("gain", tuple(lugre)),
    ]


def check_figure(drawn: Any, folder: Path) -> None:
    assert isinstance(plotting.figure_of(drawn), Figure)
    path = folder / "picture.png"
    plotting.save(drawn, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 10_000  # an empty page of this size takes less


def line_styles(axes: Any) -> set[str]:
    return {line.get_linestyle() for line in axes.get_lines() if line.get_linestyle() != "None"}


def test_computing_makes_no_figure() -> None:
    code = (
        "import sys\n"
        "from casahunt.servo.find_orbit import find_orbit\n"
        "from casahunt.servo.servo import Servo\n"
        "find_orbit(Servo(), 'switch', 0.4)\n"
        "assert 'matplotlib' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_drawing_needs_no_pyplot() -> None:
    code = "import sys, casahunt.views.pictures.plotting\nassert 'matplotlib.pyplot' not in sys.modules\n"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("equilibria", [True, False])
def test_diagram(branches: list[Branch], tmp_path: Path, equilibria: bool) -> None:
    above, below = diagram(branches, equilibria=equilibria)
    check_figure(above, tmp_path)
    assert above.figure is below.figure
    notes = [text.get_text() for text in above.texts]
    assert any("K = 0.647" in note for note in notes)
    assert any("equilibria" in note for note in notes) == equilibria
    assert line_styles(above) == {"-", "--"}


def test_each_fold_is_written_down_once_and_within_the_picture(branches: list[Branch]) -> None:
    """A lopsided pair has its folds twice; labels were cut off at the right edge."""
    above, _ = diagram([*branches, *branches])
    above.figure.canvas.draw()
    notes = [text for text in above.texts if "fold" in text.get_text()]
    assert notes and len({text.get_text().split("=")[1] for text in notes}) == len(notes)
    frame = above.get_window_extent()
    for text in notes:
        box = text.get_window_extent()
        assert frame.x0 <= box.x0 and box.x1 <= frame.x1 + 1


def test_diagram_of_one_orbit(switch: list[Orbit], tmp_path: Path) -> None:
    check_figure(diagram([Branch("gain", (switch[0],))]), tmp_path)


def test_multipliers(branches: list[Branch], tmp_path: Path) -> None:
    axes = multipliers(branches)
    check_figure(axes, tmp_path)
    low, high = axes.get_ylim()
    assert low < -1
    assert high > branches[0].half_multipliers.max()


def test_special_points_go_between_their_neighbours(branches: list[Branch], switch: list[Orbit], fold: Orbit) -> None:
    (curve, _) = _curves(branches)
    assert curve.orbits == [*switch[:3], fold, switch[3]]
    assert curve.kinds == ["", "of my own", "", "fold", ""]
    assert curve.runs() == [(True, slice(0, 4)), (False, slice(3, 5))]  # they share the fold


@pytest.mark.parametrize("pick", [lambda a, b: [a[0]], lambda a, b: [a[2], b[1]], lambda a, b: [a[2], a[3]]])
def test_time_traces_and_phase_portrait(
    switch: list[Orbit],
    lugre: list[Orbit],
    tmp_path: Path,
    pick: Callable[[list[Orbit], list[Orbit]], list[Orbit]],
) -> None:
    orbits = pick(switch, lugre)
    traces = time_traces(orbits)
    assert len(traces) == (4 if any(o.model == "lugre" for o in orbits) else 3)
    check_figure(traces, tmp_path)
    portrait = phase_portrait(orbits)
    assert len(portrait) == 3
    check_figure(portrait, tmp_path)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_rolled_period(switch: list[Orbit], lugre: list[Orbit], model: str) -> None:
    orbit = switch[0] if model == "switch" else lugre[0]
    times, states = rolled(*orbit.sample(DRAWN_POINTS))
    assert np.all(np.diff(times) >= 0)
    assert times[-1] - times[0] == pytest.approx(orbit.period, rel=1e-12)
    assert states[:, 0] == pytest.approx(states[:, -1])
    # Zero within the linear interpolation between neighbouring samples.
    before = int(np.searchsorted(times, 0.0)) - 1
    assert np.interp(0.0, times, states[0]) == pytest.approx(0, abs=1e-6 * orbit.amplitude)
    assert states[0, before - 1] < 0 < states[0, before + 2]


def test_labels_and_panels_of_fixed_places_keep_apart(branches: list[Branch], switch: list[Orbit]) -> None:
    """What a layout would measure, measured: no text leaves the figure, legend and panels do not meet."""
    narrow = [Branch("gain", tuple(branches[0].orbits[:1])), casahunt.diagram(Servo(), "switch", start=0.645)]
    diagrams = [diagram(some) for some in (branches, narrow[:1], narrow[1:])]
    for drawn in (*diagrams, multipliers(branches), time_traces(switch[:2]), phase_portrait(switch[:2])):
        figure = plotting.figure_of(drawn)
        plotting.drawn(figure)
        (legend,) = figure.legends
        boxes = [ax.get_tightbbox() for ax in figure.axes]
        whole = figure.bbox
        for box in [*boxes, legend.get_window_extent()]:
            assert whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 and box.y1 <= whole.y1
        flat = [box for box, ax in zip(boxes, figure.axes, strict=True) if ax.name != "3d"]
        assert all(box.y1 <= legend.get_window_extent().y0 for box in flat)
        assert all(not one.overlaps(other) for i, one in enumerate(flat) for other in flat[:i])
        for axis in (axis for ax in figure.axes if ax.name != "3d" for axis in (ax.xaxis, ax.yaxis)):
            numbers = [label for label in axis.get_ticklabels(which="both") if label.get_visible() and label.get_text()]
            label = axis.label.get_window_extent()
            assert not axis.label.get_text() or not any(label.overlaps(n.get_window_extent()) for n in numbers)


def test_labels_of_logarithmic_axes() -> None:
    axes = Figure().subplots()
    plotting.logarithmic(axes, "x")
    plotting.logarithmic(axes, "y", linear=1e-3)
    axes.set(xlim=(1.0, 5.0), ylim=(-10.0, 10.0))
    axes.get_tightbbox()  # which sets the places of the labels
    major, minor = axes.xaxis.get_major_formatter(), axes.xaxis.get_minor_formatter()
    signed = axes.yaxis.get_major_formatter()
    assert [major(10.0**k) for k in (-12, 0, 3)] == ["10⁻¹²", "10⁰", "10³"]
    assert [minor(value) for value in (2.0, 3.0)] == ["2×10⁰", "3×10⁰"]
    assert [signed(value) for value in (-0.1, 0.0, 10.0)] == ["−10⁻¹", "0", "10¹"]
    assert "$" not in "".join(label.get_text() for label in axes.get_xticklabels() + axes.get_yticklabels())


def test_nothing_to_draw_is_refused() -> None:
    for draw in (diagram, multipliers, time_traces, phase_portrait):
        with pytest.raises(InputError, match="at least one"):
            draw([])
    with pytest.raises(InputError, match="at least one"):
        diagram([Branch("gain", ())])


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("missing/picture.png", "no folder"),
        ("file/picture.png", "no folder"),
        ("folder.png", "cannot write"),
        ("picture.xyz", "suffix must be one of"),
        ("picture", "suffix must be one of"),
    ],
)
def test_bad_path_is_refused(switch: list[Orbit], tmp_path: Path, name: str, complaint: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(InputError, match=complaint):
        plotting.save(time_traces(switch[:1]), tmp_path / name)


def test_other_suffixes(switch: list[Orbit], tmp_path: Path) -> None:
    path = tmp_path / "picture.SVG"
    plotting.save(time_traces(switch[:1]), path)
    assert "<svg" in path.read_text()
