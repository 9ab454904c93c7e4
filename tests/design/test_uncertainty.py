"""Uncertain parameters: against folds computed one by one, exact symmetries, and each other."""

from __future__ import annotations

import json
import math
import multiprocessing
import re
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from casahunt import InputError, NoOrbit, Options, Servo, cli, find_fold
from casahunt.design import ensemble, nearby
from casahunt.design.nearby import fold_beside
from casahunt.design.sensitivity import fold_sensitivities
from casahunt.design.uncertainty import worst_corner as search
from casahunt.design.uncertainty.samples import draw, sample
from casahunt.design.uncertainty.set import Uncertainty, load_uncertainty
from casahunt.design.uncertainty.summary import linear_gains, linear_moments, linear_range, summary
from casahunt.design.uncertainty.worst_corner import WorstCase, worst_corner
from casahunt.errors import Status
from casahunt.views.commands import remedies as remedies_command
from casahunt.views.commands import tune as tune_command
from casahunt.views.commands import uncertainty as uncertainty_command
from problems import table1

EXAMPLE = Path(table1.__file__).with_name("table1_uncertainty.toml")
FRICTION = Uncertainty({"friction.static": (0.52, 0.54), "friction.coulomb": (0.435, 0.445)})
PAIR = ("friction.static", "friction.coulomb")
SQUARE = Uncertainty(dict.fromkeys(PAIR, (0.40, 0.46)))
"""Half of which is no servo."""
QUICK = Options(tol=1e-6)


@pytest.fixture(scope="module")
def servo():
    return table1.servo()


@pytest.fixture(scope="module")
def fold(servo):
    return find_fold(servo, "switch", options=QUICK)


@pytest.fixture(scope="module")
def eleven(servo, fold):
    """More samples than a task holds, not a multiple of it."""
    return sample(servo, "switch", FRICTION, 11, options=QUICK, fold=fold)


def gain_at(servo, names, q):
    return find_fold(servo.replace(**dict(zip(names, map(float, q), strict=True))), "switch", options=QUICK).gain


# The linear answer


def test_linear_interval_and_moments(fold):
    """The box of an exact symmetry: K depends on Fs and Fc through Fs - Fc only, so dK/dFc = -dK/dFs."""
    slope = fold_sensitivities(fold).derivatives["friction.static"]
    low, high = linear_range(fold, FRICTION)
    assert low == pytest.approx(fold.gain - 0.015 * slope, rel=1e-6)
    assert high == pytest.approx(fold.gain + 0.015 * slope, rel=1e-6)
    # A sum of two uniform distributions.
    mean, std = linear_moments(fold, FRICTION)
    assert mean == pytest.approx(fold.gain, rel=1e-6)
    assert std == pytest.approx(slope * np.hypot(0.02, 0.01) / np.sqrt(12), rel=1e-6)


def test_linear_covariance(fold):
    """Fs and Fc that move together leave the fold where it is."""
    slope = fold_sensitivities(fold).derivatives["friction.static"]
    together = Uncertainty(names=PAIR, covariance=1e-6 * np.ones((2, 2)))
    assert linear_moments(fold, together) == pytest.approx((fold.gain, 0.0), abs=1e-6)
    apart = Uncertainty(names=PAIR, covariance=1e-6 * np.eye(2), sigmas=2)
    mean, std = linear_moments(fold, apart)
    assert (mean, std) == pytest.approx((fold.gain, 1e-3 * slope * np.sqrt(2)), rel=1e-6)
    assert linear_range(fold, apart) == pytest.approx((mean - 2 * std, mean + 2 * std))


def test_intervals_off_the_servo(fold):
    """An interval need not hold the servo's own value."""
    slope = fold_sensitivities(fold).derivatives["friction.static"]
    off = Uncertainty({"friction.static": (0.54, 0.56)})
    assert linear_range(fold, off) == pytest.approx((fold.gain + 0.01 * slope, fold.gain + 0.03 * slope))
    middle, width = fold.gain + 0.02 * slope, 0.02 * abs(slope)
    assert linear_moments(fold, off) == pytest.approx((middle, width / np.sqrt(12)), rel=1e-12)
    assert linear_gains(fold, ["friction.static"], np.array([[0.55]])) == pytest.approx(middle, rel=1e-12)


