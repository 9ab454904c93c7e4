"""The proof that there is no cycle: its energy balance on computed cycles, its bound where cycles are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import legendre

from casahunt import NoOrbit, Servo, Status, find_orbit
from casahunt.collocation.scheme import scheme
from casahunt.servo import find_fold
from casahunt.servo import find_orbit as find
from casahunt.servo import refused as refusals
from casahunt.servo.denial import no_cycle
from casahunt.servo.event_map.half_cycle import StickMap
from casahunt.servo.event_map.scan import Scan, scan
from casahunt.servo.gains import routh_hurwitz_gain
from problems import table1
from problems.taylor import switch_half_cycle

# Friction rises with speed everywhere, and it hunts all the same: its loop is nearly unstable at small gains.
RISING = Servo().replace(
    **{
        "servo.inertia": 0.004474182146324871, "servo.motor_gain": 22.27359956489505,
        "controller.lead_time": 0.021607845660183467, "controller.integral_time": 0.02493190719835446,
        "friction.static": 0.32588843453979505, "friction.coulomb": 0.2909647596977022,
        "friction.stribeck_velocity": 0.15562240659533208, "friction.viscous": 0.2220498811834362,
    }
)  # fmt: skip
# Pure Coulomb friction, and a loop that is unstable without it below gain 0.032.
COULOMB = Servo().replace(**{"friction.static": 0.44, "friction.viscous": 0.0})
# Without a drop, and a loop that is stable without friction; its bristle is soft, strongly damped, and drives it.
SOFT = COULOMB.replace(**{"friction.viscous": 0.02, "friction.stiffness": 19.7, "friction.damping": 55.0})


def reached(servo: Servo, gain: float, part: float) -> float:
    """P(a)/a by the Taylor engine, from a = part Fs/kp."""
    a = part * servo.friction.static / servo.torque_gains(gain)[0]
    return switch_half_cycle(servo, gain, a, thrown_out=10 * a, most_slips=40)[0] / a


def steepest_fall(servo: Servo) -> float:
    """The largest -dg/dv of the Stribeck curve, looked for on a fine grid."""
    f = servo.friction
    v = f.stribeck_velocity * np.linspace(0, 3, 30001)
    g = f.coulomb + (f.static - f.coulomb) * np.exp(-((v / f.stribeck_velocity) ** 2))
    return float(np.max(-np.diff(g) / np.diff(v)))


@pytest.mark.parametrize(("gain", "branch"), [(0.3, "stable"), (0.3, "unstable")])
def test_energy_of_a_cycle(orbit, gain, branch):
    """J int v'^2 = kp int v^2 over a slip, and (kd kp/J - ki) int v^2 + int v' dF = 0, a stop counted by its jump.

    Quadrature by the polynomial of each interval, which between its points is good for its last Legendre coefficient:
    the square root of the tolerance, 3e-5.
    """
    found = orbit("switch", gain, branch)
    servo, (kp, kd, ki) = found.servo, found.servo.torque_gains(gain)
    J, f = servo.inertia, servo.friction
    nodes, weights = legendre.leggauss(12)
    slip = found.arcs[0]
    degree = slip.states.shape[1] - 1
    x = scheme(degree, "gauss").interpolation((nodes + 1) / 2) @ slip.states  # (N, 12, 3)
    w = (weights / 2)[None, :] * (np.diff(slip.breaks) * slip.duration)[:, None]
    side = np.sign(x[..., 1].mean())
    v = side * x[..., 1]
    drop = (f.static - f.coulomb) * np.exp(-((v / f.stribeck_velocity) ** 2))
    slope = -2 * v / f.stribeck_velocity**2 * drop + f.viscous
    torque = -side * (kp * x[..., 0] + kd * x[..., 1] + ki * x[..., 2])
    a = (torque - f.coulomb - drop - f.viscous * v) / J
    vv, aa = float(np.sum(w * v**2)), float(np.sum(w * a**2))
    assert J * aa == pytest.approx(kp * vv, rel=1e-4)
    end = slip.end
    last = (-side * (kp * end[0] + ki * end[2]) - f.static) / J  # acceleration just before the stop, v = 0 and g = Fs
    balance = (kd * kp / J - ki) * vv + float(np.sum(w * slope * a**2)) + J * last**2 / 2
    assert abs(balance) < 1e-4 * ki * vv


def test_no_known_cycle_is_denied():
    for model in ("switch", "lugre"):
        reference = table1.REFERENCE[model]
        for gain in [row["K"] for branch in ("stable", "unstable") for row in reference[branch]] + [0.0]:
            assert no_cycle(table1.servo(), model, gain) == ""
    gain = 0.0088
    assert RISING.friction.viscous > steepest_fall(RISING)
    assert reached(RISING, gain, 0.027) > 1 > reached(RISING, gain, 0.034)  # a fixed point between
    assert no_cycle(RISING, "switch", gain) == "" == no_cycle(RISING, "switch")


def test_where_the_proof_begins():
    """(kd + sigma2 - s) (tau_i + tau_d) = J, the slope s from the curve itself; and every motion shrinks above."""
    servo, c = RISING, RISING.controller
    least = servo.inertia / (c.integral_time + c.lead_time) + steepest_fall(servo) - servo.friction.viscous
    gain = least / (servo.motor_gain * c.lead_time)
    assert no_cycle(servo, "switch", gain * (1 - 1e-6)) == ""
    assert "more energy is lost" in no_cycle(servo, "switch", gain * (1 + 1e-6))
    assert no_cycle(servo, "lugre", 100 * gain) == ""  # bristles are no function of the velocity
    for part in (0.02, 0.3, 2, 10):
        assert reached(servo, 1.01 * gain, part) < 1


def test_pure_coulomb_friction_and_an_unstable_loop():
    """Motions far out grow and the others settle: a cycle parts them, and is not denied.  Above, none is."""
    gain = 0.3 * routh_hurwitz_gain(COULOMB)
    assert reached(COULOMB, gain, 0.5) < 1 < reached(COULOMB, gain, 3)
    assert no_cycle(COULOMB, "switch", gain) == ""
    said = "at gain 0.0353 or above: static equals .*sustain an oscillation.* scanned stick"
    with pytest.raises(NoOrbit, match=said) as refused:
        find_orbit(COULOMB, "switch", 0.0353)
    assert refused.value.status is None


def turns(servo: Servo, gain: float, a: float, until: float) -> np.ndarray:
    """|x1| where the LuGre servo turns, from rest at x1 = a with a relaxed bristle, by Runge-Kutta's classical rule."""
    (kp, kd, ki), f, h = servo.torque_gains(gain), servo.friction, 2e-4

    def rates(x1, x2, x3, z):
        slip = x2 - f.stiffness * abs(x2) * z / f.coulomb
        friction = f.stiffness * z + f.damping * slip + f.viscous * x2
        return x2, (-(kp * x1 + kd * x2 + ki * x3) - friction) / servo.inertia, x1, slip

    x, found = (a, 0.0, -kp * a / ki, 0.0), []
    for _ in range(round(until / h)):
        k1 = rates(*x)
        k2 = rates(*(q + h / 2 * k for q, k in zip(x, k1, strict=True)))
        k3 = rates(*(q + h / 2 * k for q, k in zip(x, k2, strict=True)))
        k4 = rates(*(q + h * k for q, k in zip(x, k3, strict=True)))
        was, x = x[1], tuple(
            q + h / 6 * (a + 2 * b + 2 * c + d) for q, a, b, c, d in zip(x, k1, k2, k3, k4, strict=True)
        )  # fmt: skip
        found += [abs(x[0])] if was * x[1] < 0 else []
    return np.array(found)


