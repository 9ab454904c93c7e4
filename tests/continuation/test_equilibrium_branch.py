"""Equilibria followed to where cycles are born: closed forms of Hopf points, folds and first Lyapunov coefficients."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from casahunt.continuation import born_at, equilibria, follow
from casahunt.errors import InputError, NoOrbit
from casahunt.hybrid import Event, Mode, System
from casahunt.hybrid.examples import ball, belt
from casahunt.orbits import Options, find_cycle

EPS, A, B = 0.08, 0.7, 0.8
TURN_V = math.sqrt(1 - EPS * B)
"""|v| at both Hopf points: the trace 1 - v^2 - eps b is zero there."""


def nerve(x, p):
    return {"v": x.v - x.v**3 / 3 - x.w + p.I, "w": EPS * (x.v + A - B * x.w)}


def weather(x, p):
    return {"x": p.sigma * (x.y - x.x), "y": x.x * (p.rho - x.z) - x.y, "z": x.x * x.y - p.beta * x.z}


def turning(x, p):
    r2 = x.x**2 + x.y**2
    grows = p.l + p.a * r2
    turns = 1 + p.b * r2
    return {"x": grows * x.x - turns * x.y, "y": grows * x.y + turns * x.x}


NERVE = System("FitzHugh-Nagumo", ("v", "w"), {"I": 0.0}, (Mode("smooth", nerve),))
LORENZ = System("Lorenz", ("x", "y", "z"), {"sigma": 10.0, "rho": 14.0, "beta": 8 / 3}, (Mode("smooth", weather),))
NORMAL = System("normal form", ("x", "y"), {"l": -1.0, "a": -0.7, "b": 0.3}, (Mode("smooth", turning),))


def planar_lyapunov(v: float) -> float:
    """Re c/omega of the nerve by Guckenheimer and Holmes' formula (3.4.11), |z| counted in units of q of length one."""
    A_ = np.array([[1 - v**2, -1.0], [EPS, -EPS * B]])
    values, vectors = np.linalg.eig(A_)
    k = int(np.argmax(values.imag))
    omega, q = values[k].imag, vectors[:, k] / np.linalg.norm(vectors[:, k])
    T = 2 * np.column_stack([q.real, -q.imag])  # x = 2 Re(z q), z = X + i Y
    inverse, c, s = np.linalg.inv(T), *T[0]
    d2 = -2 * v * np.array([c * c, c * s, s * s])  # of -v dv^2 - dv^3/3, by X X, X Y, Y Y
    d3 = -2 * np.array([c**3, c * c * s, c * s * s, s**3])
    (fxx, fxy, fyy), (gxx, gxy, gyy) = inverse[0, 0] * d2, inverse[1, 0] * d2
    third = inverse[0, 0] * (d3[0] + d3[2]) + inverse[1, 0] * (d3[1] + d3[3])
    second = fxy * (fxx + fyy) - gxy * (gxx + gyy) - fxx * gxx + fyy * gyy
    return (third + second / omega) / 16 / omega


def test_hopf_points_of_a_nerve():
    branch = equilibria(NERVE, vary="I", to=2.0, v=-1.2, w=-0.6)
    assert [s.kind for s in branch.special] == ["Hopf", "Hopf"] and branch.ended == "I reached 2, the end of the range"
    for special, v in zip(branch.special, (-TURN_V, TURN_V), strict=True):
        w = (v + A) / B
        assert special.value == pytest.approx(w - v + v**3 / 3, rel=1e-12)
        assert special.equilibrium.states == pytest.approx({"v": v, "w": w}, rel=1e-10)
        assert special.normal_form.omega == pytest.approx(math.sqrt(EPS - (EPS * B) ** 2), rel=1e-10)
        assert special.normal_form.l1 == pytest.approx(planar_lyapunov(v), rel=1e-8)
    assert "unstable, towards smaller I" in branch.special[0].meaning
    assert "unstable, towards larger I" in branch.special[1].meaning
    inside = np.abs(branch.values - 0.875) < 0.5 * (branch.special[1].value - branch.special[0].value)
    assert np.array_equal(branch.stable, ~inside)