# Samples


def test_samples_are_folds(servo, eleven):
    """Computed from a predicted gain, each agrees with the fold found from nothing but the servo."""
    assert not eleven.failures
    for i in (0, 10):
        assert eleven.gains[i] == pytest.approx(gain_at(servo, PAIR, eleven.parameters[i]), rel=2 * QUICK.tol)


def test_draws(servo):
    rows = draw(servo, FRICTION, 1000, seed=3)
    assert np.array_equal(rows[:7], draw(servo, FRICTION, 7, seed=3))
    assert not np.array_equal(rows, draw(servo, FRICTION, 1000, seed=4))
    low, high = FRICTION.box(servo)
    assert (low <= rows).all() and (rows <= high).all()
    covariance = np.array([[4e-6, 3e-6], [3e-6, 4e-6]])
    normal = draw(servo, Uncertainty(names=PAIR, covariance=covariance), 20000)
    # Standard errors of a mean and of a covariance from n samples: std/sqrt(n), sqrt(2/n) of it; four of them.
    assert normal.mean(axis=0) == pytest.approx([0.53, 0.44], abs=4 * 2e-3 / np.sqrt(20000))
    assert np.cov(normal.T) == pytest.approx(covariance, abs=4 * 4e-6 * np.sqrt(2 / 20000))
    singular = draw(servo, Uncertainty(names=PAIR, covariance=1e-6 * np.ones((2, 2))), 5)
    assert singular[:, 0] - singular[:, 1] == pytest.approx(0.09, abs=1e-12)


def test_what_is_no_servo_is_left_out_of_the_draws(servo):
    """Half of a square of static and Coulomb friction, 0.4 to 0.46 N m, is: a triangle, its mean at two thirds and one
    third of the way, with a standard deviation of a side over sqrt(18)."""
    rows = draw(servo, SQUARE, 5000, seed=1)
    assert (rows[:, 0] >= rows[:, 1]).all() and np.array_equal(rows[:9], draw(servo, SQUARE, 9, seed=1))
    assert rows.mean(axis=0) == pytest.approx([0.44, 0.42], abs=4 * 0.06 / np.sqrt(18 * 5000))
    alone = draw(servo, Uncertainty({"friction.static": (0.40, 0.53)}), 5000)[:, 0]  # Coulomb friction is 0.44
    assert alone.min() >= 0.44 and alone.mean() == pytest.approx(0.485, abs=4 * 0.09 / np.sqrt(12 * 5000))


@pytest.mark.parametrize(("intervals", "said"), [
    (SQUARE.intervals, True),
    ({"friction.static": (0.40, 0.53)}, True), ({"friction.static": (0.45, 0.53)}, False),
    ({"friction.coulomb": (0.40, 0.54)}, True), ({"friction.coulomb": (0.40, 0.53)}, False),
    ({"friction.viscous": (0.1, 0.9)}, False),
])  # fmt: skip
def test_every_command_says_what_it_leaves_out(tmp_path, capsys, monkeypatch, intervals, said):
    """It was refused by the one, where a sample was no servo, and verified by the other."""

    def stops(*given, **how):
        raise NoOrbit("as far as here", Status.NOT_CONVERGED)

    for module, name in ((uncertainty_command, "find_fold"), (tune_command, "tune"), (remedies_command, "remedies")):
        monkeypatch.setattr(module, name, stops)
    path = tmp_path / "friction.toml"
    path.write_text("[interval]\n" + "".join(f'"{key}" = {list(ends)}\n' for key, ends in intervals.items()))
    for command in (["uncertainty"], ["tune"], ["remedies", "--gain", "0.1"]):
        assert cli.main([*command, "--uncertainty", str(path)]) == 1
        err = capsys.readouterr().err
        assert ("the part with friction.static below friction.coulomb is left out" in err) is said
        assert "as far as here" in err


