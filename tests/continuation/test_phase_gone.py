"""The phase that a cycle has besides its longest one vanishes at a grazing: the branch goes on without any event.

The truths are by an integrator of others: the cycle that meets no event, and where its largest value is the level.
"""

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

from casahunt.continuation import follow
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

TIGHT = {"rtol": 1e-13, "atol": 1e-15, "method": "DOP853"}


def harvest(capacity, death):
    """Prey and predator; the predator is harvested above a threshold T, on which it slides."""

    def growth(x):
        return x.x / (1 + x.x) - death

    def field(effort):
        return lambda x, p: {
            "x": x.x * (1 - x.x / capacity) - x.x * x.y / (1 + x.x),
            "y": x.y * (growth(x) - effort * 0.5),
        }

    def into(x, p):
        return "free" if growth(x) <= 0 else "harvested" if growth(x) >= 0.5 else "slide"

    def level(x, p):
        return x.y / p.T - 1

    leaves = (
        Event("down", lambda x, p: growth(x) / death, -1, to="free"),
        Event("up", lambda x, p: (growth(x) - 0.5) / death, +1, to="harvested"),
    )
    modes = (
        Mode("free", field(0), ends=(Event("reach", level, +1, to=into),)),
        Mode("harvested", field(1), ends=(Event("fall", level, -1, to=into),)),
        Mode("slide", lambda x, p: {**field(0)(x, p), "y": 0 * x.y}, ends=leaves),
    )
    return System("harvest", ("x", "y"), {"T": 1.0}, modes)


def most_predators(capacity, death):
    """The largest value of the predator on the cycle that is never harvested."""

    def field(t, z):
        eaten = z[0] / (1 + z[0])
        return [z[0] * (1 - z[0] / capacity) - eaten * z[1], z[1] * (eaten - death)]

    def top(t, z):
        return z[0] / (1 + z[0]) - death

    top.direction = -1
    return float(solve_ivp(field, (0, 300), [1.0, 0.5], events=top, **TIGHT).y_events[0][-1, 1])


@pytest.mark.parametrize(("capacity", "death"), [(4.0, 0.4), pytest.param(5.0, 0.45, marks=pytest.mark.slow)])
def test_a_slide_that_is_grazed_vanishes_and_the_free_cycle_goes_on(capacity, death):
    system, truth = harvest(capacity, death), most_predators(capacity, death)
    start = find_cycle(system, "free", x=1.0, y=0.5, parameters={"T": 0.6 * truth}, tol=1e-9)
    branch = follow(start, "T", to=1.2 * truth)
    (grazing,) = branch.special
    assert (branch.end.kind, grazing.kind, branch.missed) == ("range", "grazing", ())
    assert grazing.value == pytest.approx(truth, rel=1e-10)
    assert abs(grazing.value - truth) <= 3 * grazing.error + 1e-12
    for orbit in branch.orbits:
        assert any(arc.mode == "slide" for arc in orbit.arcs) == (orbit.problem.value("T") < grazing.value)


@pytest.mark.slow
def test_the_same_from_next_to_the_grazing_on():
    """The phase is short from the first cycle on: no step shows that it becomes so."""
    truth = most_predators(4.0, 0.4)
    start = find_cycle(harvest(4.0, 0.4), "free", x=1.0, y=0.5, parameters={"T": 0.9995 * truth}, tol=1e-9)
    branch = follow(start, "T", to=1.1 * truth)
    assert [special.kind for special in branch.special] == ["grazing"] and branch.end.kind == "range"
    assert branch.special[0].value == pytest.approx(truth, rel=1e-9)


# A stop on a base that slides when it is hit ------------------------------------------------------------------------

DAMPING, RUB, OMEGA, BOUNCE = 0.04, 3.17, 0.92, 0.8
TURN = np.pi / OMEGA


def pull(x, p):
    return p.V**2 * casadi.sin(OMEGA * x.t) ** 2 / (1 - x.x) ** 2 - DAMPING * x.v - x.x


def stop_on_a_base(mass):
    """x'' = V^2 sin^2(w t)/(1 - x)^2 - c x' - x meets a stop at x = 0.5, whose base slides when it is hit."""

    def bounce(x, p):
        return {"s": x.s + (1 + BOUNCE) / (1 + mass) * x.v, "v": -BOUNCE * x.v}

    def gap(x, p):
        return 0.5 - x.x

    def slides(x, p):
        return {"s": -RUB - pull(x, p) / mass, "x": x.v, "v": RUB + (1 + 1 / mass) * pull(x, p)}

    sticks = Mode("stick", lambda x, p: {"s": -x.s, "x": x.v, "v": pull(x, p)},
                  ends=(Event("collision", gap, -1, to="slip", reset=bounce),))  # fmt: skip
    rest = Event("rest", lambda x, p: x.s, -1, to="stick", reset=lambda x, p: {"s": 0})
    slips = Mode("slip", slides, ends=(rest, Event("again", gap, -1, to="slip", reset=bounce)))
    return System("stop", ("s", "x", "v"), {"V": 0.5}, (sticks, slips), forcing_period=lambda p: TURN)


