"""Cycles that do not stand alone: what is kept, or nothing pulls back, is named; a fold is no such cycle."""

import re

import pytest

from casahunt import NoOrbit
from casahunt.continuation import follow
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle, fold_side
from casahunt.orbits.fold_side import one_of_many
from casahunt.orbits.orbit import unknowns_of


def oscillator(x, p):
    """van der Pol's."""
    return {"x": x.v, "v": p.m * (1 - x.x**2) * x.v - x.x}


def pool(x, p):
    made, flow = x.x**2 * x.y, x.a * x.x - 0.5 * x.b
    return {"x": 1 - 4 * x.x + made, "y": 3 * x.x - made, "a": -flow, "b": flow}


def prey(x, p):
    return {"x": x.x * (1 - x.y), "y": x.y * (x.x - 1)}


def planet(x, p):
    pull = (x.x**2 + x.y**2) ** -1.5
    return {"x": x.u, "y": x.w, "u": -pull * x.x, "w": -pull * x.y}


def two_of_a_kind(x, p):
    return {**oscillator(x, p), "y": x.u, "u": p.m * (1 - x.y**2) * x.u - x.y}


CASES = {
    "Kepler": (planet, dict(x=1.0, y=0.0, u=0.0, w=0.8), "in 3 ways"),  # energy, direction, angular momentum
    "equal oscillators": (two_of_a_kind, dict(x=2.0, v=0.0, y=1.5, u=1.0), "differ in y and u"),
    "equal oscillators opposite": (two_of_a_kind, dict(x=2.0, v=0.0, y=-2.0, u=0.0), "differ in y and u"),
    "linear": (lambda x, p: {"x": x.y, "y": -p.m * x.x}, dict(x=0.0, y=1.0), "differ in x and y"),
    "Hamiltonian": (lambda x, p: {"x": x.v, "v": -(x.x**3)}, dict(x=1.0, v=0.0), "differ in x and v"),
    "predator and prey": (prey, dict(x=1.0, y=0.5), "differ in x and y"),
    "pool": (pool, dict(x=1.0, y=1.0, a=0.7, b=0.3), r"differ in a and b \(near its start it keeps a \+ b\)"),
    "idle": (
        lambda x, p: {**oscillator(x, p), "z": 0 * x.x}, dict(x=2.0, v=0.0, z=0.4), r"in z \(near .* keeps z\)"
    ),
    "carried along": (
        lambda x, p: {**oscillator(x, p), "z": x.v}, dict(x=2.0, v=0.0, z=0.4),
        r"in z \(near its start it keeps (z - x|-x \+ z|-1 x \+ z|x - 1 z)\)",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_what_is_free_is_said(name):
    field, start, said = CASES[name]
    with pytest.raises(NoOrbit, match=said) as refusal:
        find_cycle(System(name, tuple(start), {"m": 1.0}, (Mode("m", field),)), start=start)
    assert "one of many" in str(refusal.value) and "fold" not in str(refusal.value)


@pytest.mark.parametrize("many", [2, 3])
def test_clocks_of_their_own(many):
    names = tuple("xyz"[:many])

    def fires(name):
        return Event(f"fires {name}", lambda x, p: getattr(x, name) - 1, +1, to="m", reset=lambda x, p: {name: 0.0})

    mode = Mode("m", lambda x, p: {k: p.i - getattr(x, k) for k in names}, ends=tuple(fires(k) for k in names))
    start = {k: 0.3 * i for i, k in enumerate(names)}
    with pytest.raises(NoOrbit, match="it is one of many") as refusal:
        find_cycle(System("clocks", names, {"i": 1.5}, (mode,)), start=start)
    assert ("in 2 ways" in str(refusal.value)) is (many == 3)


def test_a_system_too_large_for_its_singular_values_is_not_asked(monkeypatch):
    """As `test_what_is_free_is_said`, but for that."""
    field, start, _ = CASES["Hamiltonian"]
    monkeypatch.setattr(fold_side, "MOST_NODE_UNKNOWNS", 1)
    with pytest.raises(NoOrbit) as refusal:
        find_cycle(System("swings", tuple(start), {"m": 1.0}, (Mode("m", field),)), start=start)
    assert "beside it are other cycles" not in str(refusal.value)


def test_a_cycle_alone_and_one_at_a_fold_are_none_of_many():
    """r' = r (m + r^2 - r^4): cycles at r^2 = 1/2 + sqrt(1/4 + m), which meet the unstable ones at m = -1/4."""

    def field(x, p):
        r2 = x.x**2 + x.y**2
        grows = p.m + r2 - r2**2
        return {"x": grows * x.x - x.y, "y": grows * x.y + x.x}

    orbit = find_cycle(System("fold", ("x", "y"), {"m": -0.2}, (Mode("m", field),)), x=0.9, y=0.0)
    assert one_of_many(unknowns_of(orbit)) == ""
    (fold,) = follow(orbit, "m", to=-0.3).special
    assert abs(fold.value + 0.25) < 1e-9 and one_of_many(unknowns_of(fold.orbit)) == ""

@pytest.mark.parametrize(("name", "start", "said"), [
    ("pulled back", dict(x=2.0, v=0.0, z=0.3), r"differ in z \(near its start it keeps z\)"),
    pytest.param("driven", dict(x=2.0, v=0.0), "differ in x and v", marks=pytest.mark.slow),
])  # fmt: skip
def test_a_branch_that_ends_at_one_of_many_says_so(name, start, said):
    """At k = 0 nothing pulls z back; there nothing makes up for friction, nor is there any, and energy is kept."""
    fields = {
        "pulled back": lambda x, p: {"x": x.v, "v": (1 - x.x**2) * x.v - x.x, "z": -p.k * (x.z - 0.3)},
        "driven": lambda x, p: {"x": x.v, "v": -(x.x**3) + p.k * (1 - x.x**2) * x.v},
    }
    orbit = find_cycle(System(name, tuple(start), {"k": 0.5}, (Mode("m", fields[name]),)), start=start)
    end = follow(orbit, "k", to=0.0).end
    assert (end.kind, end.value) == ("one of many", 0.0) and re.search(said, end.sentence) and "fold" not in str(end)
