"""Cycles followed to their births (problems/hopf_like.py): named, located, by the laws of the closed forms.

The closed forms themselves are held against scipy's integration of the same fields, and against their own laws.
"""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from problem_support import HONEST, ROUNDING
from scipy.integrate import solve_ivp

from casahunt.continuation import follow
from casahunt.orbits import Options
from problems import boundary_equilibria, folds_and_foci, kicks_and_relays

BIRTHS = (*boundary_equilibria.BIRTHS, *folds_and_foci.BIRTHS, *kicks_and_relays.BIRTHS)
QUICK = (
    "continuous, focus to focus", "stop, focus before it", "slipping folds", "fixed foci", "fixed folds", "impulsive",
    "hysteresis", "hysteretic folds",
)  # fmt: skip
"""Every law, births away from zero and from the origin, an impact, the worst conditioned one; the others are slow."""
every = pytest.mark.parametrize("birth", BIRTHS, ids=lambda birth: birth.name)
followed = pytest.mark.parametrize(
    "birth", [pytest.param(b, id=b.name, marks=() if b.name in QUICK else pytest.mark.slow) for b in BIRTHS]
)
LOCATED = 1e-6
"""Of the parameter at the birth, or of its distance from the start."""
FITTED = 1e-3
"""Of the exponents next to the birth: the next term of each law is of relative order d, or d^(2/3) where a = 1/3."""
LAST, SEEN = 4, 3e-2
"""Points of a branch from which the test takes exponents itself, and how well: the first of them may lie at a tenth of
the distance from where the branch begins, where the next term is as large as that."""
TOLERANCE = 1e-8


def _named(x):
    return SimpleNamespace(x=x[0], y=x[1])


def _round(birth, value, at):
    """(time, state) after every mode once, from a state where the first one begins; by scipy."""
    p, modes = SimpleNamespace(**{birth.vary: value}), {mode.name: mode for mode in birth.system.modes}
    mode, time, state = modes[birth.mode], 0.0, np.array(at)
    for _ in modes:
        (exit_,) = mode.ends

        def field(t, x, mode=mode):
            rates = mode.field(_named(x), p)
            return [rates["x"], rates["y"]]

        def level(t, x, exit_=exit_):
            return exit_.function(_named(x), p)

        level.terminal, level.direction = True, exit_.direction
        how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "max_step": 0.2}
        motion = solve_ivp(field, (0, 100), state, events=level, **how)
        time, state = time + motion.t[-1], motion.y[:, -1]
        jumps = {} if exit_.reset is None else exit_.reset(_named(state), p)
        state = np.array([jumps.get(name, old) for name, old in zip(("x", "y"), state, strict=True)])
        mode = modes[exit_.to]
    return time, state


@every
def test_closed_forms_against_an_integration(birth):
    period, *at = birth.turn(birth.begin)
    time, state = _round(birth, birth.begin, at)
    assert time == pytest.approx(period, rel=1e-10)
    assert state == pytest.approx(at, rel=1e-9, abs=1e-10)


@every
def test_laws_of_the_closed_forms(birth):
    """Exponents over four decades, and the constants in front of them."""
    d = np.geomspace(1e-3, 1e-7, 9)
    values = birth.value + np.sign(birth.begin - birth.value) * d
    d = np.abs(values - birth.value)  # what is left of it in the numbers
    turns = np.array([birth.turn(value) for value in values])
    i = birth.system.states.index(birth.measure)
    laws = zip(birth.exponents, birth.limits, (np.abs(turns[:, 1 + i] - birth.point[i]), turns[:, 0]), strict=True)
    for exponent, limit, size in laws:
        assert np.polyfit(np.log(d), np.log(size), 1)[0] == pytest.approx(exponent, abs=FITTED)
        assert size[-1] == pytest.approx(limit * d[-1] ** exponent, rel=1e-4)


@lru_cache
def _followed(birth):
    return follow(birth.cycle(), birth.vary, to=2 * birth.value - birth.begin, options=Options(tol=TOLERANCE))


@followed
def test_named_and_located(birth):
    end = _followed(birth).end
    assert end.kind == "shrinks to a point", end.sentence
    assert end.value == pytest.approx(birth.value, abs=LOCATED * max(abs(birth.value), abs(birth.begin - birth.value)))
    assert (end.exponent, end.period_exponent) == pytest.approx(birth.exponents, abs=FITTED)


@followed
def test_branch_obeys_the_laws_and_meets_nothing(birth):
    branch = _followed(birth)
    assert not branch.special, "nothing is invented on the way"
    assert not branch.missed
    d = np.sign(birth.begin - birth.value) * (branch.values - birth.value)
    assert d.min() > 0, "no cycle lies beyond its birth"
    ends = [orbit.extrema(birth.measure) for orbit in branch.orbits]
    extents = np.array([end.high.value - end.low.value for end in ends])
    for exponent, size in zip(birth.exponents, (extents, branch.periods), strict=True):
        slope = np.polyfit(np.log(d[-LAST:]), np.log(size[-LAST:]), 1)[0]
        assert slope == pytest.approx(exponent, abs=SEEN)


@followed
def test_cycles_keep_the_tolerance(birth):
    """Also where a multiplier comes to one and the cycle is small beside the one at which the branch has begun.

    Along a branch the parameter is an unknown, known to the tolerance of its unit: at a distance d from the birth a
    period that goes like d^b moves by b/d times that.
    """
    branch = _followed(birth)
    truth = np.array([birth.turn(value).period for value in branch.values])
    units = np.array([orbit.problem.unit(birth.vary) for orbit in branch.orbits])
    moved = birth.exponents[1] * units / np.abs(branch.values - birth.value)
    assert np.all(np.abs(branch.periods / truth - 1) <= TOLERANCE * (1 + moved))


@every
def test_cycle_where_it_begins(birth):
    orbit = birth.cycle()
    assert orbit.period == pytest.approx(birth.turn(birth.begin).period, rel=HONEST * orbit.period_error + ROUNDING)
    assert orbit.stable != birth.settled