def free_turn(z, V):
    """(state, its derivative by the first one, largest x) a turn later, where nothing is hit."""

    def field(t, y):
        push = V**2 * np.sin(OMEGA * t) ** 2
        slope = np.array([[0, 1], [2 * push / (1 - y[0]) ** 3 - 1, -DAMPING]])
        return [y[1], push / (1 - y[0]) ** 2 - DAMPING * y[1] - y[0], *(slope @ y[2:].reshape(2, 2)).ravel()]

    def top(t, y):
        return y[1]

    top.direction = -1
    found = solve_ivp(field, (0, TURN), [*z, 1, 0, 0, 1], events=top, **TIGHT)
    return found.y[:2, -1], found.y[2:, -1].reshape(2, 2), float(np.max(found.y_events[0][:, 0]))


def fold_and_grazing():
    """V of the fold of the cycles that hit nothing, and of the one behind it that just reaches the stop."""

    def fold(unknown):
        after, M, _ = free_turn(unknown[:2], unknown[2])
        return [*(unknown[:2] - after), np.linalg.det(M - np.eye(2))]

    def grazing(unknown):
        after, _, top = free_turn(unknown[:2], unknown[2])
        return [*(unknown[:2] - after), top - 0.5]

    at_fold = fsolve(fold, [0.4957, -0.0052, 0.5875], xtol=1e-12)
    return at_fold[2], fsolve(grazing, at_fold, xtol=1e-12)[2]


@pytest.mark.slow
@pytest.mark.parametrize("mass", [5.0, 8.0])
def test_an_impact_that_sets_the_base_sliding_begins_at_a_grazing_and_ends_there(mass):
    """Forwards and back again: the same fold and the same grazing, whatever the base weighs."""
    fold, grazing = fold_and_grazing()
    system = stop_on_a_base(mass)
    there = follow(find_cycle(system, "stick", s=0.0, x=0.1, v=0.0, t=0.0, tol=1e-9), "V", to=0.65)
    assert [special.kind for special in there.special] == ["fold", "grazing"] and there.end.kind == "range"
    back = follow(there.orbits[-1], "V", to=0.55)
    assert [special.kind for special in back.special] == ["grazing", "fold"] and back.end.kind == "range"
    for branch in (there, back):
        assert branch.missed == ()
        for special in branch.special:
            truth = fold if special.kind == "fold" else grazing
            assert special.value == pytest.approx(truth, abs=1e-8)
            assert abs(special.value - truth) <= 3 * special.error + 1e-11
        for orbit in branch.orbits:
            slides = any(arc.mode == "slip" for arc in orbit.arcs)
            assert not slides or orbit.problem.value("V") >= grazing - 1e-8


# A relay that waits ---------------------------------------------------------------------------------------------------


def relay_with_dwell(spring):
    """x'' = -k x - x' -+ 1, switched where x = +-0.3 is crossed, but not before a time d since the last switch."""

    def plant(clock):
        return lambda x, p: {"x": x.v, "v": -spring * x.x - x.v - p.sign, "c": clock + 0 * x.c}

    def modes(name, other, sign):
        def above(x, p):
            return sign * x.x + 0.3

        dwelt = Event(
            f"{name} dwelt",
            lambda x, p: x.c / p.d - 1,
            +1,
            to=lambda x, p: f"{name} armed" if above(x, p) > 0 else f"{other} dwells",
            reset=lambda x, p: {"c": 0.0},
        )
        crosses = Event(f"{name} crosses", above, -1, to=f"{other} dwells")
        return (
            Mode(f"{name} dwells", plant(1.0), sign=sign, ends=(dwelt,)),
            Mode(f"{name} armed", plant(0.0), sign=sign, ends=(crosses,)),
        )

    system = System("relay", ("x", "v", "c"), {"d": 0.5}, (*modes("up", "down", 1), *modes("down", "up", -1)))
    return find_cycle(system, "up dwells", x=0.5, v=0.3, c=0.0, tol=1e-9)


def test_a_waiting_that_vanishes_is_a_named_end_where_one_of_many_begins():
    """Without a spring any offset has its cycle beyond: the half period is that of t - 2 tanh(t/2) = 0.6."""
    half = brentq(lambda t: t - 2 * np.tanh(t / 2) - 0.6, 1, 4, xtol=1e-14)
    branch = follow(relay_with_dwell(0.0), "d", to=4.0)
    (special,) = branch.special
    assert branch.end.kind == special.kind == "grazing" and "armed' shrinks to nothing" in branch.ended
    assert special.value == pytest.approx(half, abs=1e-8)
    assert max(abs(special.value - half), abs(branch.end.value - half)) <= 3 * special.error


def test_two_waits_vanish_together_and_the_clocked_cycle_goes_on():
    """With a spring it is one alone; the half period of the relay that does not wait tells where."""
    start = relay_with_dwell(0.5)
    branch = follow(start, "d", to=2.2)
    (special,) = branch.special
    assert branch.end.kind == "range" and branch.orbits[-1].period == pytest.approx(4.4, rel=1e-9)
    assert special.value == pytest.approx(start.period / 2, rel=1e-7)
    assert abs(special.value - start.period / 2) <= 3 * special.error
