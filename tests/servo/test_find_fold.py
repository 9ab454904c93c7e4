"""Folds: the reference, the optimisation problem, the extended system, and exact symmetries."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from casahunt import InputError, NoOrbit, Options, Servo, SpecialPoint, Status, diagram, find_fold, find_orbit
from casahunt.collocation.newton import newton
from casahunt.continuation.fold_check import confirmed, next_fold
from casahunt.continuation.special_points import FOLD, GRAZING
from casahunt.orbits.orbit import unknowns_of
from casahunt.servo.basin import stick_position
from casahunt.servo.event_map.half_cycle import StickMap
from casahunt.servo.event_map.secant_search import near_stable
from casahunt.servo.find_fold import _has_fixed_point, find_any_orbit
from casahunt.servo.friction import Model
from casahunt.servo.gains import routh_hurwitz_gain
from casahunt.servo.problem import HuntingFold
from problems import table1, taylor


@cache
def fold_of(model: Model, tol: float) -> HuntingFold:
    """The fold of Table 1, for all tests that read it."""
    return find_fold(table1.servo(), model, options=Options(tol=tol))


@pytest.mark.parametrize(
    ("model", "tol", "limit"),
    [
        ("switch", 1e-10, 1e-10),
        ("switch", 1e-9, 1e-9),
        ("lugre", 1e-9, 1e-8),
        ("switch", 1e-6, 1e-6),
        ("lugre", 1e-6, 1e-6),
    ],
)
def test_reference_folds(model, tol, limit):
    row = table1.REFERENCE[model]["fold"]
    fold = fold_of(model, tol)
    assert fold.gain == pytest.approx(row["K"], rel=limit)
    assert fold.confirmed_gain == pytest.approx(row["K"], rel=limit)
    assert fold.orbit.amplitude == pytest.approx(row["amplitude"], rel=1e-6)
    assert fold.orbit.period == pytest.approx(row["period"], rel=1e-6)
    true = abs(fold.gain / row["K"] - 1)
    assert true <= 10 * fold.error_estimate + 1e-11
    assert fold.error_estimate <= tol


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
def test_extended_system(model):
    """J v = 0, |v| = 1 at the fold: the full sparse Jacobian is singular there, by a dense SVD."""
    import casadi as ca

    from casahunt.collocation.graphs import graphs

    fold = fold_of(model, 1e-9)
    t, u, setting = unknowns_of(fold.orbit)
    setting = replace(setting, dp=fold.orbit.problem.direction("gain") * fold.gain)
    g = graphs(t)
    data = np.concatenate([setting.fractions, setting.p, setting.dp, setting.scale])
    jacobian = np.array(ca.Function("J", [g.z, g.data], [g.jacobian])(np.append(u, 0.0), data))
    left, singular, right = np.linalg.svd(jacobian[:, :-1])
    # One simple zero: the others are a million times larger.
    assert singular[-1] < 1e-6 * singular[-2]
    # Transversal: the fold cannot be removed by moving the gain.
    assert abs(left[:, -1] @ jacobian[:, -1]) > 1e-6
    # The null vector is the way between the two cycles that merge here: a little below, Newton finds one on each side.
    below = setting.moved(-1e-8)
    one, other = (newton(t, u + side * 1e-3 * right[-1], below).u for side in (1, -1))
    way = one - other
    assert np.linalg.norm(way) > 1e-5
    assert abs(way @ right[-1]) / np.linalg.norm(way) > 1 - 1e-4


def switch_fold(**changes: float) -> float:
    return find_fold(Servo().replace(**changes), "switch", options=Options(tol=1e-10)).gain


def test_fold_times_motor_gain_is_constant():
    assert switch_fold(**{"servo.motor_gain": 5.0}) * 5 == pytest.approx(switch_fold() * 16, rel=1e-9)


def test_fold_depends_on_friction_through_the_drop_over_velocity():
    """K_fold depends on Fs, Fc, vs only through (Fs - Fc)/vs."""
    weaker = switch_fold(**{"friction.static": 0.50})
    wider = switch_fold(**{"friction.stribeck_velocity": 0.03})
    shifted = switch_fold(**{"friction.static": 0.70, "friction.coulomb": 0.64})
    assert weaker == pytest.approx(wider, rel=1e-9)
    assert shifted == pytest.approx(wider, rel=1e-9)


def test_controller_times_can_be_swapped():
    """tau_i <-> tau_d leaves amplitude and period alone with K/tau_i fixed."""
    one = Servo().replace(**{"controller.integral_time": 0.12, "controller.lead_time": 0.25})
    two = Servo().replace(**{"controller.integral_time": 0.25, "controller.lead_time": 0.12})
    a = find_fold(one, "switch", options=Options(tol=1e-10))
    b = find_fold(two, "switch", options=Options(tol=1e-10))
    assert a.gain / 0.12 == pytest.approx(b.gain / 0.25, rel=1e-9)
    assert a.orbit.amplitude == pytest.approx(b.orbit.amplitude, rel=1e-6)
    assert a.orbit.period == pytest.approx(b.orbit.period, rel=1e-6)


def test_steepness_in_static_friction():
    """+5 % Fs gives +30 %, -5 % Fs -31 % of K_fold (design figures)."""
    base = switch_fold()
    assert switch_fold(**{"friction.static": 0.53 * 1.05}) / base == pytest.approx(1.30, abs=0.01)
    assert switch_fold(**{"friction.static": 0.53 * 0.95}) / base == pytest.approx(0.69, abs=0.01)


def test_unseen_servo_without_help():
    changes = {"servo.inertia": 2.0, "servo.motor_gain": 0.7, "friction.static": 9.0, "friction.coulomb": 6.0}
    servo = Servo().replace(**changes)
    fold = find_fold(servo, "switch", options=Options(tol=1e-8))
    assert fold.status.ok
    # This and the other numbers with 16 digits: P(a) = a and P'(a) = 1 to 28 (scripts/peers/switch_digits.py).
    assert fold.gain == pytest.approx(500.3607979054452, rel=1e-8)


def test_pure_coulomb_friction_has_no_fold():
    with pytest.raises(NoOrbit, match="no hunting limit cycle"):
        find_fold(Servo().replace(**{"friction.static": 0.44}), "switch")
    with pytest.raises(NoOrbit, match="no hunting limit cycle"):
        find_any_orbit(Servo().replace(**{"friction.static": 0.44}), "switch", options=Options())


VISCOUS_FOLD = {"gain": 0.620271708903377402755, "amplitude": 0.00158444659658070277663, "period": 20.9615092919047826}
"""Table 1 with sigma2 = 0.2: P(a) = a and P'(a) = 1 to 24 digits (scripts/peers/switch_digits.py)."""


