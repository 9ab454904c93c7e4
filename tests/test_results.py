"""What results become outside, read back by the csv, json and pandas of others, against their own attributes."""

from __future__ import annotations

import csv
import json
import math
import sys
from functools import cache
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import casahunt
from casahunt import InputError, Servo, Status, pictures
from casahunt.continuation import SpecialPoint, branch_off, follow, smallest, special_curve
from casahunt.export import extra, plain
from casahunt.hybrid.examples import ball, belt
from casahunt.motion import simulate
from casahunt.orbits import find_cycle, orbit_ensemble
from casahunt.results import Result, tables_of
from casahunt.servo.outcome import Outcome

SERVO, SWITCH = Servo(), "switch"
STATIC = casahunt.Uncertainty({"friction.static": (0.525, 0.535)})


@cache
def bouncing():
    return find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)


@cache
def flips():
    (flip,) = follow(bouncing(), "a", to=0.05).special
    return flip


MADE: dict[str, Any] = {
    "orbit": lambda: casahunt.find_orbit(SERVO, SWITCH, 0.1),
    "fold": lambda: casahunt.find_fold(SERVO, SWITCH),
    "branch": lambda: casahunt.diagram(SERVO, SWITCH, start=0.6),
    "special": lambda: made("branch").special[-1],
    "multipliers": lambda: made("orbit").multipliers,
    "trajectory": lambda: casahunt.simulate(SERVO, SWITCH, 0.04, time=20.0),
    "bristles": lambda: casahunt.simulate(SERVO, "lugre", 0.04, time=3.0),
    "verdict": lambda: made("trajectory").verdict,
    "happening": lambda: made("trajectory").events[0],
    "loop": lambda: casahunt.linear_loop(SERVO, 0.1),
    "margins": lambda: casahunt.margins(SERVO, 0.1),
    "equilibria": lambda: casahunt.equilibria(SERVO, SWITCH, 0.1),
    "fixed points": lambda: casahunt.fixed_points(SERVO, 0.6, 1e-3, 3e-3, points=10),
    "basin": lambda: casahunt.basin(SERVO, SWITCH, 0.5),
    "fold curve": lambda: casahunt.fold_curve(SERVO, SWITCH, vary="friction.static", start=0.53, end=0.54, points=2),
    "fold map": lambda: casahunt.fold_map(
        SERVO, SWITCH, ("friction.static", "friction.coulomb"), np.array([0.5, 0.53]), np.array([0.44, 0.51]),
        fold=made("fold"),
    ),
    "sensitivities": lambda: casahunt.fold_sensitivities(made("fold")),
    "samples": lambda: casahunt.sample_fold_gains(SERVO, SWITCH, STATIC, 4, fold=made("fold")),
    "worst": lambda: casahunt.worst_corner(SERVO, SWITCH, STATIC, fold=made("fold")),
    "summary": lambda: casahunt.compare_uncertainty(made("fold"), STATIC, made("samples"), made("worst")),
    "fold ensemble": lambda: casahunt.fold_ensemble(
        SERVO, SWITCH, ["friction.static"], [[0.53], [0.54]], fold=made("fold"), elasticities=True
    ),
    "orbit ensemble": lambda: casahunt.orbit_ensemble(
        SERVO, SWITCH, 0.1, ["friction.viscous"], [[0.1], [0.12]], orbit=made("orbit")
    ),
    "record": lambda: made("measurement").record,
    "measurement": lambda: casahunt.measure(casahunt.simulate(SERVO, SWITCH, 0.04, time=60.0)),
    "motion": lambda: simulate(belt, "slip", x=0.0, v=0.0, duration=5.0),
    "system orbit": lambda: find_cycle(belt, "slip", x=0.0, v=0.0),
    "arc": lambda: made("system orbit").arcs[0],
    "extrema": lambda: made("system orbit").extrema("x"),
    "system branch": lambda: follow(bouncing(), "a", to=0.05),
    "system fold": lambda: smallest(bouncing(), "a"),
    "curve": lambda: special_curve(flips(), "a", "r", to=0.78, points=2),
    "twice": lambda: branch_off(flips(), "a"),
    "balls": lambda: orbit_ensemble(bouncing(), ["r"], [[0.79], [0.81]], multipliers=True),
    "tuning": lambda: casahunt.tune(SERVO, SWITCH),
}  # fmt: skip
TABLES = {
    "orbit": ("time_s", lambda r: r.sample()[0]),
    "branch": ("gain", lambda r: [orbit.gain for orbit, _ in r.along()]),
    "trajectory": ("position_rad", lambda r: r.set_point + r.dense()[1][0]),
    "bristles": ("bristle_rad", lambda r: r.dense()[1][3]),
    "fixed points": ("stick_position_rad", lambda r: [point.amplitude for point in r.fixed]),
    "loop": ("kd_Nms_per_rad", lambda r: [r.kd]),
    "equilibria": ("integral_limit_rad_s", lambda r: [r.integral_limit]),
    "basin": ("stick_position_rad", lambda r: [*r.inside.positions, *r.outside.positions]),
    "fold curve": ("gain", lambda r: r.gains),
    "fold map": ("gain", lambda r: r.gains.ravel()),
    "sensitivities": ("elasticity", lambda r: list(r.elasticities.values())),
    "samples": ("fold_gain_V_per_rad", lambda r: r.gains),
    "fold ensemble": ("elasticity of friction.static", lambda r: r.elasticities[:, 0]),
    "orbit ensemble": ("amplitude", lambda r: r.amplitudes),
    "record": ("position_rad", lambda r: r.position),
    "measurement": ("amplitude_rad", lambda r: r.amplitudes),
    "motion": ("x", lambda r: r.sample()[1][0]),
    "system orbit": ("v", lambda r: r.sample()[1][1]),
    "system branch": ("period", lambda r: [orbit.period for orbit, _ in r.along()]),
    "curve": ("slope", lambda r: r.slopes),
    "twice": ("t", lambda r: r.sample()[0]),
    "balls": ("multiplier_real", lambda r: r.multipliers.real),
}
"""By result: a column of its table, and where the numbers come from."""