class Backwards(Executor):
    """Runs what it is given in reverse order, as a cluster might."""

    def submit(self, fn, /, *args, **kwargs):
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future

    def map(self, fn, *iterables, timeout=None, chunksize=1):
        tasks = list(zip(*iterables, strict=True))
        return reversed([fn(*task) for task in reversed(tasks)])


def test_order_does_not_matter(servo, fold, eleven):
    again = sample(servo, "switch", FRICTION, 11, executor=Backwards(), options=QUICK, fold=fold)
    assert np.array_equal(again.parameters, eleven.parameters)
    assert np.array_equal(again.gains, eleven.gains)


def test_local_processes(servo, fold, eleven):
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        again = sample(servo, "switch", FRICTION, 11, executor=pool, options=QUICK, fold=fold)
    assert np.array_equal(again.gains, eleven.gains)


def test_threads(servo, fold, eleven):
    with ThreadPoolExecutor(4) as pool:
        again = sample(servo, "switch", FRICTION, 11, executor=pool, options=QUICK, fold=fold)
    assert np.array_equal(again.gains, eleven.gains)


# Dask leaves sockets and loops to the garbage collector when its cluster closes.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 4])
def test_dask(servo, fold, eleven, threads):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=threads, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        again = sample(servo, "switch", FRICTION, 11, executor=client.get_executor(), options=QUICK, fold=fold)
    assert np.array_equal(again.gains, eleven.gains)


def test_a_servo_that_cannot_hunt_has_no_gain(servo, fold):
    """Pure Coulomb friction (Bisoffi et al.): no cycle at any gain."""
    coulomb = Uncertainty({"friction.static": (0.44, 0.44)})
    samples = sample(servo, "switch", coulomb, 1, options=QUICK, fold=fold)
    assert samples.gains.tolist() == [0.0] and not samples.failures
    worst = worst_corner(servo, "switch", coulomb, options=QUICK, fold=fold)
    assert worst.gain == 0 and worst.fold is None and worst.corner == {"friction.static": 0.44}
    assert "1 of 1 samples cannot hunt at all" in summary(fold, coulomb, samples, worst).misleading


def test_failures_are_kept(servo, fold, monkeypatch):
    def fails(*_, **__):
        raise NoOrbit("no convergence here", Status.NOT_CONVERGED)

    # No servo of a sensible box is known whose fold is not found.
    monkeypatch.setattr(nearby, "find_fold", fails)
    monkeypatch.setattr(ensemble, "known_fold", lambda *_: None)  # there is nothing to predict from
    samples = sample(servo, "switch", FRICTION, 2, options=QUICK, fold=fold)
    assert np.isnan(samples.gains).all() and samples.worst is None and samples.quantiles() == {}
    assert samples.failures == ((0, "no convergence here"), (1, "no convergence here"))
    off = Uncertainty({"friction.static": (0.54, 0.56)})
    with pytest.raises(NoOrbit, match="no convergence here"):
        worst_corner(servo, "switch", off, options=QUICK, fold=fold)


# The worst corner


def test_a_worst_servo_whose_fold_is_given_up_is_not_another_one(servo, fold, monkeypatch):
    """The corner of a wide box, where slips are short; named is the interval to narrow."""
    monkeypatch.setattr(search, "MOST_WORK_OF_A_FOLD", {"switch": 100.0})
    wide = Uncertainty({"friction.static": (0.52, 0.54), "friction.stribeck_velocity": (0.002, 0.1)})
    with pytest.raises(NoOrbit, match="not found: 1 of . folds .* at .*work of .*of friction.stribeck_vel"):
        worst_corner(servo, "switch", wide, options=QUICK, fold=fold)


