"""The proof that there is no cycle: its energy balance on computed cycles, its bound where cycles are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import legendre

from casahunt import NoOrbit, Servo, Status, find_orbit
from casahunt.collocation.scheme import scheme
from casahunt.servo import cold_start, find_fold
from casahunt.servo import find_orbit as find
from casahunt.servo.denial import no_cycle
from casahunt.servo.event_map.scan import Scan
from casahunt.servo.linear_loop import routh_hurwitz_gain
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
    with pytest.raises(NoOrbit, match="at gain 0.0353 or above: static equals .*Bisoffi.* scanned stick") as refused:
        find_orbit(COULOMB, "switch", 0.0353)
    assert refused.value.status is None


@pytest.mark.parametrize("scanned", [True, False])
def test_a_proof_does_without_a_fold(monkeypatch, scanned):
    """At three times the fold gain of Table 1, were the fold not located, nor a motion computed."""

    def lost(*arguments, **options):
        raise NoOrbit("lost", Status.NOT_CONVERGED)

    monkeypatch.setattr(find, "find_fold", lost)
    if not scanned:
        nothing = Scan(1.0, 2.0, math.nan, math.nan, None, None, (1.0,) * 8, 0)
        monkeypatch.setattr(find, "stable_at", lambda *a, **k: cold_start.Met(None, False, nothing))
    with pytest.raises(NoOrbit, match="no hunting limit cycle .* at gain 2 or above: the friction curve") as refused:
        find_orbit(Servo(), "switch", 2.0)
    assert refused.value.status is None and 2.0 > table1.REFERENCE["switch"]["fold"]["K"]
    with pytest.raises(NoOrbit) as refused:
        find_orbit(Servo(), "switch", 0.9)  # above the fold as well, and below what is proved
    assert refused.value.status is not None


@pytest.mark.slow
@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_pure_coulomb_friction_below_is_not_found(branch, monkeypatch):
    monkeypatch.setattr(find_fold, "SEARCH_FACTORS", 1)
    with pytest.raises(NoOrbit, match="was found at gain .*, which does not prove that there is none") as refused:
        find_orbit(COULOMB, "switch", 0.3 * routh_hurwitz_gain(COULOMB), branch=branch)
    assert refused.value.status is Status.NOT_FOUND