@pytest.mark.slow
def test_a_bristle_hunts_where_rigid_friction_does_not():
    """One motion grows, another shrinks, to the same swings: a stable cycle, denied by no theorem on rigid friction.

    A turn is seen up to a step late, when the servo has moved h^2/2 times its acceleration of 400 rad/s^2: 8e-6 rad.
    """
    gain = 0.0425
    assert "cannot sustain an oscillation" in no_cycle(SOFT, "switch", gain) and no_cycle(SOFT, "lugre", gain) == ""
    inside, outside = turns(SOFT, gain, 0.3, 40.0), turns(SOFT, gain, 100.0, 40.0)
    assert inside[0] < 1 and 25 < outside[0]
    assert inside[-2:] == pytest.approx(outside[-1], abs=1e-5)
    assert refusals.check_problem(SOFT, "lugre", gain) is None  # its scan has met the cycle: it is sought


@pytest.mark.parametrize("seed", range(4))
def test_what_a_bristle_without_a_drop_gives_and_takes(seed):
    """The four integrals of the proof and its bound, for random speeds, by the trapezoidal rule on z itself.

    The rule is of second order where |v| has its corners: (2 pi/40000)^2 = 2.5e-8 times the slopes there, up to 40.  A
    period slides many times zc, so that z is periodic from the second one on.
    """
    rng = np.random.default_rng(seed)
    n, zc = 40000, 0.05
    t = np.linspace(0, 2 * np.pi, n + 1)
    k = np.arange(1, 5)[:, None]
    c, s = rng.normal(size=(2, 4, 1)) / k
    v = np.sum(c * np.cos(k * t) + s * np.sin(k * t), axis=0)
    a = np.sum(k * (s * np.cos(k * t) - c * np.sin(k * t)), axis=0)
    slid = np.concatenate([[0], np.cumsum((np.abs(v[1:]) + np.abs(v[:-1])) / 2) * t[1]])
    z = np.zeros(2 * n + 1)
    fade = np.tile(np.exp(-np.diff(slid) / zc), 2)
    side = np.tile(np.sign(v[1:] + v[:-1]), 2)
    for i in range(2 * n):  # exact while |v| slides: z -> sgn(v) zc
        z[i + 1] = side[i] * zc + (z[i] - side[i] * zc) * fade[i]
    z = z[n:]

    def over_a_period(f):
        return float(np.sum(f[1:] + f[:-1])) * t[1] / 2

    rate = v - np.abs(v) * z / zc
    rate_rate = a - (np.sign(v) * a * z + np.abs(v) * rate) / zc
    h = 1 - np.sign(v) * z / zc
    A, B = over_a_period(a**2 * h), over_a_period(v**4 * h) / zc**2
    assert h.min() >= -1e-12 and h.max() <= 2
    third = over_a_period(np.abs(v) ** 3 * h) / (2 * zc)
    assert over_a_period(rate * v) == pytest.approx(over_a_period(v**2 * h), abs=1e-6)
    assert over_a_period(rate * a) == pytest.approx(third, abs=1e-6)
    assert over_a_period(rate_rate * v) == pytest.approx(-third, abs=1e-6)
    assert over_a_period(rate_rate * a) == pytest.approx(A - B / 3, abs=1e-6)
    assert -4 * over_a_period(a**2) <= -2 * A <= A - B / 3


