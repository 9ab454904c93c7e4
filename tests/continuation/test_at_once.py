"""Multipliers that pass the unit circle together: equal units, coupled or not, whose cycle in phase is that of one.

n oscillators u' = u - w v - r (u - c2 v) + K (mean u - u - c1 (mean v - v)), ...: across the cycle in phase the linear
equation has the characteristic polynomial s^2 + 2 (1 + K) s + K ((1 + c1^2) K + 2 (1 + c1 c2)), n - 1 times; s = 0 at
K = -2 (1 + c1 c2)/(1 + c1^2).  Beside x^2 + y^2 = 1 linear parts with rates of their own pass at the zeros of those.
"""

import re
from dataclasses import replace

import casadi
import numpy as np
import pytest

from casahunt import NoOrbit
from casahunt.continuation import bifurcations, branch_off, follow
from casahunt.hybrid import Mode, System
from casahunt.hybrid.examples import ball
from casahunt.orbits import find_cycle

C1, C2 = 2.0, -2.0


def coupled(many):
    def field(x, p):
        u = [getattr(x, f"u{k}") for k in range(many)]
        v = [getattr(x, f"v{k}") for k in range(many)]
        out = {}
        for k in range(many):
            r, du, dv = u[k] ** 2 + v[k] ** 2, sum(u) / many - u[k], sum(v) / many - v[k]
            out[f"u{k}"] = u[k] - p.w * v[k] - r * (u[k] - C2 * v[k]) + p.K * (du - C1 * dv)
            out[f"v{k}"] = v[k] + p.w * u[k] - r * (v[k] + C2 * u[k]) + p.K * (dv + C1 * du)
        return out

    names = tuple(f"{a}{k}" for k in range(many) for a in "uv")
    return System(f"{many} oscillators", names, {"w": 3.0, "K": 2.0}, (Mode("m", field),))


@pytest.mark.parametrize("many", [2, 3, 5])
def test_equal_units_leave_their_common_motion_together(many):
    start = {f"{a}{k}": float(a == "u") for k in range(many) for a in "uv"}
    branch = follow(find_cycle(coupled(many), start=start, tol=1e-9), "K", to=0.3)
    (special,) = branch.special
    assert special.kind == "branch point" and special.multiplicity == many - 1 and not branch.missed
    assert abs(special.value - 1.2) <= 3 * special.error < 1e-8
    assert (f"({many - 1} multipliers at once)" in special.meaning) is (many > 2)


def forced(many, unlike=0.0):
    """The branch of units that know nothing of each other, the force on each being so much larger than on the last."""

    def field(x, p):
        out = {}
        for k in range(many):
            u, v = getattr(x, f"u{k}"), getattr(x, f"v{k}")
            out |= {f"u{k}": v, f"v{k}": -0.3 * v + u - u**3 + (1 + k * unlike) * p.F * casadi.cos(1.2 * x.t)}
        return out

    names = tuple(f"{a}{k}" for k in range(many) for a in "uv")
    system = System("forced", names, {"F": 0.2}, (Mode("m", field),), forcing_period=lambda p: 2 * np.pi / 1.2)
    start = {f"{a}{k}": float(a == "u") for k in range(many) for a in "uv"} | {"t": 0.0}
    return follow(find_cycle(system, start=start, tol=1e-9), "F", to=0.28)


@pytest.mark.parametrize("many", [1, 2])
def test_equal_forced_units_flip_together(many):
    """Of one of them the flip is at 0.2655817861."""
    branch = forced(many)
    (special,) = branch.special
    assert special.kind == "flip" and special.multiplicity == many and not branch.missed
    assert abs(special.value - 0.2655817861) <= 3 * special.error + 5e-11


def test_what_branches_off_where_two_flip_at_once_is_asked_of_unlike_units():
    with pytest.raises(NoOrbit, match="several cycles branch off .* let what is equal differ a little"):
        branch_off(forced(2).special[0], "F")
    for special in forced(2, unlike=0.01).special:
        assert special.multiplicity == 1
        twice = branch_off(special, "F")
        assert twice.period == pytest.approx(2 * special.orbit.period, rel=1e-9)


def beside_a_circle(rates, pairs):
    """x^2 + y^2 = 1, and linear states: real ones that grow as `rates` of p say, and pairs of them."""

    def field(x, p):
        r = 1 - x.x**2 - x.y**2
        out = {"x": x.x * r - x.y, "y": x.y * r + x.x}
        out |= {f"u{k}": rate(p.s) * getattr(x, f"u{k}") for k, rate in enumerate(rates)}
        for k, rate in enumerate(pairs):
            a, b = getattr(x, f"a{k}"), getattr(x, f"b{k}")
            out |= {f"a{k}": rate(p.s) * a - 0.3 * b, f"b{k}": rate(p.s) * b + 0.3 * a}
        return out

    each = (*(f"u{k}" for k in range(len(rates))), *(f"{c}{k}" for k in range(len(pairs)) for c in "ab"))
    return System("beside", ("x", "y", *each), {"s": -0.15}, (Mode("m", field),))


