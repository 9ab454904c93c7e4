"""The servo as a user's system: what any user calls on it gives the orbits of the servo's own functions, and the truth.

Truth: problems/table1.py, from programs that use no collocation.
"""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from casahunt import effort
from casahunt.continuation import follow, largest
from casahunt.continuation.branching import _whole
from casahunt.continuation.special_points import GRAZING
from casahunt.continuation.vanishing import solved_at
from casahunt.errors import NoOrbit
from casahunt.hybrid.system import Exit
from casahunt.motion import simulate
from casahunt.orbits import find_cycle
from casahunt.orbits.adapt import Options
from casahunt.orbits.orbit import unknowns_of
from casahunt.orbits.simulated_phases import rotated
from casahunt.servo.find_orbit import find_orbit
from casahunt.servo.parts.functions import FieldOf
from casahunt.servo.parts.wiring import Wiring
from casahunt.servo.problem import hunting_system, system_of
from casahunt.servo.servo import Servo
from problems.table1 import REFERENCE, servo
from scripts.report.stick_band import band_system

TIMES = servo()
GAINS = TIMES.replace(**{f"controller.{k}": getattr(TIMES.controller.pid(), k) for k in ("kp", "ki", "kd")})
STARTS = {
    "switch": ("stick", {"x1": -0.02, "x2": 0.0, "x3": 0.0}),
    "lugre": ("slide+", {"x1": -0.02, "x2": 0.0, "x3": 0.0, "x4": 0.0}),
}


@pytest.mark.parametrize("form", [TIMES, GAINS], ids=["times", "gains"])
@pytest.mark.parametrize(("model", "K"), [
    ("switch", 0.1), pytest.param("switch", 0.4, marks=pytest.mark.slow),
    pytest.param("lugre", 0.04, marks=pytest.mark.slow), pytest.param("lugre", 0.1, marks=pytest.mark.slow),
])  # fmt: skip
def test_any_users_search_finds_the_servos_orbit(form: Servo, model, K):
    truth = next(row for row in REFERENCE[model]["stable"] if row["K"] == K)
    mode, start = STARTS[model]
    theirs = find_cycle(hunting_system(form, model, K), mode, start=start, follow="gain", tol=1e-9)
    ours = find_orbit(form, model, K, options=Options(tol=1e-9))
    for name in ("period", "amplitude"):
        both = theirs.error_estimate + ours.error_estimate
        assert getattr(theirs, name) == pytest.approx(getattr(ours, name), rel=both)
        for one in (theirs, ours):  # the reference's last digit but one: 1e-11 of LuGre's
            assert getattr(one, name) == pytest.approx(truth[name], rel=10 * one.error_estimate + 2e-11)
    assert theirs.stable and theirs.parameters["static"] == form.friction.static


@pytest.mark.parametrize("form", [TIMES, GAINS], ids=["times", "gains"])
@pytest.mark.parametrize("model", ["switch", "lugre"])
@pytest.mark.parametrize("K", [0.02, 0.04, 0.1, 0.4])
def test_the_search_ends_with_the_first_returns(form: Servo, model, K):
    """On half a cycle, with the work of a few turns of the motion; one that settles takes several times it."""
    mode, start = STARTS[model]
    with effort.counting_work(None) as watch:
        orbit = find_cycle(hunting_system(form, model, K), mode, start=start, follow="gain", tol=1e-9)
    assert orbit.repeats == 2 and watch.work < {"switch": 700, "lugre": 13_000}[model]


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_start_inside_the_unstable_cycle_comes_to_rest(model):
    """At K = 0.6 the motion from the same start sticks nearer and nearer to the set point, for longer and longer."""
    mode, start = STARTS[model]
    with pytest.raises(NoOrbit, match="comes to rest"):
        find_cycle(hunting_system(TIMES, model, 0.6), mode, start=start, follow="gain", tol=1e-9)