def test_a_search_among_folds_that_are_not_computed_ends(servo, fold, monkeypatch):
    """Patched: of two masses that hunt irregularly each takes seconds.  It says how many, and names no corner."""
    asked = []

    def none(*_):
        asked.append(1)
        raise NoOrbit("hunts irregularly", Status.NOT_FOUND)

    monkeypatch.setattr(search, "fold_near", none)
    honest = search.folds_near

    def only_up_to(known, p, tol, *, slopes_by):
        found = honest(known, p, tol, slopes_by=slopes_by)
        far = p[:, known.problem.names.index("friction.static")] > 0.525
        return replace(found, how=tuple("" if no else how for no, how in zip(far, found.how, strict=True)))

    monkeypatch.setattr(search, "folds_near", only_up_to)
    with pytest.raises(NoOrbit, match=f"{search.MOST_FAILED_FOLDS} of .* folds were not computed, the last one at"):
        worst_corner(servo, "switch", Uncertainty({"friction.static": (0.52, 0.54)}), options=QUICK, fold=fold)
    assert len(asked) <= search.MOST_FAILED_FOLDS + 2


def test_worst_corner_of_a_monotone_box(servo, fold):
    """K falls with vs (exactly: through (Fs - Fc)/vs) and grows with Fs: the corner is known."""
    box = Uncertainty({"friction.static": (0.52, 0.54), "friction.stribeck_velocity": (0.019, 0.021)})
    worst = worst_corner(servo, "switch", box, options=QUICK, fold=fold)
    assert worst.corner == {"friction.static": 0.54, "friction.stribeck_velocity": 0.019}
    assert worst.gain == pytest.approx(gain_at(servo, box.parameters, [0.54, 0.019]), rel=2 * QUICK.tol)
    assert worst.evaluations <= 4 and not worst.failures
    assert worst.servo.friction.static == 0.54


@pytest.mark.slow
def test_a_batch_does_not_decide_on_the_worst_corner(servo, fold, monkeypatch):
    """What a batch says of the corner that would be the worst is computed alone; here it lies about another one."""
    from casahunt.design.uncertainty import worst_corner as module

    box = Uncertainty({"friction.static": (0.52, 0.54), "friction.stribeck_velocity": (0.019, 0.021)})
    honest = module.folds_near

    def lies(known, p, tol, *, slopes_by):
        folds = honest(known, p, tol, slopes_by=slopes_by)
        far = p[:, known.problem.names.index("friction.stribeck_velocity")] > 0.02
        return replace(folds, values=np.where(far, 2.0, folds.values))

    # A batch confirms its folds: what guards against one that is wrong all the same needs one that is.
    monkeypatch.setattr(module, "folds_near", lies)
    worst = worst_corner(servo, "switch", box, options=QUICK, fold=fold, starts=[np.array([0.54, 0.021])])
    assert worst.corner == {"friction.static": 0.54, "friction.stribeck_velocity": 0.019}
    assert worst.gain == pytest.approx(gain_at(servo, box.parameters, [0.54, 0.019]), rel=2 * QUICK.tol)


def test_a_worst_corner_where_a_parameter_is_zero(servo, fold):
    """No elasticity is a slope there."""
    worst = worst_corner(servo, "switch", Uncertainty({"friction.viscous": (0.0, 0.1)}), options=QUICK, fold=fold)
    assert worst.corner == {"friction.viscous": 0.0} and worst.gain > fold.gain
    up = worst_corner(
        servo, "switch", Uncertainty({"friction.viscous": (0.0, 0.1), "friction.static": (0.53, 0.54)}), options=QUICK,
        fold=fold, starts=[np.array([0.0, 0.53])],
    )  # fmt: skip
    assert up.corner == {"friction.viscous": 0.0, "friction.static": 0.54}


