"""Eigenvalues of equilibria that pass the imaginary axis together, apart by little, or in opposite directions.

Systems of parts that know nothing of each other pass where each part does.  Equal Brusselators on a ring of n stand at
x = A, y = B/A; with q_j = 2 - 2 cos(2 pi j/n) the trace of mode j is zero at B = 1 + A^2 + q_j (d_x + d_y), and its
determinant at B = (1 + d_x q_j)(A^2 + d_y q_j)/(d_y q_j): modes j and n - j at once.
"""

import math

import casadi as ca
import pytest

from casahunt.continuation import equilibria, equilibrium_crossings
from casahunt.hybrid import Event, Mode, System

POINT, HOPF, FOLD = "branch point", "Hopf", "fold"


def turning(x, name, rate, omega):
    """Two states that turn, and grow with a rate."""
    a, b = (getattr(x, c + name) for c in "ab")
    return {f"a{name}": rate * a - omega * b - a**3, f"b{name}": rate * b + omega * a}


def followed(names, field, s=0.37, start=None, low=-1.0, high=1.0):
    """A branch through r = s from equilibria at zero on."""
    system = System("parts", names, {"r": s + low}, (Mode("m", field),))
    return equilibria(system, vary="r", to=s + high, start=start or dict.fromkeys(names, 0.0))


def holds(branch, expected):
    """The points that are expected, each within three of its errors, and none besides.

    A point at 1e-5 of a crossing is known to rounding by that: two eigenvalues are told to vanish at once to 1e-9.
    """
    assert [(one.kind, one.multiplicity) for one in branch.special] == [one[:2] for one in expected]
    assert not branch.missed
    for special, (*_, value) in zip(branch.special, expected, strict=True):
        assert abs(special.value - value) <= 3 * special.error < 1e-9 * max(1, abs(value))


PARTS = {
    "two of one rate": (("x", "y"), lambda x, r: {"x": r * x.x - x.x**3, "y": r * x.y - x.y**3}, [(POINT, 2, 0.0)]),
    "of two rates": (("x", "y"), lambda x, r: {"x": r * x.x - x.x**2, "y": 7 * r * x.y - x.y**3}, [(POINT, 2, 0.0)]),
    "opposite": (("x", "y"), lambda x, r: {"x": r * x.x - x.x**3, "y": -3 * r * x.y - x.y**3}, [(POINT, 2, 0.0)]),
    "opposite, nearly": (
        ("x", "y"), lambda x, r: {"x": r * x.x - x.x**3, "y": (0.001 - r) * x.y - x.y**3},
        [(POINT, 1, 0.0), (POINT, 1, 0.001)],
    ),
    "not quite opposite": (("x", "y"), lambda x, r: {"x": r * x.x + 1e-5 * x.y, "y": 1e-5 * x.x - r * x.y}, []),
    "a pair and a real one, opposite": (
        ("x", "a", "b"), lambda x, r: {"x": -2 * r * x.x - x.x**3, **turning(x, "", r, 1.0)},
        [(POINT, 1, 0.0), (HOPF, 1, 0.0)],
    ),
    "pairs": (
        ("a1", "b1", "a2", "b2"), lambda x, r: turning(x, "1", r, 1.0) | turning(x, "2", 2 * r, 1.7), [(HOPF, 2, 0.0)]
    ),
    "pairs, opposite": (
        ("a1", "b1", "a2", "b2"), lambda x, r: turning(x, "1", r, 1.0) | turning(x, "2", -r, 1.7), [(HOPF, 2, 0.0)]
    ),
    "a centre that ends": (("x", "v"), lambda x, r: {"x": x.v, "v": r * x.x - x.x**3}, [(POINT, 1, 0.0)]),
}  # fmt: skip


@pytest.mark.parametrize("s", [0.37, 1000.0])
@pytest.mark.parametrize("name", PARTS)
def test_parts_pass_where_each_does(name, s):
    names, field, expected = PARTS[name]
    branch = followed(names, lambda x, p: field(x, p.r - s), s)
    holds(branch, [(kind, many, s + value) for kind, many, value in expected])
    assert all(one.normal_form is None for one in branch.special if one.multiplicity > 1)


@pytest.mark.parametrize("s", [0.0, 0.1, 0.37])
def test_a_branch_point_is_known_to_its_error(s):
    holds(followed(("x",), lambda x, p: {"x": (p.r - s) * x.x - x.x**3}, s), [(POINT, 1, s)])
    beside = followed(("x", "y"), lambda x, p: {"x": (p.r - s) * x.x - x.x**3, "y": x.x**2 - x.y}, s)
    holds(beside, [(POINT, 1, s)])


def test_from_the_side_it_is_no_fold():
    branch = followed(("x",), lambda x, p: {"x": (p.r - 0.37) * x.x - x.x**3}, 0.37, {"x": 0.8}, 0.64, -0.5)
    holds(branch, [(POINT, 1, 0.37)])


def test_a_fold_and_what_passes_there():
    def field(x, p):
        return {"x": p.r - 0.37 + x.x**2, **turning(x, "", -x.x, 1.0)}

    holds(followed(("x", "a", "b"), field, start={"x": -1.0, "a": 0.0, "b": 0.0}), [(FOLD, 1, 0.37), (HOPF, 1, 0.37)])

    def two(x, p):
        return {"x": p.r - 0.37 + x.x**2, "y": p.r - 0.37 + x.y**2}

    holds(followed(("x", "y"), two, start={"x": -1.0, "y": -1.0}), [(POINT, 2, 0.37)])  # four curves meet there