def test_where_the_proof_for_a_bristle_begins():
    """(kd + sigma2 - 4 sigma1) (tau_i + tau_d) = J, with sigma1 <= sigma0 (tau_i + tau_d); all settle above."""
    light = COULOMB.replace(**{"friction.damping": 0.05})
    c = light.controller
    times = c.integral_time + c.lead_time
    gain = (light.inertia / times + 4 * light.friction.damping) / (light.motor_gain * c.lead_time)
    assert no_cycle(light, "lugre", gain * (1 - 1e-6)) == "" != no_cycle(light, "switch", gain * (1 - 1e-6))
    assert "takes more energy than it gives" in no_cycle(light, "lugre", gain * (1 + 1e-6))
    for stiffness, proved in ((0.05 / times * (1 - 1e-6), False), (0.05 / times * (1 + 1e-6), True)):
        assert bool(no_cycle(light.replace(**{"friction.stiffness": stiffness}), "lugre", 2 * gain)) == proved
    seen = scan(StickMap("lugre", light, 1.01 * gain))
    assert seen.upper is None and seen.conclusive and seen.best < 1
    with pytest.raises(NoOrbit, match="no hunting limit cycle of the lugre servo at gain .* or above") as refused:
        find_orbit(light, "lugre", 1.01 * gain)
    assert refused.value.status is None