def test_a_worst_case_inside_the_box(servo, fold):
    """The fold gain has its largest value over the integral time near 0.15 s: no corner is the worst case.

    An independent search: the vertex of the parabola through three folds, 3 % apart.
    """
    name = "controller.integral_time"
    box = Uncertainty({name: (0.14, 0.18)})
    worst = worst_corner(servo, "switch", box, options=Options(tol=1e-5), fold=fold)
    at = worst.corner[name]
    assert 0.145 < at < 0.165
    x = at * np.array([0.97, 1.0, 1.03])
    curve = np.polyfit(x - at, [gain_at(servo, [name], [xi]) for xi in x], 2)
    assert curve[0] < 0
    # The parabola errs by the third derivative; what counts is the gain, second order in the place.
    assert -curve[1] / (2 * curve[0]) == pytest.approx(0, abs=0.01 * at)
    assert worst.gain >= np.polyval(curve, -curve[1] / (2 * curve[0])) * (1 - 1e-5)


def test_static_stays_above_coulomb(servo, fold):
    """Corners with static below Coulomb friction are no servos; the others are searched."""
    box = Uncertainty({"friction.static": (0.43, 0.53), "friction.coulomb": (0.44, 0.45)})
    worst = worst_corner(servo, "switch", box, options=QUICK, fold=fold)
    assert worst.corner == {"friction.static": 0.53, "friction.coulomb": 0.44}
    assert worst.gain == pytest.approx(fold.gain, rel=QUICK.tol)


@pytest.mark.slow
def test_worst_corner_beats_a_thousand_samples(servo):
    options = Options(tol=1e-5)
    box = load_uncertainty(EXAMPLE, servo)
    own = find_fold(servo, "switch", options=options)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        samples = sample(servo, "switch", box, 1000, executor=pool, options=options, fold=own)
    worst = worst_corner(servo, "switch", box, options=options, fold=own)
    assert not samples.failures
    assert worst.gain >= samples.gains.max() * (1 - options.tol)
    # The linear answer is first order: right to the square of the relative change.
    linear = linear_gains(own, box.parameters, samples.parameters)
    assert np.abs(linear / samples.gains - 1).max() < ((worst.gain - own.gain) / own.gain) ** 2


@pytest.mark.slow
def test_lugre(servo):
    own = find_fold(servo, "lugre", options=QUICK)
    box = load_uncertainty(EXAMPLE, servo)
    samples = sample(servo, "lugre", box, 10, options=QUICK, fold=own)
    worst = worst_corner(servo, "lugre", box, options=QUICK, fold=own)
    assert not samples.failures and worst.gain >= samples.gains.max()


# Where the linear answer misleads


def test_summary(servo, fold, eleven):
    worst = worst_corner(servo, "switch", FRICTION, options=QUICK, fold=fold)
    seen = summary(fold, FRICTION, eleven, worst)
    assert seen.quantiles["max"] == eleven.gains.max() <= worst.gain
    assert "does not mislead" in seen.misleading
    error = linear_range(fold, FRICTION)[1] / worst.gain - 1
    assert seen.relative_error["worst corner"] == pytest.approx(error, rel=1e-6)
    # +-20 % of the Stribeck velocity: K goes like 1/vs^1.03 and the straight line does not.
    far = servo.replace(**{"friction.stribeck_velocity": 0.016})
    wide = Uncertainty({"friction.stribeck_velocity": (0.016, 0.024)})
    corner = WorstCase(far, find_fold(far, "switch", options=QUICK), {"friction.stribeck_velocity": 0.016}, 1)
    text = summary(fold, wide, sample(servo, "switch", wide, 2, options=QUICK, fold=fold), corner).misleading
    assert "the linear answer misleads: at the worst corner it gives 0.781" in text and "its lower end" not in text
    # Down to Fs = Fc, where there is no cycle: 0.647 - 0.09 times 7.4 is no gain.
    broad = Uncertainty({"friction.static": (0.44, 0.531)})
    nominal = WorstCase(servo, fold, {"friction.static": 0.53}, 1)
    assert linear_range(fold, broad)[0] < 0
    text = summary(fold, broad, sample(servo, "switch", broad, 1, options=QUICK, fold=fold), nominal).misleading
    assert "its lower end is no gain (not positive)" in text