RESULTS = [pytest.param(name, marks=pytest.mark.slow if name == "tuning" else ()) for name in MADE]
"""A tuning takes more than a second."""


@cache
def made(name: str) -> Any:
    return MADE[name]()


def assert_same(given: Any, attribute: Any) -> None:
    """A value of plain Python against the attribute that it comes from."""
    if given is None and attribute == "" or isinstance(attribute, Outcome):  # no sentence; the verdict in a word
        assert given == getattr(attribute, "kind", None)
    elif isinstance(attribute, Status):
        assert given == attribute.name.lower()
    elif isinstance(attribute, float) and not math.isfinite(attribute):
        assert given is None
    elif isinstance(attribute, complex):
        assert complex(*given) == attribute
    elif isinstance(attribute, np.ndarray | list | tuple) and not isinstance(given, dict):
        assert len(given) == len(attribute)
        for one, other in zip(given, attribute, strict=True):
            assert_same(one, other)
    elif given is None or isinstance(given, bool | int | float | str):
        assert given == attribute and isinstance(given, bool) == isinstance(attribute, bool | np.bool_)


@pytest.mark.parametrize("name", RESULTS)
def test_one_line(name):
    result = made(name)
    text = repr(result)
    assert "\n" not in text and text.startswith("<") and text.endswith(">") and len(text) < 500
    assert "object at" not in text and "array(" not in text


@pytest.mark.parametrize("name", RESULTS)
def test_the_mapping_holds_the_attributes(name):
    result = made(name)
    mapping = result.to_dict()
    assert mapping == json.loads(json.dumps(mapping, allow_nan=False))
    assert mapping["type"] == type(result).__name__
    checked = 0
    for key, value in mapping.items():
        if key not in ("type", "table", "problem") and hasattr(result, key):
            attribute = getattr(result, key)
            assert_same(value, attribute() if callable(attribute) else attribute)
            checked += 1
    assert checked >= min(2, len(result.quantities()))
    for quantity in result.quantities():
        assert quantity.name in mapping