@pytest.mark.parametrize(
    "beside", [-0.05, -0.01, -1e-3, 1e-3, *(pytest.param(off, marks=pytest.mark.slow) for off in (0.01, 0.05))]
)
def test_the_unstable_cycle_from_a_guess(beside):
    """Stuck just before breakaway; what is off there is 92 times as much half a period later.

    From 1 % farther out on the next stop is seventy times as far, next to the stable cycle.
    """
    truth, (kp, _, ki) = REFERENCE["switch"]["unstable"][0], TIMES.torque_gains(0.1)
    x1 = truth["amplitude"] * (1 + beside)
    x3 = 0.999 * (TIMES.friction.static - kp * x1) / ki
    system = hunting_system(TIMES, "switch", truth["K"])
    orbit = find_cycle(system, "stick", x1=x1, x2=0.0, x3=x3, settled=True, follow="gain", tol=1e-9)
    for name in ("period", "amplitude"):
        assert getattr(orbit, name) == pytest.approx(truth[name], rel=10 * orbit.error_estimate + 2e-11)
    assert not orbit.stable and orbit.half_multiplier == pytest.approx(truth["mu"], rel=1e-7)
    assert orbit.from_start == pytest.approx(abs(beside), rel=0.2)


@pytest.mark.parametrize("form", [TIMES, GAINS], ids=["times", "gains"])
def test_its_motion_from_a_stick(form: Servo):
    """The stick lasts (m - s Fs)/(ki x1), s = -sign(x1), in closed form."""
    K, x1 = 0.1, -0.02
    kp, _, ki = form.torque_gains(K)
    motion = simulate(hunting_system(form, "switch", K), "stick", x1=x1, x2=0.0, x3=0.0, duration=30.0)
    first, second = motion.events[:2]
    assert (first.event, second.event) == ("breakaway+", "stop")
    assert first.time == pytest.approx((-kp * x1 - form.friction.static) / (ki * x1), rel=1e-12)


@pytest.mark.slow
def test_the_stick_band_tends_to_the_exact_stick():
    """Crossing the band takes times that vanish with it: the period is off in proportion to eta."""
    truth = next(row for row in REFERENCE["switch"]["stable"] if row["K"] == 0.1)["period"]
    periods = []
    for eta in (1e-3, 1e-4):
        system = band_system(TIMES.replace(**{"friction.stick_band": eta}), 0.1)
        periods.append(find_cycle(system, "stick", x1=-0.02, x2=0.0, x3=0.0, tol=1e-8).period)
    assert periods[1] == pytest.approx(truth, rel=1e-3)
    assert (10 * periods[1] - periods[0]) / 9 == pytest.approx(truth, rel=2e-5)  # what is left is of order eta^2


def lugre_cycle(K: float, x1: float):
    return find_cycle(
        hunting_system(TIMES, "lugre", K), "slide+", start={"x1": x1, "x2": 0.0, "x3": 0.0, "x4": 0.0},
        follow="gain", tol=1e-9,
    )  # fmt: skip


@pytest.mark.slow
def test_its_branch_goes_over_weak_reversals():
    """Reversals come and go, and the field has but a kink there: that is said, and nothing is spent on it."""
    orbit = lugre_cycle(0.1, -0.02)
    with effort.counting_work(None, limit=1e5):  # 3.5 times as many where every touch is located
        branch = follow(orbit, "gain", to=2.0, back=0.1, options=Options(tol=1e-6))
    (fold,) = branch.special
    assert fold.kind == "fold" and fold.value == pytest.approx(REFERENCE["lugre"]["fold"]["K"], rel=1e-6)
    changes = np.count_nonzero(np.diff([len(orbit.signature) for orbit in branch.orbits]))
    assert changes > 0 and {missed.kind for missed in branch.missed} == {"kink"}
    assert len(branch.missed) >= changes and "phases come or go" in str(branch)
    truth = next(row["amplitude"] for row in REFERENCE["lugre"]["unstable"] if row["K"] == 0.1)
    assert branch.end.kind == "range" and branch.amplitudes[-1] == pytest.approx(truth, rel=1e-5)