@pytest.mark.parametrize(("n", "dx", "dy"), [(3, 0.0, 0.0), (3, 0.1, 1.0), (4, 0.05, 0.05), (5, 0.2, 1.5)])
def test_a_ring_of_equal_units(n, dx, dy):
    A, most = 1.3, 4.0

    def field(x, p):
        out = {}
        for i in range(n):
            (left, u, right), (below, v, above) = ([getattr(x, f"{c}{(i + k) % n}") for k in (-1, 0, 1)] for c in "xy")
            out[f"x{i}"] = A - (p.B + 1) * u + u**2 * v + dx * (left + right - 2 * u)
            out[f"y{i}"] = p.B * u - u**2 * v + dy * (below + above - 2 * v)
        return out

    expected = [(HOPF, n if dx == dy == 0 else 1, 1 + A**2)]
    for j in range(1, n // 2 + 1) if dy else ():
        q, many = 2 - 2 * math.cos(2 * math.pi * j / n), 1 if 2 * j == n else 2
        trace = 1 + A**2 + q * (dx + dy)
        if (trace - 1 - dx * q) * (-(A**2) - dy * q) + trace * A**2 > 0:
            expected.append((HOPF, many, trace))
        expected.append((POINT, many, (1 + dx * q) * (A**2 + dy * q) / (dy * q)))
    names = tuple(f"{c}{i}" for i in range(n) for c in "xy")
    system = System("ring", names, {"B": 1.0}, (Mode("m", field),))
    branch = equilibria(system, vary="B", to=most, start={name: A if name[0] == "x" else 1 / A for name in names})
    holds(branch, sorted((one for one in expected if one[2] < most), key=lambda one: one[2]))


def test_a_state_that_rounding_leaves_at_nothing_has_no_unit():
    """The share M = 0 beside C = 1 - d: M grows with a C + ga T - g/T, T = d."""

    def share(x, p):
        t = 1 - x.M - x.C
        gone = p.g * x.M / (x.M + t)
        return {"M": 0.1 * x.M * x.C - gone + 0.8 * x.M * t, "C": t * x.C - 0.44 * x.C - 0.1 * x.M * x.C}

    system = System("share", ("M", "C"), {"g": 0.3}, (Mode("m", share),))
    for M in (0.0, 1e-33, 1e-6):
        branch = equilibria(system, vary="g", to=0.05, M=M, C=0.55)
        holds(branch, [(POINT, 1, 0.44 * (0.1 * 0.56 + 0.8 * 0.44))])
        assert branch.points[0].states["M"] == 0


@pytest.mark.parametrize("edge", [0.5, 1.3])
def test_what_passes_before_an_equilibrium_leaves_its_mode_is_met(edge):
    """x = r; a pair beside it turns to growing at r = 0.37, and the mode ends at x = edge."""
    out = Event("out", lambda x, p: x.x - edge, +1, to="high")
    low = Mode("low", lambda x, p: {"x": p.r - x.x, **turning(x, "", x.x - 0.37, 1.0)}, ends=(out,))
    high = Mode("high", lambda x, p: {"x": 9 - x.x, "a": -x.a, "b": -x.b})
    system = System("two", ("x", "a", "b"), {"r": -1.0}, (low, high))
    holds(equilibria(system, "low", vary="r", to=2.0, x=-1.0, a=0.0, b=0.0), [(HOPF, 1, 0.37), ("boundary", 1, edge)])


def test_what_is_not_located_is_missed_where_the_count_changes(monkeypatch):
    monkeypatch.setattr(equilibrium_crossings.Line, "zero", lambda *_: None)
    branch = followed(("x",), lambda x, p: {"x": (p.r - 0.37) * x.x - x.x**3}, high=0.3)
    assert not branch.special and [one.kind for one in branch.missed] == ["change of stability"]


def test_a_jump_of_an_eigenvalue_is_no_point():
    """Kinks of a field meet at the equilibrium x = r = 0.37, y = 0: the rate beside it jumps from -1 to 1 there."""

    def field(x, p):
        u = x.x - 0.37
        return {"x": p.r - x.x, "y": ca.fabs(u + x.y / 2) - ca.fabs(u - x.y / 2) - x.y**3}

    branch = followed(("x", "y"), field, start={"x": -0.63, "y": 0.0}, high=0.3)
    assert not branch.special and [one.kind for one in branch.missed] == ["change of stability"]


@pytest.mark.parametrize("power", [3, 5])
def test_what_passes_too_flatly_is_said(power):
    """x' = (r - 0.37)^k x is located with an error that says so, or missed with the place in between."""
    (one,) = followed(("x",), lambda x, p: {"x": (p.r - 0.37) ** power * x.x - x.x**3}).special
    assert abs(one.value - 0.37) <= 3 * one.error
    branch = followed(("a", "b"), lambda x, p: turning(x, "", (p.r - 0.37) ** power, 1.0))
    assert branch.missed or abs(branch.special[0].value - 0.37) <= 3 * branch.special[0].error


def test_what_rounding_hides_for_several_steps_is_missed():
    """The rate (r - 0.37)^5 of a pair is rounding from 0.368 to 0.372."""
    system = System("flat", ("a", "b"), {"r": 0.36}, (Mode("m", lambda x, p: turning(x, "", (p.r - 0.37) ** 5, 1.0)),))
    branch = equilibria(system, vary="r", to=0.38, largest_step=5e-4, a=0.0, b=0.0)
    assert not branch.special and [one.kind for one in branch.missed] == ["change of stability"]