class Cells(HTMLParser):
    """The texts of the cells of a table."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.cells: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        if tag == "td":
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1] == "td":
            self.cells[-1] += data


@pytest.mark.parametrize("name", RESULTS)
def test_the_notebook_table(name):
    parser = Cells()
    parser.feed(made(name)._repr_html_())
    assert not parser.open and len(parser.cells) % 4 == 0
    rows = {row[0]: row[1:] for row in zip(*[iter(parser.cells)] * 4, strict=True)}
    for quantity in made(name).quantities():
        if isinstance(quantity.value, float) and math.isfinite(quantity.value):
            shown, error, unit = rows[quantity.name.replace("_", " ")]
            known = quantity.error if quantity.error and math.isfinite(quantity.error) else 1e-5 * abs(quantity.value)
            assert abs(float(shown) - quantity.value) <= 1.01 * known + 1e-11 * abs(quantity.value)
            assert unit == quantity.unit and bool(error) == (quantity.error is not None)


@pytest.mark.parametrize("name", RESULTS)
def test_files_are_read_back(name, tmp_path):
    result = made(name)
    result.to_json(tmp_path / "r.json")
    assert json.loads((tmp_path / "r.json").read_text(encoding="utf-8")) == result.to_dict()
    result.to_csv(tmp_path / "r.csv")
    with (tmp_path / "r.csv").open(newline="") as stream:
        head, *rows = list(csv.reader(stream))
    if name not in TABLES:
        assert head == ["quantity", "value", "error", "unit"]
        numbers = {q.name: q.value for q in result.quantities() if isinstance(q.value, float)}
        read = {row[0]: float(row[1]) for row in rows if row[0] in numbers}
        assert read.keys() == numbers.keys()
        assert all(read[key] == value or math.isnan(value) for key, value in numbers.items())
        return
    column, truth = TABLES[name]
    np.testing.assert_array_equal([float(row[head.index(column)]) for row in rows], truth(result))
    table = result.to_dict()["table"]
    assert list(table) == head and {len(values) for values in table.values()} == {len(rows)}
    expected = [None if math.isnan(x) else x for x in map(float, truth(result))]
    assert table[column] == expected


@pytest.mark.parametrize("name", TABLES)
def test_the_table_as_a_dataframe(name):
    pandas = pytest.importorskip("pandas")
    column, truth = TABLES[name]
    frame = made(name).to_dataframe()
    assert isinstance(frame, pandas.DataFrame) and frame[column].dtype == float
    np.testing.assert_array_equal(frame[column].to_numpy(), truth(made(name)))


def test_dataframe_of_what_is_no_table():
    pytest.importorskip("pandas")
    frame = made("fold").to_dataframe().set_index("quantity")
    assert frame.loc["gain", "value"] == made("fold").gain and frame.loc["gain", "unit"] == "V/rad"
    assert frame.loc["gain", "error"] == pytest.approx(made("fold").gain * made("fold").gain_error, rel=1e-14)


def test_an_extra_that_is_not_installed(monkeypatch):
    for known in [key for key in sys.modules if key.split(".")[0] == "pandas"]:
        monkeypatch.delitem(sys.modules, known)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"needs pandas, which is not installed.*casahunt\[pandas\]"):
        made("fold").to_dataframe()


def test_an_extra_that_is_installed():
    assert extra("json", "any", "to_any") is json


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    for write in ("to_csv", "to_json"):
        with pytest.raises(InputError, match="cannot write"):
            getattr(made("fold"), write)(tmp_path / "none" / "file")
    path = tmp_path / "r.json"
    path.write_text("before")
    monkeypatch.setattr("casahunt.results.json.dumps", lambda *a, **k: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        made("fold").to_json(path)
    assert path.read_text() == "before"


class Loose(Result):
    """A result of a test's own."""

    _quantities = (
        "exact ~ nothing", "known ~ close", "guess", "absolute [m] +- half", "lost ~ infinite", "below +- half",
    )  # fmt: skip
    _details = ("word", "far = other.known [m]", "gone = absent.known [m]", "count = many.size", "z +- small")

    def __init__(self, other: Any = None) -> None:
        self.exact, self.nothing = 0.1, 0.0
        self.known, self.close = 1 / 3, 1e-4
        self.guess, self.absolute, self.half, self.below = 2 / 3, 12.3456, 0.5, 0.1
        self.lost, self.infinite, self.word = 1.23456, math.inf, "<b>&\"bold\"</b>\nline"
        self.other, self.absent, self.many = other, None, (1, 2, 3)
        self.z, self.small = 1 / 3 + 2j / 3, 1e-3


def test_digits_are_those_that_the_error_vouches_for():
    said = {q.name: (q.text, q.error, q.unit) for q in Loose(Loose()).quantities()}
    assert said["exact"] == ("0.1", 0.0, "")
    assert said["known"][0] == "0.33333" and said["known"][1] == pytest.approx(1e-4 / 3)  # not 0.333333
    assert said["guess"][0] == "0.666667" and said["guess"][1] is None
    assert said["absolute"] == ("12", 0.5, "m")
    assert said["lost"] == ("1.23", math.inf, "")
    assert said["below"][0] == "0"  # smaller than its error
    assert said["far"] == ("0.333333", None, "m") and said["gone"] == ("None", None, "")
    assert said["count"] == ("3", None, "")
    assert said["z"][0] == "0.333+0.667j"
    assert repr(Loose()) == (
        "<Loose: exact 0.1, known 0.33333, guess 0.666667, absolute 12 m, lost 1.23, below 0>"
    )