def test_lorenz():
    """Subcritical (Marsden and McCracken, 1976, section 4B)."""
    branch = equilibria(LORENZ, vary="rho", to=30.0, x=6.0, y=6.0, z=13.0)
    (hopf,) = branch.special
    s, b = 10.0, 8 / 3
    assert hopf.value == pytest.approx(s * (s + b + 3) / (s - b - 1), rel=1e-12)
    assert hopf.normal_form.omega == pytest.approx(math.sqrt(b * (s + hopf.value)), rel=1e-10)
    assert hopf.normal_form.l1 > 0 and "unstable, towards smaller rho" in hopf.meaning
    x = math.sqrt(b * (hopf.value - 1))
    assert hopf.equilibrium.states == pytest.approx({"x": x, "y": x, "z": hopf.value - 1}, rel=1e-10)


@pytest.mark.parametrize(("a", "word"), [(-0.7, "stable, towards larger l"), (0.4, "unstable, towards smaller l")])
def test_the_normal_form_itself(a, word):
    """z' = (l + i) z + (a + i b) z |z|^2 in x + i y = sqrt(2) z, q having length one: c = 2 (a + i b)."""
    (hopf,) = equilibria(NORMAL, vary="l", to=1.0, parameters={"a": a}, x=0.0, y=0.0).special
    assert abs(hopf.value) < 1e-10 and hopf.normal_form.c == pytest.approx(2 * (a + 0.3j), rel=1e-9)
    assert hopf.normal_form.l1 == pytest.approx(2 * a, rel=1e-9) and word in hopf.meaning
    cycle = born_at(hopf)
    at = cycle.parameters["l"]
    r2 = -at / a
    assert r2 > 0 and cycle.amplitude == pytest.approx(math.sqrt(r2), rel=1e-8)
    assert cycle.period == pytest.approx(2 * math.pi / (1 + 0.3 * r2), rel=1e-8)
    assert cycle.multipliers.full[1].real == pytest.approx(math.exp(-2 * at * cycle.period), rel=1e-6)
    assert cycle.repeats == 2 and abs(at) < 0.1


def test_what_is_born_has_the_parameter_and_the_multiplier_of_its_normal_form():
    (hopf,) = equilibria(LORENZ, vary="rho", to=30.0, x=6.0, y=6.0, z=13.0).special
    form, i = hopf.normal_form, 1
    sizes, ways = [], []
    for small in (0.04, 0.02):
        cycle = born_at(hopf, small=small)
        x = cycle.sample()[1][0]
        rho = np.ptp(x) / 4 / abs(form.q[0])
        gone = cycle.parameters["rho"] - hopf.value
        assert gone == pytest.approx(-form.c.real * rho**2 / form.by_p[i].real, rel=0.02)
        grows = np.log(cycle.multipliers.full[1].real) / cycle.period
        assert grows == pytest.approx(2 * form.c.real * rho**2, rel=0.02)
        frequency = form.omega + form.c.imag * rho**2 + form.by_p[i].imag * gone
        assert 2 * math.pi / cycle.period - form.omega == pytest.approx(frequency - form.omega, rel=0.02)
        assert not cycle.stable
        sizes.append(rho)
        ways.append(gone)
    assert ways[0] / ways[1] == pytest.approx((sizes[0] / sizes[1]) ** 2, rel=0.01)


@pytest.mark.slow
def test_the_cycle_is_followed_and_leads_back_to_its_birth():
    (hopf,) = equilibria(LORENZ, vary="rho", to=30.0, x=6.0, y=6.0, z=13.0).special
    cycle = born_at(hopf)
    away = follow(cycle, "rho", to=20.0)
    assert away.values[-1] == 20.0 and not away.missed and not away.stable.any()
    assert np.all(np.diff([np.ptp(orbit.sample()[1][0]) for orbit in away.orbits]) > 0)
    back = follow(away.orbits[1], "rho", to=30.0)
    assert back.special[-1].kind == "Hopf" and back.special[-1].value == pytest.approx(hopf.value, rel=1e-9)