# Bad input


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({}, "either intervals"),
        ({"intervals": {"friction.static": (0.5, 0.6)}, "names": PAIR, "covariance": np.eye(2)}, "either intervals"),
        ({"intervals": {"friction.static": (0.6, 0.5)}}, "low must not exceed high"),
        ({"intervals": {"friction.static": (0.6, float("nan"))}}, "finite number"),
        ({"intervals": {"friction.static": 0.6}}, r"\[low, high\]"),
        ({"names": PAIR, "covariance": [[1e-6, 1e-7], [0, 1e-6]]}, "symmetric"),
        ({"names": PAIR, "covariance": [[1e-6, 2e-6], [2e-6, 1e-6]]}, "positive semidefinite"),
        ({"names": PAIR, "covariance": [[-1e-6, 0], [0, 1e-6]]}, "negative variance"),
        ({"names": PAIR, "covariance": [[1e-6, 0]]}, "2 rows of 2"),
        ({"names": PAIR, "covariance": [["x", 0], [0, 1]]}, "matrix of numbers"),
        ({"names": ("friction.static",) * 2, "covariance": np.eye(2)}, "each once"),
        ({"names": PAIR, "covariance": 1e-6 * np.eye(2), "sigmas": 0}, "sigmas = 0"),
    ],
)
def test_no_uncertainty(given, sentence):
    with pytest.raises(InputError, match=sentence):
        Uncertainty(**given)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("friction.statik", "did you mean 'friction.static'"), ("gain", "unknown parameter 'gain'")],
)
def test_what_no_servo_has_is_not_uncertain(servo, name, sentence):
    for given in (Uncertainty({name: (0.5, 0.6)}), Uncertainty(names=(name,), covariance=[[1e-6]])):
        with pytest.raises(InputError, match=sentence):
            sample(servo, "switch", given, 1)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "must hold one table"),
        ("[servo]\ninertia = 0.02\n", r"'servo'.*such a file reads \[interval\], below it lines like '.friction\.st"),
        ("[interval]\n", "either intervals"),
        ("[intervals]\n", "did you mean 'interval'"),
        ("interval = 3\n", "must be a table"),
        ("[interval\n", "not valid TOML"),
        ('[interval]\n"friction.static" = "2 percent"\n', "a percentage such as"),
        ('[interval]\n"friction.static" = "2%"\n[covariance]\nnames = []\n', "must hold one table"),
        ('[interval]\n"friction.viscous" = "200%"\n', "friction.viscous = -0.1: must be at least 0"),
        ('[interval]\n"friction.static" = [0.4, 0.43]\n', "friction.static = 0.43: must be at least 0.44"),
        ('[covariance]\nnames = ["friction.static"]\n', "must have a matrix"),
        ('[covariance]\nnames = ["friction.static"]\nmatrix = [[1.0]]\n', "at 3 standard deviations"),
        ('[covariance]\nnames = ["friction.static"]\nmatrix = [[1e-6]]\nsigma = 2\n', "did you mean 'sigmas'"),
        ('[interval]\n"friction.static" = [0.40, 0.44000001]\n', "values drawn only .*; narrow one of the int"),
    ],
)
def test_bad_files(tmp_path, capsys, text, sentence):
    path = tmp_path / "friction.toml"
    path.write_text(text, encoding="utf-8")
    code = cli.main(["uncertainty", "--uncertainty", str(path), "--samples", "20", "--quiet"])
    out, err = capsys.readouterr()
    assert code == 2 and out == "" and err.count("\n") == 1
    assert re.search(sentence, err), err


