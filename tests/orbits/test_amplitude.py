"""What is measured of a cycle, against closed forms and truths from outside: value, error, derivative, file."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import pytest

from casahunt.continuation import follow
from casahunt.continuation.fold_check import confirmed
from casahunt.errors import InputError
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import Options, find_cycle, load_orbit
from casahunt.orbits.extrema import largest_magnitude
from casahunt.orbits.orbit import Orbit, unknowns_of
from problems import belt, circle, rossler, van_der_pol

CASES = {
    "belt": (belt.BELT, {"mode": "slip", "x": 0.0, "v": 0.0}, belt.TRUTH[0.2].extrema["x"][1]),
    "van der Pol": (van_der_pol.SYSTEM, {"x": 2.0, "v": 0.0}, van_der_pol.TRUTH[1.0].extrema["x"][1]),
    "circle": (circle.SYSTEM, {"x": 0.5, "y": 0.0, "z": 0.0}, 1.0),
    "Rossler": (rossler.SYSTEM, {"x": -2.5, "y": 0.0, "z": 0.0}, rossler.TRUTH[(2.5, 1)].extrema["x"][1]),
}
"""System, start, largest |x| over the cycle: of none of them at the end of a phase."""


def radius(x, p):
    return ca.sqrt(x.x**2 + x.y**2)


def spring_energy(x, p):
    return (x.v**2 + p.k * x.x**2) / 2


def intervals(orbit: Orbit) -> int:
    return sum(len(arc.breaks) - 1 for arc in orbit.arcs)


# The true amplitude, and its error ------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [2, 7])
@pytest.mark.parametrize("tol", [1e-5, pytest.param(1e-7, marks=pytest.mark.slow), 1e-9])
@pytest.mark.parametrize("case", CASES)
def test_the_estimate_is_honest(case, tol, degree):
    """Neither ten times too small nor a hundred times too large; of low degrees, where there is an error to see."""
    system, start, truth = CASES[case]
    orbit = find_cycle(system, options=Options(tol=tol, degree=degree), **start)
    off = abs(orbit.amplitude / truth - 1)
    assert orbit.degree == degree and orbit.amplitude_error <= tol
    assert off <= 10 * orbit.amplitude_error + 1e-13
    assert orbit.amplitude_error <= max(100 * off, 1e-11)
    assert orbit.amplitude == pytest.approx(orbit.extrema("x").amplitude, rel=1e-13)


@pytest.mark.parametrize("section", ["x", "y"])
def test_a_state_that_is_zero_where_the_cycle_is_cut(section):
    """The error of x = 0 relative to itself would ask for thousands of intervals."""
    start = {"x": 0.0, "y": 1.0, "z": 0.0} if section == "x" else {"x": 1.0, "y": 0.0, "z": 0.0}
    for measure in ("x", "y"):
        orbit = find_cycle(circle.SYSTEM, settled=True, tol=1e-11, measure=measure, start=start)
        assert orbit.amplitude == pytest.approx(1.0, rel=1e-11)
        assert intervals(orbit) < 60


def test_an_energy():
    """x = A cos(w t - phase): the kinetic energy is largest at w > sqrt(k), inside the turn."""
    k, d, w = 1.0, 0.2, 1.5
    field = Mode("free", lambda x, p: {"x": x.v, "v": ca.cos(w * x.t) - d * x.v - p.k * x.x})
    system = System("resonator", ("x", "v"), {"k": k}, (field,), forcing_period=lambda p: 2 * math.pi / w)
    amplitude = 1 / math.hypot(k - w**2, d * w)
    orbit = find_cycle(system, x=0.0, v=0.0, measure=spring_energy, tol=1e-10)
    assert orbit.amplitude == pytest.approx((amplitude * w) ** 2 / 2, rel=1e-10)
    assert orbit.amplitude_error <= 1e-10
    lowest = find_cycle(system, x=0.0, v=0.0, measure=lambda x, p: -spring_energy(x, p), tol=1e-10)
    assert lowest.amplitude == pytest.approx(orbit.amplitude, rel=1e-10)


def test_half_a_cycle_has_the_amplitude_of_the_other_half_too():
    """x - 0.1 v^3 of van der Pol's cycle is odd, x + 0.3 v^2 is not: it is largest in one half alone."""
    for g in (lambda x, p: x.x - 0.1 * x.v**3, lambda x, p: x.x + 0.3 * x.v**2, lambda x, p: -x.x + 0.3 * x.v**2):
        orbit = find_cycle(van_der_pol.SYSTEM, x=2.0, v=0.0, measure=g, tol=1e-10)
        _, states = orbit.sample(200)
        named = type("x", (), {"x": states[0], "v": states[1]})
        sampled = abs(g(named, None)).max()
        assert orbit.repeats == 2 and sampled - 1e-9 <= orbit.amplitude <= sampled + 1e-5