@pytest.mark.parametrize("degree", [6, 7, 8, 10])
def test_errors_of_a_fold_know_that_it_may_lie_elsewhere_on_the_branch(degree):
    """A coarse mesh moves the fold along the branch: amplitude and period are wrong by ten times what the estimate at
    that point of the branch says, the gain is not.  The turning point on the halved mesh knows."""
    servo, options, matters = Servo().replace(**{"friction.viscous": 0.2}), Options(tol=1e-5, degree=degree), []
    for gain in (0.1, 0.2):
        far = find_orbit(servo, "switch", gain, options=options)  # whose mesh is not made for the fold
        fold = find_fold(servo, "switch", options=options, start=far)
        sizes = (fold.orbit.amplitude / VISCOUS_FOLD["amplitude"], fold.orbit.period / VISCOUS_FOLD["period"])
        true = max(abs(size - 1) for size in sizes)
        assert 1e-9 < true < fold.orbit.error_estimate < 1e-5
        assert fold.orbit.error_estimate < 100 * true  # as promised of every estimate
        matters.append(abs(fold.gain / VISCOUS_FOLD["gain"] - 1) < 0.3 * true)
    assert any(matters)


def test_the_largest_gain_is_not_sought_on_any_mesh(monkeypatch):
    """IPOPT takes minutes and gigabytes on large ones; this one would have nine intervals."""
    below = find_orbit(Servo(), "switch", 0.646, options=Options(tol=1e-3))
    alone = Options(tol=1e-10, solver="ipopt")
    monkeypatch.setattr("casahunt.collocation.ipopt.OPTIMAL_INTERVALS", 8)
    with pytest.raises(NoOrbit, match="not solved to the tolerance; try another tolerance"):
        next_fold(below, "gain", alone)
    monkeypatch.undo()
    assert next_fold(below, "gain", alone).orbit.error_estimate <= 1e-10


def test_only_folds_are_confirmed(orbit):
    with pytest.raises(InputError, match="must be a fold"):
        confirmed(SpecialPoint("superstable", orbit("switch", 0.3), ""), "gain", Options())


def test_a_point_off_the_fold_is_refused(orbit):
    with pytest.raises(NoOrbit, match="not confirmed"):
        confirmed(SpecialPoint("fold", orbit("switch", 0.64), ""), "gain", Options(tol=1e-9))


def test_folds_do_not_depend_on_what_was_computed_before(orbit):
    """Many structures in between push graphs out of the caches; the Hessian must not outlive its symbols."""
    from casahunt.collocation.graphs import graphs
    from casahunt.collocation.ipopt import _ipopt_solver

    first = find_fold(table1.servo(), "switch", options=Options(tol=1e-9))
    graphs.cache_clear()
    _ipopt_solver.cache_clear()
    again = find_fold(table1.servo(), "switch", options=Options(tol=1e-9))
    assert (first.gain, first.confirmed_gain) == (again.gain, again.confirmed_gain)


