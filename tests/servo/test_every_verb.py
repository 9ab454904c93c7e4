"""Every verb is asked of every part: it answers, or says in a sentence which part it has no answer for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from casahunt import (
    Drive,
    InputError,
    NoOrbit,
    Record,
    Uncertainty,
    basin,
    cli,
    equilibria,
    find_fold,
    find_orbit,
    fold_ensemble,
    fold_map,
    linear_loop,
    margins,
    sample_fold_gains,
    simulate,
    tune,
    worst_corner,
)
from casahunt import simulate_sampled as sampled
from casahunt.design.identify.axis import FRICTION, check_axis, rigid
from casahunt.design.uncertainty.set import check_box
from casahunt.servo.parts import (
    BY_DIRECTION,
    CLAMPING,
    DERIVATIVE_FILTER,
    INERTIA,
    INTEGRATOR,
    LOAD_SWITCH,
    LOADS,
    LUGRE,
    P_PI,
    P_PI_FILTERED,
    PID_BY_TIMES,
    REMEDIES,
    SWITCH,
    TORQUE_LIMIT,
    TWO_MASSES,
    TWO_MASSES_LOAD_SEEN,
    WITH_EXPONENT,
    Loop,
    series,
    transfer_function,
)
from casahunt.servo.parts.table import with_remedy

REST = PID_BY_TIMES, INTEGRATOR
PARTS = {
    "one inertia": (INERTIA, SWITCH, *REST),
    "two masses": (TWO_MASSES, SWITCH, *REST),
    "two masses, load measured": (TWO_MASSES_LOAD_SEEN, SWITCH, *REST),
    "friction of the load": (TWO_MASSES, SWITCH, LOAD_SWITCH, *REST),
    "LuGre": (INERTIA, LUGRE, *REST),
    "by direction": (INERTIA, BY_DIRECTION, *REST),
    "with exponent": (INERTIA, WITH_EXPONENT, *REST),
    "P-PI": (INERTIA, SWITCH, P_PI, INTEGRATOR),
    "P-PI, velocity filtered": (INERTIA, SWITCH, P_PI_FILTERED, INTEGRATOR),
    "transfer function": (INERTIA, SWITCH, transfer_function([0.16, 2.0, 6.28], [0.001, 1.0, 0.0])),
    "derivative filter": (INERTIA, SWITCH, *REST, DERIVATIVE_FILTER),
    "notch": (INERTIA, SWITCH, *REST, series("notch")),
    "torque limit": (INERTIA, SWITCH, *REST, TORQUE_LIMIT),
    "clamping": (INERTIA, SWITCH, *REST, CLAMPING),
    "loads": (INERTIA, SWITCH, *REST, LOADS),
}
NUMBERS = {"gain": 0.04, "shaft_damping": 0.05, "derivative_filter": 1e-3, "torque_limit": 0.9, "load_torque": 0.1}
SIZES = {
    "dead band": 0.02, "shifted dead band": 0.02, "hysteresis": 0.03, "error dead band": 0.01, "leak": 0.1,
    "freeze": 0.5, "reset": 0.5, "reset at a stop": 0.7, "error filter": 0.01, "feedforward": 0.5, "dither": 0.01,
}  # fmt: skip
VISCOUS = Uncertainty({"viscous": (0.09, 0.11)})
RECORD = Record(np.arange(100.0), np.zeros(100))
DRIVE = Drive(sample_time=1e-3, encoder=8192)


def loops() -> dict[str, Loop]:
    found = {}
    for name, parts in PARTS.items():
        known = {number for part in parts for number in part.parameters}
        found[name] = Loop(parts, {key: value for key, value in NUMBERS.items() if key in known})
    plain = found["one inertia"]
    remedies = [remedy for remedy in REMEDIES if remedy.part is not None and "switch" in remedy.needs]
    return found | {remedy.name: with_remedy(plain, remedy, SIZES[remedy.name]) for remedy in remedies}


LOOPS = loops()
MAKERS_OF_PARTS = ("transfer function", "notch")
"""Of which a file has tables in the place of names."""
VERBS = {
    "simulate": lambda loop: simulate(loop, time=2.0).status.ok and simulate(loop, time=2.0).peak_torque > 0,
    "simulate_sampled": lambda loop: sampled(loop, drive=DRIVE, time=0.5).peak_torque > 0,
    "linear_loop": lambda loop: len(linear_loop(loop).poles) > 0,
    "margins": lambda loop: math.isfinite(margins(loop).phase_margin),
    "margins as built": lambda loop: math.isfinite(margins(loop, drive=DRIVE).phase_margin),
    "equilibria": lambda loop: equilibria(loop).to_dict()["gain"] > 0,
    "check_box": lambda loop: check_box(loop, VISCOUS) is None,
    "check_axis": lambda loop: check_axis(loop, list(FRICTION), [RECORD]) == tuple(FRICTION) and rigid(loop),
}
SLOW = {
    "find_orbit": lambda loop: find_orbit(loop).error_estimate < 1e-6,
    "basin": lambda loop: basin(loop).border > 0,
    "find_fold": lambda loop: find_fold(loop).value > 0,
    "worst_corner": lambda loop: worst_corner(loop, None, VISCOUS).gain > 0,
    "sample_fold_gains": lambda loop: told(sample_fold_gains(loop, None, VISCOUS, 1)),
    "fold_ensemble": lambda loop: told(fold_ensemble(loop, None, ["viscous"], [[0.1]])),
    "fold_map": lambda loop: fold_map(loop, None, ("viscous", "static"), [0.1, 0.11], [0.53, 0.54]).gains.size == 4,
    "tune": lambda loop: tune(loop).gain > 0,
}


def told(found) -> bool:
    """Of what was not computed there is a sentence."""
    return bool(np.isfinite(found.gains).all()) or len(found.failures) > 0


def asked(verb, loop: Loop) -> None:
    try:
        assert verb(loop)
    except (InputError, NoOrbit) as refusal:
        names = [part.name for part in loop.present]
        told = isinstance(refusal, NoOrbit) or any(name in str(refusal) for name in names)
        assert told and len(str(refusal)) > 40, refusal


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("name", LOOPS)
def test_a_verb_answers_or_names_the_part(verb, name):
    asked(VERBS[verb], LOOPS[name])


@pytest.mark.slow
@pytest.mark.parametrize("verb", SLOW)
@pytest.mark.parametrize("name", LOOPS)
def test_a_long_verb_answers_or_names_the_part(verb, name):
    asked(SLOW[verb], LOOPS[name])


@pytest.mark.parametrize("name", ["two masses", "hysteresis", "torque limit", "notch"])
def test_one_motion_has_one_length(name):
    """Of a motion and of its table, to the last bit; and its first state is that of the start."""
    motion = simulate(LOOPS[name], time=2.0, position=0.9)
    times = motion.table()["time_s"]
    assert motion.duration == times[-1] == 2.0 and np.all(np.diff(times) > 0)
    assert motion.sample(np.array([0.0, 2.0])).T == pytest.approx(motion.dense()[1][:, [0, -1]].T, abs=1e-15)


@pytest.mark.parametrize("name", [name for name in LOOPS if name not in MAKERS_OF_PARTS])
def test_the_event_map_names_the_part_or_answers(capsys, tmp_path, name):
    """It has an answer for one inertia with rigid friction under a PID; of others it says which part, and why."""
    loop, path = LOOPS[name], tmp_path / "loop.toml"
    parts = ", ".join(f'"{part.name}"' for part in loop.present)
    values = "\n".join(f"{key} = {value!r}" for key, value in loop.parameters.items())
    path.write_text(f"[loop]\nparts = [{parts}]\n[values]\n{values}\n")
    code, (out, err) = cli.main(["map", str(path), "--points", "5", "--quiet"]), capsys.readouterr()
    if code:
        said = err.partition("has no answer for ")[2]
        assert out == "" and any(repr(part.name) in said for part in loop.present) and "the event map has one" in said
    assert (code == 0) == (name == "one inertia")