def test_weak_reversals_are_located_where_that_is_asked_for():
    """Where the duration of what the cycles, computed afresh below, have more tends to zero: see test_find_fold."""
    branch = follow(lugre_cycle(0.12, -0.02), "gain", to=0.14, options=Options(tol=1e-6), monitors=(GRAZING,))
    (touch,) = branch.special
    gains = touch.value * np.array([0.96, 0.97, 0.98, 0.99])
    below = [find_orbit(TIMES, "lugre", gain, options=Options(tol=1e-9)) for gain in gains]
    T = np.array([min(arc.duration for arc in orbit.arcs) for orbit in below])
    vanishes = np.linalg.solve((T[:, None] / T[0]) ** [0, 2, 3, 4], gains)[0]
    assert touch.kind == "grazing" and touch.value == pytest.approx(vanishes, rel=2e-5) and not branch.missed
    above = find_orbit(TIMES, "lugre", touch.value * 1.01)
    assert {len(orbit.arcs) for orbit in below} == {len(above.arcs) + 2} == {len(touch.orbit.arcs) + 2}


@pytest.mark.parametrize(("K", "x1"), [
    (0.3, -0.02), pytest.param(0.04, -0.02, marks=pytest.mark.slow), pytest.param(0.58, -0.002, marks=pytest.mark.slow),
    pytest.param(0.6, -0.0019, marks=pytest.mark.slow),
])  # fmt: skip
def test_its_largest_gain_is_that_of_any_cycle_of_the_branch(K, x1):
    """Wherever the cycle begins: here a reversal that vanishes on the way is where half a cycle closes."""
    orbit, options = lugre_cycle(K, x1), Options(tol=1e-9)
    centre = [arc.event for arc in orbit.arcs].index("centre")
    start = rotated(orbit.problem.asked(), unknowns_of(orbit), centre) if centre else unknowns_of(orbit)
    fold = largest(solved_at(orbit.problem, start, options), "gain")
    assert fold.value == pytest.approx(REFERENCE["lugre"]["fold"]["K"], rel=max(1e-9, 10 * fold.value_error))


@pytest.mark.slow
def test_the_largest_gain_of_whole_cycles():
    """Both halves lose a pair of reversals at once."""
    whole = _whole(lugre_cycle(0.58, -0.002), Options(tol=1e-9))
    assert whole.repeats == 1
    fold = largest(whole, "gain")
    assert fold.value == pytest.approx(REFERENCE["lugre"]["fold"]["K"], rel=max(1e-9, 10 * fold.value_error))


def test_its_expressions_have_the_same_names():
    """An orbit of the servo's own functions reads x.x2 and p.inertia as its user's system does."""
    orbit = find_orbit(TIMES, "switch", 0.1)
    energy = orbit.extrema(lambda x, p: p.inertia * x.x2**2 / 2).high.value
    assert energy == pytest.approx(TIMES.inertia * orbit.extrema("x2").high.value ** 2 / 2, rel=1e-9)


@pytest.mark.parametrize("form", [TIMES, GAINS], ids=["times", "gains"])
@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_it_is_data(form: Servo, model):
    system = hunting_system(form, model, 0.1)
    again = pickle.loads(pickle.dumps(system))
    assert again == system and again.vector_form == system.vector_form
    n = len(system.names.parameters)
    assert system_of(model, n).vector_form.modes == system.vector_form.modes
    assert {mode.name for mode in system.modes} == set(again.vector_form.modes)
    wiring = system.modes[0].field.key[0]  # one that is made again, where it is kept no more, is the same
    other = Wiring(wiring.active)
    assert other is not wiring and other == wiring and FieldOf(other) == system.modes[0].field


def test_a_softened_slide_is_left_in_the_direction_of_its_motion():
    """Its one event is crossed either way; both ways out know where they lead."""
    form = system_of("lugre", 11).vector_form
    up, down = form.ways_out("slide", "centre")
    assert isinstance(up, Exit) and (up.direction, down.direction) == (1, -1)
    p = TIMES.parameters(0.1)
    for way_out in (up, down):
        assert way_out.successor(np.array([0.0, 0.1, 0.0, 0.0]), p) == "slide+"
        assert way_out.successor(np.array([0.0, -0.1, 0.0, 0.0]), p) == "slide-"