def test_sharp_fold_of_stronger_friction():
    """At Fs = 0.66 the slip nearly stops half-way and the fold is 1e-7 wide."""
    fold = find_fold(Servo().replace(**{"friction.static": 0.66}), "switch")
    assert fold.gain == pytest.approx(1.5630575602628222, rel=1e-6)
    assert fold.confirmed_gain == pytest.approx(1.5630575602628222, rel=1e-6)


@pytest.mark.slow
def test_a_servo_whose_cycles_exist_in_a_narrow_range_of_gains():
    """The loop is unstable without dry friction up to gain 7.8; cycles exist from about 3.9 to the fold, less than a
    factor of two.  The fold by scripts/peers/stick_map.py: the peak of P(a)/a, bisected in the gain."""
    servo = Servo().replace(**{
        "servo.inertia": 0.19764950539205736, "servo.motor_gain": 1.9805829914128932,
        "controller.lead_time": 0.049815533087248086, "controller.integral_time": 0.12751686526427994,
        "friction.static": 0.10159275269823816, "friction.coulomb": 0.0514265195985105,
        "friction.stribeck_velocity": 0.04042218005192416, "friction.viscous": 0.34532947296876604,
    })  # fmt: skip
    fold = find_fold(servo, "switch")
    assert fold.gain == pytest.approx(4.66243113482, rel=1e-6)


def test_large_multipliers_agree_between_half_and_full_cycle():
    """mu = 2.3249402192253e14 in 50-digit arithmetic (finite differences of the event map, four widths)."""
    servo = Servo().replace(**{"friction.static": 0.7})
    half = find_orbit(servo, "switch", 1.0, branch="unstable", options=Options(tol=1e-9))
    assert half.half_multiplier == pytest.approx(2.3249402192253e14, rel=1e-7)
    full = find_orbit(servo, "switch", 1.0, branch="unstable", options=Options(tol=1e-9, half=False))
    assert full.multipliers.leading.real == pytest.approx(half.half_multiplier**2, rel=1e-6)


CHANGES = {
    "friction.static": 0.7, "servo.inertia": 0.005, "controller.lead_time": 1.0, "friction.stribeck_velocity": 0.005,
}  # fmt: skip
SHARP = {
    "friction.static": 1.8356866843721514, "servo.inertia": 0.5996330494368986,
    "controller.lead_time": 0.0764807897312936, "friction.stribeck_velocity": 2.5109368512791120,
}  # fmt: skip
"""Fold gains of the Switch servo with one of these changes, by the event map to 28 digits."""
SLOW = {("lugre", "servo.inertia"), ("lugre", "friction.stribeck_velocity")}


@pytest.mark.parametrize(
    ("model", "changes"),
    [
        pytest.param(m, {k: v}, id=f"{k.split('.')[1]}-{m}", marks=[pytest.mark.slow] * ((m, k) in SLOW))
        for m in ("switch", "lugre") for k, v in CHANGES.items()
    ],
)  # fmt: skip
def test_folds_where_the_slip_nearly_stops_half_way(model, changes):
    """Next to these folds the motion changes altogether while amplitude and gain move by 1e-7."""
    fold = find_fold(Servo().replace(**changes), model, options=Options(tol=1e-9))
    if model == "switch":
        (truth,) = (SHARP[name] for name in changes)
        assert fold.gain == pytest.approx(truth, rel=1e-9) and fold.confirmed_gain == pytest.approx(truth, rel=1e-9)
        return
    finer = find_fold(Servo().replace(**changes), model, options=Options(tol=1e-10))  # no fold of the other engine
    assert fold.gain == pytest.approx(finer.gain, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(0, 30, 2))