@pytest.mark.parametrize(
    ("rates", "pairs", "met"),
    [
        ([], [lambda s: s] * 2, [("Neimark-Sacker", 0.0, 2)]),
        ([lambda s: s], [lambda s: 0.01 - s], [("branch point", 0.0, 1), ("Neimark-Sacker", 0.01, 1)]),  # one comes in
        ([lambda s: s, lambda s: 0.01 - s], [], [("branch point", 0.0, 1), ("branch point", 0.01, 1)]),
        ([lambda s: s, lambda s: s - 0.001], [], [("branch point", 0.0, 1), ("branch point", 0.001, 1)]),
    ],
)
def test_what_leaves_and_enters_in_one_step_is_told_apart(rates, pairs, met):
    system = beside_a_circle(rates, pairs)
    start = dict.fromkeys(system.names.states, 0.0) | {"x": 1.0}
    branch = follow(find_cycle(system, start=start, settled=True), "s", to=0.15)
    assert not branch.missed and len(branch.special) == len(met)
    for special, (kind, value, many) in zip(branch.special, met, strict=True):
        assert (special.kind, special.multiplicity) == (kind, many)
        assert abs(special.value - value) <= 3 * special.error < 1e-7


def test_a_step_in_which_a_pair_becomes_real_is_looked_at_in_halves():
    """Roots a +- sqrt(-d), a pair until d = 0, go out at a = 0; one of them comes in at a^2 + d = 0, another beside."""

    def field(x, p):
        r, a, d = 1 - x.x**2 - x.y**2, 0.4 * (p.s + 0.07), 0.01 - 0.5 * p.s
        linear = {"z": a * x.z - x.w, "w": d * x.z + a * x.w, "u": -2 * (p.s - 0.045) * x.u}
        return {"x": x.x * r - x.y, "y": x.y * r + x.x, **linear}

    system = System("beside", ("x", "y", "z", "w", "u"), {"s": -0.15}, (Mode("m", field),))
    start = dict.fromkeys(system.names.states, 0.0) | {"x": 1.0}
    branch = follow(find_cycle(system, start=start, settled=True), "s", to=0.15)
    comes_in = min(np.roots([0.16, 0.16 * 0.14 - 0.5, 0.16 * 0.07**2 + 0.01]))
    met = [("Neimark-Sacker", -0.07), ("branch point", comes_in), ("branch point", 0.045)]
    assert not branch.missed and [special.kind for special in branch.special] == [kind for kind, _ in met]
    for special, (_, value) in zip(branch.special, met, strict=True):
        assert abs(special.value - value) <= 3 * special.error + 1e-14 < 1e-9


def test_a_change_of_stability_that_no_point_explains_is_missed():
    """The bouncing ball flips at a = 0.02626, and what looks for flips is made blind."""
    blind = replace(bifurcations.FLIP, value=lambda orbit, point: 1.0, each=lambda orbit: ())
    orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    monitors = (bifurcations.TURN, bifurcations.BRANCH_POINT, blind, bifurcations.NEIMARK_SACKER)
    branch = follow(orbit, "a", to=0.03, monitors=monitors)
    (missed,) = branch.missed
    assert not branch.special and missed.kind == "change of stability" and branch.stable[0] and not branch.stable[-1]


def stretches(missed):
    """The two values of the parameter between which something was missed."""
    return [tuple(map(float, re.search(r"between s = (\S+) and (\S+) was", one.meaning).groups())) for one in missed]


@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize(("apart", "rate"), [(0.0, -1.0), (1e-5, -0.37), (1e-3, -1.0)])
def test_one_that_leaves_where_another_one_enters_is_never_passed_in_silence(apart, rate, turning):
    out, into = 0.0437, 0.0437 + apart
    ways = [lambda s: s - out, lambda s: rate * (s - into)]
    system = beside_a_circle(*(([], ways) if turning else (ways, [])))
    start = dict.fromkeys(system.names.states, 0.0) | {"x": 1.0}
    branch = follow(find_cycle(system, start=start, settled=True), "s", to=0.15)
    for place in (out, into):
        located = any(abs(one.value - place) <= 3 * one.error + 1e-12 for one in branch.special)
        assert located or any(low <= place <= high for low, high in stretches(branch.missed))
    assert all(high - low < 0.02 for low, high in stretches(branch.missed))


def test_two_that_turn_back_before_the_circle_are_no_change():
    """Rates +-sqrt((K - 1/2)^2 + e^2): one multiplier is outside all along."""

    def field(x, p):
        r, rate = x.u**2 + x.v**2, p.K - 0.4137
        circle = {"u": x.u - 2 * x.v - r * x.u, "v": x.v + 2 * x.u - r * x.v}
        return {**circle, "a": rate * x.a + 1e-4 * x.b, "b": 1e-4 * x.a - rate * x.b}

    system = System("circle", ("u", "v", "a", "b"), {"K": 0.0}, (Mode("m", field),))
    branch = follow(find_cycle(system, u=1.0, v=0.0, a=0.0, b=0.0, settled=True), "K", to=1.0)
    assert not branch.special and not branch.missed
