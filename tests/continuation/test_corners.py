"""Contacts behind which a branch turns back: corners of it, against maps of one turn by integrators of others."""

from __future__ import annotations

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from casahunt.continuation import follow, largest, smallest
from casahunt.errors import NoOrbit
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

GROWTH = 0.05
TIGHT = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"}


def turns(x, p, more=0.0):
    grows = GROWTH * (p.p + more - x.x**2 - x.y**2)
    return {"x": x.y + x.x * grows, "y": -x.x + x.y * grows}


def kicked(k, left=None):
    """The circle of radius sqrt(p); where it rises through x = 1, and falls through x = -left, y is multiplied by k."""
    ends = [Event("kick", lambda x, p: x.x - 1, +1, to="turns", reset=lambda x, p: {"y": p.k * x.y})]
    if left is not None:
        ends += [Event("left", lambda x, p: x.x + left, -1, to="turns", reset=lambda x, p: {"y": p.k * x.y})]
    return System("kicked", ("x", "y"), {"p": 0.5, "k": k}, (Mode("turns", turns, ends=tuple(ends)),))


def held(k):
    """The same, but that beyond x = 1 there is another mode, and the kick comes on the way back."""
    back = Event("back", lambda x, p: x.x - 1, -1, to="in", reset=lambda x, p: {"y": p.k * x.y})
    modes = (
        Mode("in", turns, ends=(Event("out", lambda x, p: x.x - 1, +1, to="out"),)), Mode("out", turns, ends=(back,))
    )  # fmt: skip
    return System("held", ("x", "y"), {"p": 0.5, "k": k}, modes)


def kicked_orbit(v, k, way=1):
    """(p, least x) of the cycle that is kicked once in a turn, at the speed v, on the right; way: -1 if coming back."""

    def level(_, z):
        return z[0] - 1

    level.terminal, level.direction = True, way

    def round_to_it(p):
        def rate(_, z):
            grows = GROWTH * (p - z @ z)
            return [z[1] + z[0] * grows, -z[0] + z[1] * grows]

        most = solve_ivp(rate, (0, 5), [1, way * k * v], dense_output=True, **TIGHT)  # but for the way up to the level
        return most.sol, solve_ivp(rate, (5, 8), most.y[:, -1], events=level, max_step=0.02, **TIGHT)

    def faster(p):
        found = round_to_it(p)[1]
        return (way * found.y[1, -1] if found.t_events[0].size else -1.0) - v

    p = brentq(faster, 0.3, 6.0, xtol=1e-12)
    most = round_to_it(p)[0]
    least = minimize_scalar(lambda t: most(t)[0], bounds=(2.5, 5), method="bounded", options={"xatol": 1e-9})
    return p, least.fun


def lowest(k, upto=1.0, way=1):
    """p at the fold of the cycles that are kicked once."""
    best = minimize_scalar(lambda v: kicked_orbit(v, k, way)[0], bounds=(0.02, upto), method="bounded")
    return best.fun


def largest_gap(branch):
    """By how much of its range a state changes at most where the phases do."""
    sizes = [np.ptp(orbit.sample()[1][:2], axis=1) for orbit in branch.orbits]
    pairs = zip(branch.orbits, branch.orbits[1:], sizes, sizes[1:], strict=False)
    return max(np.max(abs(b / a - 1)) for one, other, a, b in pairs if one.signature != other.signature)


@pytest.fixture(scope="module")
def behind():
    """The branch of k = 1.5 up to beyond its corner and fold."""
    return follow(find_cycle(kicked(1.5), x=0.7, y=0.0), "p", to=2.0)


def test_a_branch_turns_back_at_a_contact(behind):
    """The circle meets the level at p = 1; those that are kicked begin there and go down first."""
    assert [special.kind for special in behind.special] == ["grazing", "fold"] and not behind.missed
    corner, fold = behind.special
    assert corner.value == pytest.approx(1.0, abs=1e-11) and "p turns back there" in corner.meaning
    assert fold.value == pytest.approx(lowest(1.5), abs=1e-9)
    assert largest_gap(behind) < 1e-2
    for orbit in behind.orbits:
        kicks = [arc for arc in orbit.arcs if arc.event == "kick"]
        if kicks and kicks[0].end[1] > 0.05:
            assert orbit.problem.value("p") == pytest.approx(kicked_orbit(kicks[0].end[1], 1.5)[0], abs=1e-6)


def test_the_largest_value_at_a_corner_is_no_fold(behind):
    with pytest.raises(NoOrbit, match="turns back at its largest p = 1, about, where its phases change: no fold"):
        largest(behind.orbits[0], "p", to=2.0)
    with pytest.raises(NoOrbit, match="has no largest p"):
        largest(behind.orbits[0], "p", to=0.9)