def test_html_is_escaped_and_short():
    page = Loose(Loose())._repr_html_()
    assert "<b>" not in page and "&lt;b&gt;&amp;&quot;bold&quot;&lt;/b&gt;" in page
    assert len(SpecialPoint("fold", None, "a" * 1000, at=1.0)._repr_html_()) < 600  # a line a field


def test_numbers_that_are_none_are_null():
    assert plain([math.nan, math.inf, 1.0, np.float32(0.5), np.int64(3), np.True_]) == [None, None, 1.0, 0.5, 3, True]
    assert plain({(0, 1): 2.0}) == [[[0, 1], 2.0]] and plain({"a": {1.5}.pop()}) == {"a": 1.5}
    assert plain(math.inf, strict=False) == math.inf
    with pytest.raises(TypeError, match="cannot be exported"):
        plain(object())
    assert Loose().to_dict()["infinite"] is None and Loose().to_dict(strict=False)["infinite"] == math.inf


def test_nested_results_leave_their_tables_at_home():
    mapping = made("special").to_dict()
    assert mapping["orbit"]["gain"] == made("special").orbit.gain and "table" not in mapping["orbit"]
    assert "table" in made("special").orbit.to_dict() and "table" not in made("orbit").to_dict(table=False)


def test_tables_stand_one_below_the_other():
    loops = [casahunt.linear_loop(SERVO, gain) for gain in (0.1, 0.2)]
    table = tables_of(loops)
    assert table["gain_V_per_rad"] == [0.1, 0.2] and table["stable"] == [True, True]
    assert table["pole_1_re_per_s"] == [loop.poles[0].real for loop in loops] and tables_of([]) == {}


@pytest.mark.parametrize("name", ["branch", "trajectory", "orbit", "system orbit"])
def test_what_has_a_table_is_drawn_without_arguments(name, tmp_path):
    """Into a figure of its own, which can be saved."""
    ax = made(name).plot()
    columns = list(made(name)._columns())
    assert [ax.get_xlabel(), ax.get_ylabel()] == columns[:2] and len(ax.get_lines()) == 1
    pictures.save(ax, tmp_path / "drawn.png")
    assert made(name).plot().figure is not ax.figure


def test_the_frequency_of_an_orbit():
    orbit = made("orbit")
    assert orbit.frequency * orbit.period == pytest.approx(1, rel=1e-15)
    quantity = next(q for q in orbit.quantities() if q.name == "frequency")
    assert quantity.unit == "Hz" and quantity.error == pytest.approx(orbit.frequency * orbit.period_error)


def test_a_servo_is_a_table_in_a_notebook():
    parser = Cells()
    servo = casahunt.Servo(inertia=0.05, controller=casahunt.Pid(kp=1.0, ki=2.0, kd=0.1))
    parser.feed(servo._repr_html_())
    rows = {key: said for key, *said in zip(*[iter(parser.cells)] * 3, strict=True)}
    assert rows["servo.inertia"] == ["0.05", "kg m2"] and rows["controller.kp"] == ["1", ""]
    assert rows["friction.static"] == ["0.53", "N m"] and not parser.open


def test_a_table_is_drawn():
    ax = Figure().subplots()
    assert made("branch").plot(ax=ax, color="k") is ax
    x, y = ax.get_lines()[0].get_data()
    np.testing.assert_array_equal(x, [orbit.gain for orbit, _ in made("branch").along()])
    np.testing.assert_array_equal(y, [orbit.amplitude for orbit, _ in made("branch").along()])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("gain", "amplitude_rad")
    made("trajectory").plot("time_s", "torque_Nm", ax=ax)
    np.testing.assert_array_equal(ax.get_lines()[1].get_xdata(), made("trajectory").dense()[0])
    for across, up in (("time", "torque_Nm"), ("time_s", "mode")):
        with pytest.raises(InputError, match="column"):
            made("trajectory").plot(across, up, ax=ax)
    with pytest.raises(InputError, match="column"):
        made("fold").plot(ax=ax)


def test_a_line_computes_nothing():
    """Multipliers and verdicts are computed when they are read, which a line is not to do."""
    orbit = casahunt.find_orbit(SERVO, SWITCH, 0.1)
    orbit.__dict__.pop("multipliers", None)
    motion = casahunt.simulate(SERVO, SWITCH, 0.04, time=5.0)
    assert repr(orbit) and repr(motion) and orbit._repr_html_()
    assert "multipliers" not in vars(orbit) and "verdict" not in vars(motion)