def test_files(tmp_path, servo):
    path = tmp_path / "friction.toml"
    path.write_text('[interval]\nfriction.static = "2%"\n"friction.coulomb" = [0.43, 0.45]\n', encoding="utf-8")
    assert load_uncertainty(path, servo).intervals == {
        "friction.static": pytest.approx((0.5194, 0.5406)), "friction.coulomb": (0.43, 0.45),
    }  # fmt: skip
    path.write_text('[covariance]\nnames = ["friction.static"]\nmatrix = [[4e-6]]\nsigmas = 2\n', encoding="utf-8")
    low, high = load_uncertainty(path, servo).box(servo)
    assert (low[0], high[0]) == pytest.approx((0.526, 0.534))


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--uncertainty", "nowhere.toml"],
        ["--uncertainty", str(EXAMPLE), "--samples", "0"],
        ["--uncertainty", str(EXAMPLE), "--samples", "many"],
        ["--uncertainty", str(EXAMPLE), "--jobs", "0"],
        ["--uncertainty", str(EXAMPLE), "--seed", "-1"],
        ["--uncertainty", str(EXAMPLE), "--model", "dahl"],
        ["--uncertainty", str(EXAMPLE), "--plot", "picture.txt"],
    ],
)
def test_bad_words(capsys, words):
    assert cli.main(["uncertainty", *words]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("casahunt uncertainty: ") and err.count("\n") == 1


# The command


def test_command(tmp_path, capsys, fold):
    picture = tmp_path / "gains.png"
    words = ["uncertainty", "--uncertainty", str(EXAMPLE), "--samples", "6", "--plot", str(picture)]
    assert cli.main([*words, "--json", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    record = json.loads(out)
    assert set(record) >= {"model", "gain", "linear", "worst", "samples", "misleading", "status", "wall_s"}
    assert record["gain"] == pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-6)
    box = load_uncertainty(EXAMPLE, Servo())
    assert (record["linear"]["low"], record["linear"]["high"]) == pytest.approx(linear_range(fold, box))
    assert record["samples"]["n"] == 6 and record["samples"]["failures"] == 0
    assert record["worst"]["gain"] >= record["samples"]["quantiles"]["max"]
    assert record["worst"]["corner"]["friction.static"] == 0.54
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert cli.main([*words[:3], "--samples", "2", "--jobs", "2"]) == 0
    assert "worst corner" in capsys.readouterr().out


def test_a_fold_beside_another_is_the_fold(servo, fold):
    """Table 1 with a longer lead time, and at the end of the way back: the fold from nothing, and the reference."""
    there = servo.replace(**{"controller.lead_time": 0.24})
    beside = fold_beside(there, "switch", fold)
    assert beside.gain == pytest.approx(find_fold(there, "switch").gain, rel=2e-6)
    assert fold_beside(servo, "switch", beside).gain == pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-6)


def test_a_fold_far_below_the_expected_gain(servo):
    """A cycle expected above the fold is met by nobody: the search begins from nothing."""
    fold = nearby.fold_near(servo, "switch", 2.0, Options())
    assert fold.gain == pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-6)


@pytest.mark.parametrize("tol", [1e-4, 1e-5, 1e-6])
def test_a_corner_where_the_fold_jumps_is_closed_in_on_to_the_tolerance(tol):
    """K = 1 + x up to 0.3, then 0.9: no slope vanishes there, and bisection went on to the last digit."""
    one = search._CornerSearch.__new__(search._CornerSearch)
    one.low, one.high, one.options = np.zeros(1), np.ones(1), Options(tol=tol)
    one.evaluations, one.given_up = 0, ""
    places, ascent = [], one.climb(np.zeros(1))
    asked = next(ascent)
    while asked:
        x = float(asked[0][0])
        places.append(search._SearchPoint(asked[0], 1 + x if x < 0.3 else 0.9, np.ones(1)))
        try:
            asked = ascent.send(places[-1:])
        except StopIteration:
            break
    assert max(place.gain for place in places) == pytest.approx(1.3, rel=tol)
    assert len(places) <= 5 + math.log2(1 / tol)