@pytest.mark.parametrize(
    ("g", "value"),
    [
        ("z", 0.0),
        (lambda x, p: x.x**2 + x.y**2 - p.mu, 0.0),
        (lambda x, p: (x.x**2 + x.y**2 - p.mu) ** 2, 0.0),
        (lambda x, p: 0 * x.x, 0.0),
        (lambda x, p: p.mu + p.omega, 2.0),
        (lambda x, p: 1e6 + x.x, 1e6 + 1),
        (lambda x, p: 1e-6 * radius(x, p), 1e-6),
    ],
)
def test_what_is_nothing_or_does_not_change(g, value):
    """Where a functional vanishes, its error is relative to what it would be off the cycle."""
    orbit = find_cycle(circle.SYSTEM, x=0.5, y=0.0, z=1e-3, measure=g, tol=1e-9)
    assert orbit.amplitude == pytest.approx(value, rel=1e-9, abs=1e-9)
    assert orbit.amplitude_error <= 1e-9 and intervals(orbit) < 60


def test_by_default_it_is_the_first_state_that_is_no_angle():
    def field(x, p):
        return {"theta": x.w, "w": 1.5 - x.w}

    rotor = System("rotor", ("theta", "w"), {}, (Mode("turns", field),), angles=("theta",))
    orbit = find_cycle(rotor, theta=0.0, w=1.0)
    assert orbit.amplitude == pytest.approx(1.5, rel=1e-9)


def test_what_cannot_be_measured_is_refused():
    def measured(g):
        return find_cycle(circle.SYSTEM, x=0.5, y=0.0, z=0.0, measure=g)

    with pytest.raises(InputError, match="^unknown state 'r'"):
        measured("r")
    with pytest.raises(InputError, match="^3: must be the name of a state or a function"):
        measured(3)
    with pytest.raises(InputError, match="^measure must return a scalar, not one of shape"):
        measured(lambda x, p: ca.vertcat(x.x, x.y))
    with pytest.raises(InputError, match="^measure: there is no state 'r'"):
        measured(lambda x, p: x.r)
    with pytest.raises(InputError, match="^measure .*casadi"):
        measured(lambda x, p: math.sqrt(x.x))


# As a functional of the unknowns --------------------------------------------------------------------------------------


def slope(orbit: Orbit, name: str) -> float:
    """d amplitude / d parameter, by the row of the functional along the tangent of the branch."""
    t, u, setting = unknowns_of(orbit)
    setting = replace(setting, dp=orbit.problem.direction(name))
    _, y = t.linearise(u, setting).tangent(t.system.border(parameter=1.0))
    return float(largest_magnitude(t, u, setting, t.cycle.measured).row @ y)


def test_its_row_is_its_derivative():
    """r = sqrt(mu); the parameter enters by the nodes, by the way from a node to the place, and directly."""
    for g, expected in (("x", 0.25), (lambda x, p: p.mu * x.x, 3.0), (lambda x, p: -x.x / p.mu, -1 / 16)):
        orbit = find_cycle(circle.SYSTEM, x=1.0, y=0.0, z=0.0, parameters={"mu": 4.0}, measure=g, tol=1e-11)
        assert slope(orbit, "mu") == pytest.approx(expected, rel=1e-7)
        assert slope(orbit, "omega") == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("closed", [True, False])
def test_its_row_is_its_derivative_in_a_flight(closed):
    """x = kick^2 / (2 g) at the top."""
    how = {"flow": lambda x, t, p: {"x": x.x + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t}}
    if not closed:
        how = {"field": lambda x, p: {"x": x.v, "v": -p.g}}
    kicked = Event("hits", lambda x, p: x.x, -1, to="flight", reset=lambda x, p: {"v": p.kick})
    flight = Mode("flight", holds=lambda x, p: x.x, ends=(kicked,), **how)
    orbit = find_cycle(System("ball", ("x", "v"), {"g": 9.81, "kick": 3.0}, (flight,)), x=1.0, v=0.0, tol=1e-10)
    assert orbit.amplitude == pytest.approx(9 / (2 * 9.81), rel=1e-12)
    assert slope(orbit, "kick") == pytest.approx(3 / 9.81, rel=1e-9)
    assert slope(orbit, "g") == pytest.approx(-9 / (2 * 9.81**2), rel=1e-9)


