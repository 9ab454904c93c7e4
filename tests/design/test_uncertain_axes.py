"""Folds of axes of parts: those of the plain servo where they are one; else by scipy's DOP853 with events."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from belt_support import stops
from command_line import is_picture, one_json, run

from casahunt import (
    InputError,
    NoOrbit,
    Options,
    Servo,
    Uncertainty,
    find_fold,
    find_orbit,
    fold_ensemble,
    fold_map,
    load_uncertainty,
    orbit_ensemble,
    sample_fold_gains,
    worst_corner,
)
from casahunt.design.nearby import are_servos, upper
from casahunt.design.uncertainty.set import check_box, part_without_servos
from casahunt.errors import ComesToRest
from casahunt.servo.parts import (
    INERTIA,
    INTEGRATOR,
    LOAD_SWITCH,
    P_PI,
    PID_BY_GAINS,
    SWITCH,
    TWO_MASSES,
    Loop,
    load_loop,
    loop_of,
)
from casahunt.servo.parts.fate import on_the_cycle
from problems import belt as problem

FILE = Path(problem.__file__).with_name("belt.toml")
INTERVALS = """[interval]
static = ["0.76 N m", "840 mN m"]
coulomb = "5%"
load_inertia = [0.003, 0.005]
"""


@pytest.fixture(scope="module")
def belt() -> Loop:
    return load_loop(FILE)


@pytest.fixture(scope="module")
def uncertainty(tmp_path_factory, belt) -> Uncertainty:
    path = tmp_path_factory.mktemp("uncertain") / "belt.toml"
    path.write_text(INTERVALS)
    return load_uncertainty(path, belt)


def test_values_of_parts_have_their_units(uncertainty):
    assert uncertainty.intervals == {
        "static": (0.76, 0.84), "coulomb": pytest.approx((0.5225, 0.5775)), "load_inertia": (0.003, 0.005),
    }  # fmt: skip


def test_the_plain_servo_in_parts_has_its_samples():
    """The same servos, drawn by the same numbers: as of the servo, to the tolerance of both."""
    box = {"friction.static": (0.52, 0.54), "friction.coulomb": (0.43, 0.45)}
    own = sample_fold_gains(Servo(), "switch", Uncertainty(box), 6, seed=3)
    parts = Uncertainty({name.removeprefix("friction."): ends for name, ends in box.items()})
    loop = loop_of(Servo(), "switch", 0.04)
    found = sample_fold_gains(loop, None, parts, 6, seed=3)
    assert np.array_equal(found.parameters, own.parameters) and found.failures == ()
    assert found.gains == pytest.approx(own.gains, rel=2e-6)
    worst, of_servo = worst_corner(loop, None, parts), worst_corner(Servo(), "switch", Uncertainty(box))
    assert worst.gain == pytest.approx(of_servo.gain, rel=2e-6) and worst.corner == {"static": 0.54, "coulomb": 0.43}


def hunts(loop: Loop, on_a_cycle: dict[str, float]) -> bool:
    """Whether DOP853 still swings half as far after 40 stops; else they come ever nearer."""
    state = np.array([on_a_cycle[name] for name in ("x1", "x2", "load_angle", "load_rate", "x3")])
    return abs(stops(loop.parameters, state, 40)[-1][1]) > abs(state[0]) / 2


@pytest.mark.slow
def test_samples_hunt_below_their_folds_and_not_above(belt, uncertainty):
    """Four samples and the worst corner, each alone by DOP853, at 0.98 and 1.02 of its fold gain."""
    found = sample_fold_gains(belt, None, uncertainty, 4, seed=1)
    worst = worst_corner(belt, None, uncertainty)
    assert found.failures == () and worst.gain >= found.gains.max()
    assert worst.corner == {"static": 0.84, "coulomb": pytest.approx(0.5225), "load_inertia": 0.005}
    axes = [belt.replace(**dict(zip(found.names, row, strict=True))) for row in found.parameters.tolist()]
    seen = []
    for axis, gain in zip((*axes, worst.servo), (*found.gains, worst.gain), strict=True):
        below, above = (axis.replace(gain=part * float(gain)) for part in (0.98, 1.02))
        at_the_fold = on_the_cycle(find_fold(axis).orbit)
        assert not hunts(above, at_the_fold)
        try:
            seen.append(hunts(below, on_the_cycle(find_orbit(below))))
        except ComesToRest as refusal:  # its cycle there is unstable already
            assert "it has become unstable" in str(refusal) and not hunts(below, at_the_fold)
    assert len(seen) >= 3 and all(seen)


@pytest.mark.parametrize("gain", [1.0, 20.0])
def test_an_axis_that_rests_as_it_is_has_the_fold_of_one_that_hunts(belt, gain):
    """Above the fold gain motions rest from every start; a smaller gain leads to the same fold."""
    fold = find_fold(belt.replace(gain=gain))
    assert fold.value == pytest.approx(9.33258, rel=1e-6) and fold.sense == 1


def test_folds_and_cycles_of_many(belt):
    rows = [[0.76, 0.004], [0.84, 0.005]]
    found = fold_ensemble(belt, None, ["static", "load_inertia"], rows, elasticities=True)
    each = [find_fold(belt.replace(static=s, load_inertia=i)) for s, i in rows]
    assert found.gains == pytest.approx([fold.value for fold in each], rel=2e-6) and "loops" in repr(found)
    assert found.elasticities[0, 0] == pytest.approx(each[0].sensitivities["static"] * 0.76 / each[0].value, rel=1e-4)
    cycles = orbit_ensemble(belt, None, None, ["load_inertia"], [[0.004], [0.0041]])
    assert cycles.amplitudes[0] == pytest.approx(0.04075, rel=1e-3) and cycles.failures == ()


def test_a_map_of_folds_has_them(belt):
    found = fold_map(belt, None, ("static", "coulomb"), [0.5, 0.8], [0.55, 0.6])
    assert found.failures == {(0, 0): "no servo has these two values", (0, 1): "no servo has these two values"}
    assert found.gains[1, 1] == pytest.approx(find_fold(belt.replace(coulomb=0.6)).value, rel=2e-6)
    assert str(found).startswith("loop: fold gain") and found.to_dict()["servo"]["parts"][0] == "two masses"


def test_an_axis_without_a_fold_says_so_for_each_sample(belt):
    """Without integral action nothing hunts."""
    found = sample_fold_gains(belt.replace(ki=0.0), None, Uncertainty({"viscous": (0.01, 0.02)}), 2)
    assert found.gains.size == 2 and np.isnan(found.gains).all() and found.worst is None
    assert all("comes to rest" in sentence or "no cycle" in sentence for _, sentence in found.failures)
    with pytest.raises(NoOrbit, match="no fold in the box was computed"):
        worst_corner(belt.replace(ki=0.0), None, Uncertainty({"viscous": (0.01, 0.02)}))


def test_a_gain_from_which_on_it_hunts_is_none_up_to_which(belt):
    fold = find_fold(belt)
    assert upper(fold) is fold
    with pytest.raises(NoOrbit, match="it begins there"):
        upper(replace(fold, sense=-1.0))


def test_each_static_friction_is_above_its_own_coulomb_friction():
    loop = Loop((TWO_MASSES, SWITCH, LOAD_SWITCH, P_PI, INTEGRATOR))
    names = ("static", "load_coulomb")
    low = loop.value("load_static")
    rows = np.array([[1.0, 0.5 * low], [0.1, 0.5 * low], [1.0, 1.1 * low]])
    assert are_servos(loop, names, rows).tolist() == [True, False, False]
    assert "static below coulomb" in part_without_servos(loop, Uncertainty({"static": (0.3, 0.6)}))


@pytest.mark.parametrize(("intervals", "sentence"), [
    ({"friction.static": (0.7, 0.8)}, "unknown parameter 'friction.static'.*static"),
    ({"gain": (0.7, 0.8)}, "unknown parameter 'gain'"),
    ({"dead_band": (0.0, 0.1)}, "unknown parameter 'dead_band'"),
    ({"viscous": (-0.1, 0.1)}, r"viscous = -0.1: must be at least 0"),
    ({"static": (0.3, 0.5)}, r"static = 0.5: must be at least 0.55 \(coulomb\)"),
])  # fmt: skip
def test_what_no_axis_has_is_refused(belt, intervals, sentence):
    with pytest.raises(InputError, match=sentence):
        check_box(belt, Uncertainty(intervals))


def test_what_has_no_gain_is_refused_by_its_parts():
    loop = Loop((INERTIA, SWITCH))
    with pytest.raises(InputError, match=r"gain: must be a parameter .* one inertia, Switch friction have none"):
        sample_fold_gains(loop, None, Uncertainty({"static": (0.52, 0.54)}), 2)
    with pytest.raises(InputError, match="model = 'switch': must be left out"):
        sample_fold_gains(loop_of(Servo(), "switch", 0.04), "switch", Uncertainty({"static": (0.52, 0.54)}), 2)


def test_the_commands(capsys, tmp_path):
    path, picture, table = tmp_path / "u.toml", tmp_path / "gains.png", tmp_path / "gains.csv"
    path.write_text(INTERVALS)
    words = "uncertainty", FILE, "--uncertainty", path, "--samples", 2
    code, out, err = run(capsys, *words, "--json", "--quiet", "--plot", picture, "--csv", table)
    record = one_json(out)
    assert (code, err) == (0, "") and is_picture(picture) and record["parts"][0] == "two masses"
    assert record["gain"] == pytest.approx(9.33258, rel=1e-5) and record["worst"]["gain"] > record["gain"]
    assert "load_inertia_kg_m2" in table.read_text().splitlines()[0]
    said = " ".join(run(capsys, *words, "--quiet", "--details")[1].split())
    assert re.search(r"loop: hunting is possible up to gain 11\.\d+ V/rad with the worst values", said)
    assert "load_inertia 0.005 kg m2" in said
    grid = "--vary", "static", "0.76 N m", 0.84, "--and", "load_inertia", 0.003, 0.005, "--points", 3
    code, out, err = run(capsys, "fold-map", FILE, *grid, "--json", "--quiet", "--plot", picture)
    assert (code, err) == (0, "") and np.array(json.loads(out)["gains"]).shape == (3, 3) and is_picture(picture)


def test_what_is_known_of_the_drive_is_said_to_be_left_out(capsys, tmp_path):
    path, axis = tmp_path / "u.toml", tmp_path / "belt.toml"
    path.write_text(INTERVALS)
    axis.write_text(FILE.read_text() + "[drive]\nsample_time = 0.001\n")
    _, _, err = run(capsys, "uncertainty", axis, "--uncertainty", path, "--samples", 1)
    assert err.count("[drive] of the servo file changes nothing here") == 1


CREEPING = {"inertia": 3.74, "static": 103.0, "coulomb": 75.2, "stribeck_velocity": 0.00325, "viscous": 25.7,
            "motor_gain": 1.0, "gain": 1.0, "kp": 2350.0, "ki": 20000.0, "kd": 65.7}  # fmt: skip
"""A linear axis of 3.74 kg, whose slips at the fold creep before they jump: 1e38 and more is their multiplier."""


def as_steep(factor):
    """Another friction with the same (Fs - Fc)/vs, on which alone the fold gain depends."""
    drop = CREEPING["static"] - CREEPING["coulomb"]
    return {"static": CREEPING["coulomb"] + factor * drop, "stribeck_velocity": factor * CREEPING["stribeck_velocity"]}


def test_folds_of_slips_that_creep_are_found_in_a_batch():
    """Where a step along the branch is not seen at the start of the cycle, the fold is a corner there, and none is."""
    loop = Loop([INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR], CREEPING)
    names, factors = ["static", "stribeck_velocity"], (0.95, 0.98, 1.0, 1.02, 1.05)
    fold = find_fold(loop)
    found = fold_ensemble(loop, None, names, [[as_steep(f)[name] for name in names] for f in factors], fold=fold)
    assert set(found.how) == {"batch"}
    np.testing.assert_allclose(found.gains, fold.value, rtol=1e-8)


@pytest.mark.slow
def test_a_branch_along_which_slips_creep_is_followed_to_its_fold(factor=1.3):
    """They creep for longer and longer, 2 % of the gain below the fold; found 40 times as slowly on a mesh that stays,
    and of a loop not at all."""
    friction = {"coulomb": 2.16377, "static": 2.16377 + 0.478193 * factor, "stribeck_velocity": 0.0044959 * factor}
    changes = {f"friction.{name}": value for name, value in friction.items()} | {"friction.viscous": 0.0}
    times = {"controller.lead_time": 0.970814, "controller.integral_time": 0.0217785}
    servo = Servo(inertia=0.00663811, motor_gain=15.7739).replace(**changes, **times)
    known = find_fold(servo.replace(**as_of(servo, 1 / factor)), "switch", options=Options(tol=1e-9))
    assert find_fold(loop_of(servo, "switch", 0.45)).value == pytest.approx(known.gain, rel=1e-8)


def as_of(servo, factor):
    """What `as_steep` is of an axis, of a servo."""
    f = servo.friction
    return {"friction.static": f.coulomb + factor * (f.static - f.coulomb),
            "friction.stribeck_velocity": factor * f.stribeck_velocity}  # fmt: skip