def test_back_round_the_fold_to_the_corner_and_on(behind):
    """From behind, downwards: a step leads from the cycles that are kicked straight to the circle, and is not taken."""
    back = follow(behind.orbits[-1], "p", to=0.6)
    assert [special.kind for special in back.special] == ["fold", "grazing"] and not back.missed
    assert back.special[0].value == pytest.approx(behind.special[1].value, abs=1e-9)
    assert back.special[1].value == pytest.approx(1.0, abs=1e-6) and back.end.kind == "range"
    assert len(back.orbits[-1].arcs) < len(back.orbits[0].arcs) and largest_gap(back) < 1e-2


def test_a_phase_is_born_and_vanishes_at_a_corner():
    """Up to where it begins, back down with it to the fold, and on up; and all of that the other way round."""
    there = follow(find_cycle(held(1.5), x=0.7, y=0.0), "p", to=2.0)
    back = follow(there.orbits[-1], "p", to=0.6)
    for corner, fold in (there.special, back.special[::-1]):
        assert corner.kind == "grazing" and corner.value == pytest.approx(1.0, abs=1e-8)
        assert "p turns back there" in corner.meaning
        assert fold.kind == "fold" and fold.value == pytest.approx(lowest(1.5, way=-1), abs=1e-9)
    assert back.end.kind == "range" and not there.missed + back.missed


@pytest.mark.slow
def test_natural_steps_end_at_a_corner():
    branch = follow(find_cycle(kicked(2.0), x=0.7, y=0.0), "p", to=2.0, natural=True)
    assert branch.end.kind == "grazing" and "turns back" in branch.ended
    assert branch.end.value == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("k", [0.5, 1.2])
def test_where_it_does_not_turn_back_a_step_leads_over_the_contact(k):
    branch = follow(find_cycle(kicked(k), x=0.7, y=0.0), "p", to=2.0)
    assert [special.kind for special in branch.special] == ["grazing"] and not branch.missed
    assert np.all(np.diff(branch.values) > 0) and "turns" not in branch.special[0].meaning


@pytest.mark.slow
@pytest.mark.parametrize("k", [1.38, 2.0])
def test_the_way_back_may_be_short_or_long(k):
    """1e-4 of p, and a fifth."""
    branch = follow(find_cycle(kicked(k), x=0.7, y=0.0), "p", to=2.0)
    assert [special.kind for special in branch.special] == ["grazing", "fold"] and not branch.missed
    assert branch.special[1].value == pytest.approx(lowest(k, upto=0.3 if k < 1.5 else 1.0), abs=1e-8)


@pytest.mark.slow
def test_two_corners_one_after_the_other():
    """On the right first; the cycle that is kicked there reaches the left, and turns back there again."""
    branch = follow(find_cycle(kicked(1.6, left=1.3), x=0.7, y=0.0), "p", to=2.0)
    assert [special.kind for special in branch.special] == ["grazing", "fold", "grazing", "fold"] and not branch.missed
    reaches = brentq(lambda v: kicked_orbit(v, 1.6)[1] + 1.3, 0.3, 0.9, xtol=1e-12)
    values = [special.value for special in branch.special]
    np.testing.assert_allclose(values[:3], [1.0, lowest(1.6), kicked_orbit(reaches, 1.6)[0]], atol=1e-7)
    assert sum("turns back there" in special.meaning for special in branch.special) == 2 and largest_gap(branch) < 1e-2


# Beside a wall ------------------------------------------------------------------------------------------------------

REBOUND, DAMPING = 0.8, 0.05


def wall(w):
    hit = Event("impact", lambda x, p: x.x - 1, +1, to="free", reset=lambda x, p: {"v": -REBOUND * x.v})

    def free(x, p):
        return {"x": x.v, "v": p.A * casadi.cos(w * x.t) - 2 * DAMPING * x.v - x.x}

    return System("wall", ("x", "v"), {"A": 1.0}, (Mode("free", free, ends=(hit,)),),
                  forcing_period=lambda p: 2 * np.pi / w)  # fmt: skip


def push(v, w):
    """A of the motion that hits the wall at the speed v once in a turn, in closed form."""
    decay = complex(-DAMPING, np.sqrt(1 - DAMPING**2))
    swing = np.exp(decay * 2 * np.pi / w)
    # x = Re(c e^(decay t)) + Re(f e^(iwt)): over a turn only the first part changes, by (0, (1 + r) v)
    basis = np.array([[1, 1], [decay, decay.conjugate()]])
    free = np.linalg.solve(basis @ np.diag([swing - 1, swing.conjugate() - 1]), [0, (1 + REBOUND) * v])
    x, speed = (np.array([1, -REBOUND * v]) - basis @ free).real
    return abs((x - 1j * speed / w) * (1 - w**2 + 2j * DAMPING * w))