def test_a_fold_is_rounded():
    """x' = a + x^2 - x^3/3: folds at x = 0, a = 0 and at x = 2, a = -4/3."""
    curve = System("fold", ("x",), {"a": -3.0}, (Mode("m", lambda x, p: {"x": p.a + x.x**2 - x.x**3 / 3}),))
    branch = equilibria(curve, vary="a", to=1.0, x=-1.3)
    assert [s.kind for s in branch.special] == ["fold", "fold"] and branch.values[-1] == 1.0
    assert [s.value for s in branch.special] == pytest.approx([0.0, -4 / 3], abs=1e-10)
    assert [s.equilibrium.states["x"] for s in branch.special] == pytest.approx([0.0, 2.0], abs=1e-5)


def test_where_curves_cross_is_no_fold():
    up = equilibria(LORENZ, vary="rho", to=30.0, parameters={"rho": 0.5}, x=0.0, y=0.0, z=0.0)
    down = equilibria(LORENZ, vary="rho", to=0.5, x=6.0, y=6.0, z=13.0)
    for branch in (up, down):
        (special,) = branch.special
        assert special.kind == "branch point" and special.value == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("width", [0.05, 1e-3])
def test_two_points_inside_a_step_are_both_found(width):
    """The pair mu +- i with mu = width^2 - (l - 0.5)^2 grows between 0.5 - width and 0.5 + width alone."""

    def field(x, p):
        mu = width**2 - (p.l - 0.5) ** 2
        return {"x": mu * x.x - x.y - x.x**3, "y": mu * x.y + x.x}

    system = System("window", ("x", "y"), {"l": 0.0}, (Mode("m", field),))
    found = [s.value for s in equilibria(system, vary="l", to=1.0, x=0.0, y=0.0).special]
    assert found == pytest.approx([0.5 - width, 0.5 + width], rel=1e-9)


def test_a_window_that_is_narrow_is_found_by_shorter_steps():
    """mu = 2 exp(-((l - 0.5)/0.01)^2) - 1."""

    def field(x, p):
        mu = 2 * ca.exp(-(((p.l - 0.5) / 0.01) ** 2)) - 1
        return {"x": mu * x.x - x.y - x.x**3, "y": mu * x.y + x.x}

    system = System("window", ("x", "y"), {"l": 0.0}, (Mode("m", field),))
    found = [s.value for s in equilibria(system, vary="l", to=1.0, largest_step=0.02, x=0.0, y=0.0).special]
    half = 0.01 * math.sqrt(math.log(2))
    assert found == pytest.approx([0.5 - half, 0.5 + half], rel=1e-9)


def test_what_is_born_beside_a_growing_direction_is_unstable():
    def field(x, p):
        return {**turning(x, p), "z": x.z}

    system = System("saddle-focus", ("x", "y", "z"), {"l": -1.0, "a": -0.7, "b": 0.3}, (Mode("m", field),))
    (hopf,) = equilibria(system, vary="l", to=1.0, x=0.0, y=0.0, z=0.0).special
    assert hopf.normal_form.l1 < 0 and "unstable, towards larger l" in hopf.meaning


@pytest.mark.parametrize("small", [0.9, 0.5, 0.1])
def test_no_cycle_is_born_far_away(small):
    """Of a canard the parameter turns back at 0.32418, next to the Hopf point at 0.33128, and the cycles explode."""
    hopf = equilibria(NERVE, vary="I", to=1.0, v=-1.2, w=-0.6).special[0]
    cycle, form = born_at(hopf, small=small), hopf.normal_form
    rho2 = (cycle.parameters["I"] - hopf.value) * -form.by_p[0].real / form.c.real
    grows = np.log(cycle.multipliers.full[1].real) / cycle.period
    assert rho2 > 0 and grows == pytest.approx(2 * form.c.real * rho2, rel=0.35)
    assert 2 * math.pi / cycle.period == pytest.approx(form.omega, rel=0.1)


def test_a_saddle_whose_eigenvalues_cancel_is_no_hopf_point():
    saddle = System("saddle", ("x", "y"), {"l": -1.0}, (Mode("m", lambda x, p: {"x": (1 + p.l / 2) * x.x, "y": -x.y}),))
    assert equilibria(saddle, vary="l", to=1.0, x=0.0, y=0.0).special == ()