def test_folds_of_servos_never_seen(seed):
    """A range far beyond Table 1: friction drop, Stribeck velocity, damping, inertia and controller times."""
    rng = np.random.default_rng(1000 + seed)

    def between(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    changes = {
        "friction.static": float(rng.uniform(0.46, 0.9)),
        "friction.stribeck_velocity": between(0.003, 0.1),
        "friction.viscous": float(rng.uniform(0, 1)),
        "servo.inertia": between(0.005, 0.2),
        "controller.lead_time": between(0.05, 1),
        "controller.integral_time": between(0.05, 1),
    }
    servo = Servo().replace(**changes)
    try:
        fold = find_fold(servo, "switch", options=Options(tol=1e-8))
    except NoOrbit as refusal:  # one servo of the thirty: no motion of the other engine grows either
        assert refusal.status is None and "no hunting limit cycle" in str(refusal)
        for gain in routh_hurwitz_gain(servo) * np.array([0.01, 0.1, 1.0, 10.0]):
            unit = servo.friction.static / servo.torque_gains(gain)[0]
            for a in unit * np.geomspace(1e-3, 3, 25):
                assert taylor.switch_half_cycle(servo, gain, a)[0] < a
        return
    assert fold.status.ok
    # By the other engine nothing near grows a millionth above.
    offsets = np.geomspace(1e-7, 1e-2, 6)
    for a in fold.orbit.amplitude * (1 + np.concatenate([-offsets, [0.0], offsets])):
        assert taylor.switch_half_cycle(servo, fold.gain * (1 + 1e-6), a)[0] < a


@pytest.mark.slow
def test_gains_at_which_a_proof_denies_are_not_scanned():
    """(kd + sigma2 - s) kp/ki > J holds from one gain on: below it the search scans, above it the proof speaks."""
    servo = NEVER_HUNTS.replace(**{"friction.coulomb": 0.44, "friction.viscous": 0.28})
    f, c = servo.friction, servo.controller
    steepest = math.sqrt(2 / math.e) * (f.static - f.coulomb) / f.stribeck_velocity
    proved_from = (servo.inertia / c.reset_time + steepest - f.viscous) / (servo.motor_gain * c.lead_time)
    with pytest.raises(NoOrbit, match="does not prove") as refused:
        find_fold(servo, "switch")
    assert refused.value.status is Status.NOT_FOUND
    scanned = r"gains from .* to (\S+) were scanned .* from gain (\S+) up .* provably has none"
    said = re.search(scanned, str(refused.value))
    assert float(said[1]) < proved_from < float(said[2])


# Friction rises with speed everywhere, so that it does not hunt; at tiny gains swings come back to 0.98 of their size.
NEVER_HUNTS = Servo().replace(
    **{
        "friction.static": 0.46, "friction.stribeck_velocity": 0.075, "friction.viscous": 0.59,
        "servo.inertia": 0.054, "controller.lead_time": 0.233, "controller.integral_time": 0.462,
    }
)  # fmt: skip


def test_swings_that_hardly_shrink_are_no_cycle():
    """P(a)/a is next to one over decades of a and crosses it nowhere: no short cut to a fixed point, and no claim."""
    gain = 5e-6
    unit = NEVER_HUNTS.friction.static / NEVER_HUNTS.torque_gains(gain)[0]
    for a in unit * np.array([0.015, 0.1]):
        assert 0 < taylor.switch_half_cycle(NEVER_HUNTS, gain, a)[0] / a < 0.99
    assert near_stable(StickMap("switch", NEVER_HUNTS, gain), 0.1 * unit) is None
    # Its friction rises so steeply that it is proved to have no cycle.
    with pytest.raises(NoOrbit, match="no hunting .* at any gain: the friction curve") as refused:
        find_fold(NEVER_HUNTS, "switch")
    assert refused.value.status is None


@pytest.mark.slow
def test_grazing_is_located():
    """Orbits started afresh on both sides have another number of phases, and what one has more vanishes there.

    Its duration T goes like a square root: K = K* - a T^2 - b T^3 - c T^4, by four of these orbits.
    """
    servo = Servo()
    branch = diagram(servo, "lugre", start=0.1, monitors=(FOLD, GRAZING))
    dying = [s.orbit for s in branch.special if s.kind == "grazing" and s.orbit.stable]
    assert dying
    for orbit in dying:
        below, above = (find_orbit(servo, "lugre", orbit.gain * factor) for factor in (0.99, 1.01))
        assert len(below.arcs) == len(above.arcs) + 2
        gains = orbit.gain * np.array([0.96, 0.97, 0.98, 0.99])
        fresh = [find_orbit(servo, "lugre", gain, options=Options(tol=1e-9)) for gain in gains]
        T = np.array([min(arc.duration for arc in each.arcs) for each in fresh])
        vanishes = np.linalg.solve((T[:, None] / T[0]) ** [0, 2, 3, 4], gains)[0]
        assert orbit.gain == pytest.approx(vanishes, rel=2e-5)
        assert len(orbit.arcs) == len(above.arcs)


def test_what_the_event_map_shows_next_to_a_place():
    """At gain 0.1 the map of Table 1 has a fixed point where the stable cycle sticks; above the fold, none there."""
    a = stick_position(find_orbit(Servo(), "switch", 0.1))
    assert _has_fixed_point(Servo(), 0.1, a)
    assert not _has_fixed_point(Servo(), 0.1, 12 * a)
    assert not _has_fixed_point(Servo(), 0.7, a)