# Along a branch -------------------------------------------------------------------------------------------------------


def test_along_a_branch():
    start = find_cycle(circle.SYSTEM, x=1.0, y=0.0, z=0.0, measure=radius, follow="mu", tol=1e-9)
    branch = follow(start, "mu", to=4.0)
    assert len(branch.orbits) > 2
    for orbit in branch.orbits:
        exact = math.sqrt(orbit.problem.value("mu"))
        assert abs(orbit.amplitude / exact - 1) <= 10 * orbit.amplitude_error + 1e-12
        assert orbit.amplitude_error <= 1e-8


def test_at_a_fold():
    """Hard excitation: the two cycles merge at nu = 1 - b^2 / (4 c), with r^2 = b / (2 c)."""

    def field(x, p):
        square = x.x**2 + x.y**2
        grows = p.nu - 1 + p.b * square - p.c * square**2
        return {"x": grows * x.x - x.y, "y": x.x + grows * x.y}

    values = {"nu": 0.9, "b": 1.0, "c": 0.5}
    system = System("hard", ("x", "y"), values, (Mode("smooth", field),))
    start = find_cycle(system, x=1.3, y=0.0, measure=radius, follow="nu")
    exact = math.sqrt((1 + math.sqrt(1 - 4 * 0.5 * 0.1)) / 1)
    assert start.amplitude == pytest.approx(exact, rel=1e-9)
    branch = follow(start, "nu", to=0.4, back=0.95)
    (special,) = [s for s in branch.special if s.kind == "fold"]
    assert special.orbit.problem.value("nu") == pytest.approx(1 - 1 / 2, rel=1e-7)
    assert special.orbit.amplitude == pytest.approx(1.0, rel=1e-5)


def test_a_confirmed_fold():
    """The same with lambda = -nu: the largest one, confirmed as an optimum."""

    def field(x, p):
        square = x.x**2 + x.y**2
        grows = -p.damping + p.b * square - p.c * square**2
        return {"x": grows * x.x - x.y, "y": x.x + grows * x.y}

    values = {"damping": 0.1, "b": 1.0, "c": 0.5}
    system = System("hard", ("x", "y"), values, (Mode("smooth", field),))
    start = find_cycle(system, x=1.3, y=0.0, measure=radius, follow="damping")
    branch = follow(start, "damping", to=0.8, back=0.05)
    (special,) = [s for s in branch.special if s.kind == "fold"]
    found = confirmed(special, "damping", Options(tol=1e-7))
    assert found.value == pytest.approx(0.5, abs=10 * found.value_error + 1e-12)
    assert found.orbit.amplitude == pytest.approx(1.0, rel=10 * found.error_estimate)


# In a file ------------------------------------------------------------------------------------------------------------


def test_a_function_is_given_again_when_a_file_is_read(tmp_path):
    orbit = find_cycle(circle.SYSTEM, x=1.0, y=0.0, z=0.0, measure=radius)
    path = tmp_path / "circle.npz"
    orbit.save(path)
    loaded = load_orbit(path, circle.SYSTEM, measure=radius)
    assert loaded.problem == orbit.problem and loaded.amplitude == orbit.amplitude
    with pytest.raises(InputError, match="function, 'radius', which no file holds: give it as measure="):
        load_orbit(path, circle.SYSTEM)
    with pytest.raises(InputError, match="give it as measure="):
        load_orbit(path, circle.SYSTEM, measure="x")
    with pytest.raises(InputError, match="not the largest magnitude of this function"):
        load_orbit(path, circle.SYSTEM, measure=lambda x, p: 2 * x.x)


def test_a_state_is_known_by_its_name(tmp_path):
    orbit = find_cycle(circle.SYSTEM, x=1.0, y=0.0, z=0.0, measure="y")
    path = tmp_path / "circle.npz"
    orbit.save(path)
    assert load_orbit(path, circle.SYSTEM).problem == orbit.problem
    assert load_orbit(path, circle.SYSTEM, measure="y").amplitude == orbit.amplitude
    for other in ("x", radius):
        with pytest.raises(InputError, match="amplitude is that of the state 'y'"):
            load_orbit(path, circle.SYSTEM, measure=other)