def test_a_family_of_cycles_at_one_value_is_said_to_be_degenerate():
    """Van der Pol's oscillator at mu = 0 is the linear one."""

    def field(x, p):
        return {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x}

    system = System("vdP", ("x", "v"), {"mu": -1.0}, (Mode("m", field),))
    (hopf,) = equilibria(system, vary="mu", to=1.0, x=0.0, v=0.0).special
    assert hopf.normal_form.l1 == 0 and "degenerate" in hopf.meaning


def test_an_equilibrium_ends_where_it_leaves_its_mode():
    """x' = a - x in x < 1, by its condition or by its event alone."""
    event = Event("out", lambda x, p: x.x - 1, +1, to="high")
    high = Mode("high", lambda x, p: {"x": 3 - x.x})
    for low in (
        Mode("low", lambda x, p: {"x": p.a - x.x}, holds=lambda x, p: 1 - x.x),
        Mode("low", lambda x, p: {"x": p.a - x.x}, ends=(event,)),
    ):
        system = System("two", ("x",), {"a": 0.0}, (low, high))
        branch = equilibria(system, "low", vary="a", to=2.0, x=0.0)
        (special,) = branch.special
        assert special.kind == "boundary" and special.value == pytest.approx(1.0, rel=1e-10)
        assert branch.ended == special.meaning and branch.values[-1] == special.value
        with pytest.raises(NoOrbit, match="none of mode 'low'"):
            equilibria(system, "low", vary="a", to=3.0, parameters={"a": 2.0}, x=0.0)


def test_a_block_that_slips_on_a_belt():
    """k x = static/(1 + decay belt) at rest; the friction that falls with the speed lets it hunt at every speed."""
    branch = equilibria(belt, "slip", vary="belt", to=2.0, x=0.3, v=0.0)
    p = belt.parameters
    assert not branch.special and not branch.stable.any()
    for point, speed in zip(branch.points, branch.values, strict=True):
        assert point.states["x"] == pytest.approx(p["static"] / (1 + p["decay"] * speed), rel=1e-10)


def test_what_has_no_equilibria_is_refused():
    with pytest.raises(InputError, match="time enters it"):
        equilibria(ball, vary="a", to=0.05, x=0.0, v=0.0)
    with pytest.raises(InputError, match="cannot go to"):
        equilibria(NERVE, vary="I", to=1.0, back=2.0, v=-1.2, w=-0.6)
    with pytest.raises(NoOrbit, match="stands alone"):  # stuck on the belt it stands nowhere
        equilibria(belt, "stick", vary="belt", to=1.0, x=0.0, v=0.2)
    folded = System("f", ("x",), {"a": -1.0}, (Mode("m", lambda x, p: {"x": p.a + x.x**2}),))
    fold = equilibria(folded, vary="a", to=1.0, x=-1.0)
    with pytest.raises(InputError, match="must be a Hopf bifurcation"):
        born_at(fold.special[0])
    with pytest.raises(InputError, match="between 0 and 1"):
        born_at(equilibria(NORMAL, vary="l", to=1.0, x=0.0, y=0.0).special[0], small=1.0)


def test_the_cycle_that_is_born_meets_no_event():
    """Beyond x = 0.05 everything is pulled back, and other cycles are there."""
    far = Event("far", lambda x, p: x.x - 0.05, +1, to="back")
    near = Event("near", lambda x, p: x.x - 0.05, -1, to="turns")

    def pulled(x, p):
        return {"x": -x.y - 0.5 * (x.x - 0.05), "y": x.x}

    system = System(
        "two", ("x", "y"), {"l": -1.0, "a": -0.7, "b": 0.3},
        (Mode("turns", turning, ends=(far,)), Mode("back", pulled, ends=(near,))),
    )  # fmt: skip
    (hopf,) = equilibria(system, "turns", vary="l", to=1.0, x=0.0, y=0.0).special
    cycle = born_at(hopf, small=0.5)
    assert 0 < cycle.amplitude < 0.05 and {arc.mode for arc in cycle.arcs} == {"turns"}
    assert cycle.amplitude**2 == pytest.approx(cycle.parameters["l"] / 0.7, rel=1e-6)