@pytest.mark.parametrize("w", [1.8, *(pytest.param(w, marks=pytest.mark.slow) for w in (0.9, 1.1))])
def test_an_impact_begins_where_the_wall_is_touched(w):
    """Beyond resonance the cycles that hit the wall begin downwards, below it upwards."""
    touched = push(0.0, w)
    branch = follow(find_cycle(wall(w), x=0.0, v=0.0, parameters={"A": 0.7 * touched}), "A", to=1.2 * touched,
                    back=0.3 * touched)  # fmt: skip
    assert branch.special[0].kind == "grazing" and branch.special[0].value == pytest.approx(touched, rel=1e-8)
    assert ("turns back" in branch.special[0].meaning) == (push(1e-4, w) < touched)
    folds = [special.value for special in branch.special if special.kind == "fold"]
    best = minimize_scalar(lambda v: push(v, w), bounds=(0, 6), method="bounded", options={"xatol": 1e-10})
    assert folds == pytest.approx([best.fun] if push(1e-4, w) < touched else [], rel=1e-9)
    for orbit in branch.orbits:
        for arc in orbit.arcs:
            if arc.event == "impact":
                assert orbit.problem.value("A") == pytest.approx(push(arc.end[1], w), rel=1e-7)
    assert largest_gap(branch) < 0.05


def test_a_leap_that_is_one_is_said_to_be():
    """Outside x = 1 the field points outwards: a cycle that touches it is thrown out, and none next to it is."""
    modes = (
        Mode("in", turns, ends=(Event("out", lambda x, p: x.x - 1, +1, to="outside"),)),
        Mode("outside", lambda x, p: turns(x, p, 2.0), ends=(Event("back", lambda x, p: x.x - 1, -1, to="in"),)),
    )
    branch = follow(find_cycle(System("thrown", ("x", "y"), {"p": 0.5}, modes), x=0.7, y=0.0), "p", to=1.5)
    assert [missed.kind for missed in branch.missed] == ["grazing"] and "not known" in branch.missed[0].meaning
    with pytest.raises(NoOrbit, match="no largest p .* no cycle with those behind was found"):
        largest(branch.orbits[0], "p", to=1.5)


def test_the_smallest_value_is_at_the_fold_behind_the_corner(behind):
    assert smallest(behind.orbits[-1], "p", to=0.9).value == pytest.approx(lowest(1.5), abs=1e-9)


# A phase with no duration at the end of a branch ---------------------------------------------------------------------


def left_by(way, growth):
    """The circle of radius 1; from where a scalar rises through q it grows, until y falls through 0, next to (1, 0)."""

    def turning(x, p):
        grows = 0.5 * (1 - x.x**2 - x.y**2)
        return {"x": x.y + grows * x.x, "y": -x.x + grows * x.y}

    def growing(x, p):
        return {"x": x.y + growth * x.x, "y": -x.x + growth * x.y}

    out, back = Event("out", lambda x, p: way(x) - p.q, +1, to="out"), Event("back", lambda x, p: x.y, -1, to="in")
    modes = Mode("in", turning, ends=(out,)), Mode("out", growing, ends=(back,))
    return find_cycle(System("circle", ("x", "y"), {"q": 0.8}, modes), "in", x=-1.0, y=0.0)


def test_a_branch_ends_with_a_phase_and_its_parameter_does_not_turn():
    """q goes like the duration: past 1 y falls through 0 a turn later, and that is another cycle, twice as long."""
    orbit = left_by(lambda x: x.x - x.y, 0.3)
    branch = follow(orbit, "q", to=2.0)
    assert branch.end.kind == "grazing" and branch.end.value == pytest.approx(1.0, abs=1e-7)
    assert np.all(np.diff(branch.values) > 0) and not branch.missed
    with pytest.raises(NoOrbit, match="has no largest q"):
        largest(orbit, "q", to=2.0)


@pytest.mark.parametrize("growth", [0.0, 0.3, 3.0])
def test_a_parameter_turns_where_a_phase_has_next_to_no_duration(growth):
    """1/r^2 - 1 dies out like e^-t, and q is r cos(t): largest at t = 0 where it does not grow, else just before."""

    def lacks(t):
        away, back = np.expm1(-2 * growth * t), np.exp(t - 2 * np.pi)
        return 1 - np.cos(t) / np.sqrt(1 + away * back / (1 - (1 + away) * back))

    truth = 1 - minimize_scalar(lacks, bounds=(0, 0.1), method="bounded", options={"xatol": 1e-12}).fun
    fold = largest(left_by(lambda x: x.x, growth), "q", to=2.0)
    assert fold.value == pytest.approx(truth, abs=2e-11) and fold.absolute_error < 1e-9


def test_a_wall_behind_which_no_motion_returns():
    away = Mode("gone", lambda x, p: {"x": 1.0 + 0 * x.x, "y": 0 * x.x})
    hit = Event("hit", lambda x, p: x.x - 1, +1, to="gone")
    orbit = find_cycle(System("lost", ("x", "y"), {"p": 0.5}, (Mode("turns", turns, ends=(hit,)), away)), x=0.7, y=0.0)
    with pytest.raises(NoOrbit, match="has no largest p .* grazing at p = 1: mode 'turns' meets 'hit'"):
        largest(orbit, "p", to=2.0)