@pytest.mark.parametrize("failed", [False, True])
def test_the_bristle_of_table1_without_a_drop_is_not_found(monkeypatch, failed):
    """Its damping lies beyond the proof: what is said rests on the limit and on a scan, however little that saw.

    Patched: a scan of which every motion fails.
    """
    servo = Servo().replace(**{"friction.static": 0.44})
    if failed:
        nothing = Scan(1.0, 2.0, math.nan, math.nan, None, (1.0,) * 8, 0)
        monkeypatch.setattr(refusals, "scan", lambda *_: nothing)
    saw = "none of 8 motions" if failed else "scanned stick positions"
    for ask in (lambda: find_orbit(servo, "lugre", 0.1), lambda: find_fold.find_fold(servo, "lugre")):
        with pytest.raises(NoOrbit, match=f"found at gain .* not prove .* in the limit of stiff .*{saw}") as refused:
            ask()
        assert refused.value.status is Status.NOT_FOUND


def test_a_proof_does_without_a_fold(monkeypatch):
    """At three times the fold gain of Table 1, were the fold not located, which only a patch can bring about."""

    def lost(*arguments, **options):
        raise NoOrbit("lost", Status.NOT_CONVERGED)

    monkeypatch.setattr(find, "find_fold", lost)
    with pytest.raises(NoOrbit, match="no hunting limit cycle .* at gain 2 or above: the friction curve") as refused:
        find_orbit(Servo(), "switch", 2.0)
    assert refused.value.status is None and 2.0 > table1.REFERENCE["switch"]["fold"]["K"]
    with pytest.raises(NoOrbit) as refused:
        find_orbit(Servo(), "switch", 0.9)  # above the fold as well, and below what is proved
    assert refused.value.status is not None


def test_an_unstable_loop_is_told_where_no_cycle_is_found():
    """An inertia in kg cm2: the poles of the loop without dry friction lie to the right."""
    servo = Servo(inertia=260.0)
    kp, kd, ki = servo.torque_gains(0.04)
    assert np.roots([servo.inertia, servo.friction.viscous + kd, kp, ki]).real.max() > 0
    with pytest.raises(NoOrbit, match="not located either; the loop is unstable there without dry friction too"):
        find_orbit(servo, "switch", 0.04)


@pytest.mark.slow
@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_pure_coulomb_friction_below_is_not_found(branch, monkeypatch):
    monkeypatch.setattr(find_fold, "SEARCH_FACTORS", 1)
    with pytest.raises(NoOrbit, match="was found at gain .*, which does not prove that there is none") as refused:
        find_orbit(COULOMB, "switch", 0.3 * routh_hurwitz_gain(COULOMB), branch=branch)
    assert refused.value.status is Status.NOT_FOUND


@pytest.mark.parametrize(
    ("failed", "motions", "conclusive"), [(0, 20, True), (1, 200, True), (100, 100, False), (3, 0, False)]
)
def test_a_scan_shows_nothing_where_too_many_motions_failed(failed, motions, conclusive):
    seen = Scan(1e-3, 1.0, 0.5, 0.1, None, tuple(np.geomspace(1e-3, 1.0, failed)), motions)
    assert seen.conclusive == conclusive