def test_a_mode_in_closed_form_is_refused():
    """A linear oscillator: every cycle is one of many."""

    def flow(x, t, p):
        c, s = ca.exp(p.d * t) * ca.cos(t), ca.exp(p.d * t) * ca.sin(t)
        return {"x": c * x.x - s * x.y, "y": s * x.x + c * x.y}

    system = System("linear", ("x", "y"), {"d": -1.0}, (Mode("turns", flow=flow),))
    (hopf,) = equilibria(system, vary="d", to=1.0, x=0.1, y=0.0).special
    assert abs(hopf.value) < 1e-10 and hopf.normal_form.l1 == 0
    with pytest.raises(InputError, match="closed form"):
        born_at(hopf)


def test_a_fold_that_is_a_hopf_point_is_degenerate():
    """Rossler's equations at c^2 = 4 a b with a = b: eigenvalues 0, +-i omega."""

    def field(x, p):
        return {"x": -x.y - x.z, "y": x.x + p.a * x.y, "z": p.b + x.z * (x.x - p.c)}

    system = System("Rossler", ("x", "y", "z"), {"a": 0.2, "b": 0.2, "c": 2.0}, (Mode("m", field),))
    branch = equilibria(system, vary="c", to=0.1, x=0.0, y=0.0, z=0.0)
    found = {special.kind: special for special in branch.special}
    assert found["fold"].value == pytest.approx(0.4, rel=1e-9) and found["Hopf"].value == pytest.approx(0.4, rel=1e-6)
    assert found["Hopf"].normal_form is None and "degenerate" in found["Hopf"].meaning
    with pytest.raises(InputError, match="no degenerate one"):
        born_at(found["Hopf"])


def membrane(x, p):
    """Morris and Lecar's, with the numbers of Rinzel and Ermentrout (1989), table 7.1: Hopf."""
    m = (1 + ca.tanh((x.v + 1.2) / 18)) / 2
    w = (1 + ca.tanh((x.v - 2) / 30)) / 2
    leak, fast, slow = 2 * (x.v + 60), 4.4 * m * (x.v - 120), 8 * x.w * (x.v + 84)
    return {"v": (p.I - leak - fast - slow) / 20, "w": 0.04 * ca.cosh((x.v - 2) / 60) * (w - x.w)}


def test_a_membrane_of_large_voltages_and_small_openings():
    """Published: Hopf bifurcations at 93.86 and 212, both subcritical; here by the trace at the rest of a voltage."""
    system = System("Morris-Lecar", ("v", "w"), {"I": 0.0}, (Mode("m", membrane),))
    x, y = ca.SX.sym("x", 2), ca.SX.sym("I")
    entries = membrane(SimpleNamespace(v=x[0], w=x[1]), SimpleNamespace(I=y))
    f = ca.vertcat(entries["v"], entries["w"])
    trace = ca.Function("trace", [x, y], [ca.trace(ca.jacobian(f, x)), f])

    def at(v):
        w = (1 + math.tanh((v - 2) / 30)) / 2
        current = -20 * float(trace([v, w], 0.0)[1][0])
        return float(trace([v, w], current)[0]), current

    truth = [at(brentq(lambda v: at(v)[0], *ends, xtol=1e-13))[1] for ends in ((-40, -10), (0, 20))]
    assert truth == pytest.approx([93.86, 212.0], abs=0.05)
    branch = equilibria(system, vary="I", to=300.0, v=-60.0, w=0.0)
    assert [s.kind for s in branch.special] == ["Hopf", "Hopf"] and not branch.missed
    assert [s.value for s in branch.special] == pytest.approx(truth, rel=1e-9)
    assert all(s.normal_form.l1 > 0 for s in branch.special)
    for special, way in zip(branch.special, (-1, 1), strict=True):
        cycle = born_at(special)
        assert way * (cycle.parameters["I"] - special.value) > 0 and not cycle.stable


def test_a_born_cycle_is_the_one_that_motions_settle_on():
    (hopf,) = equilibria(NORMAL, vary="l", to=1.0, parameters={"a": -0.7}, x=0.0, y=0.0).special
    cycle = follow(born_at(hopf), "l", to=0.5).orbits[-1]
    settled = find_cycle(NORMAL, parameters={"l": 0.5}, x=0.1, y=0.0, options=Options(tol=1e-9))
    assert cycle.period == pytest.approx(settled.period, rel=1e-9)
    assert cycle.amplitude == pytest.approx(settled.amplitude, rel=1e-9)
