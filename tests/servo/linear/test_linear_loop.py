"""The linear loop: closed forms, textbook loops with several crossovers, and the border of stability."""

from __future__ import annotations

import json

import numpy as np
import pytest

from casahunt import InputError, Servo, cli
from casahunt.servo.gains import lowest_stable_gain, routh_hurwitz_gain
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.margins import gain_crossovers, margins_of, phase_crossovers
from casahunt.servo.linear.open_loop import OpenLoop, open_loop

SMOOTH = Servo().replace(**{"friction.viscous": 0.0})
LIGHTLY_DAMPED = Servo().replace(**{"friction.viscous": 0.03, "controller.integral_time": 0.3})


def run(capsys, *words: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = cli.main([str(word) for word in words])
    return code, *capsys.readouterr()


def test_the_bounds_of_table_1():
    """Report, section 2: 0.0321 without friction. With sigma2 = 0.1 > J/(tau_i + tau_d) = pi J: none."""
    assert routh_hurwitz_gain(Servo()) == pytest.approx(0.0321, abs=5e-5)
    assert routh_hurwitz_gain(Servo()) == pytest.approx(0.026 * 2 * np.pi**2 / 16, rel=1e-14)
    assert lowest_stable_gain(SMOOTH) == pytest.approx(routh_hurwitz_gain(SMOOTH), rel=1e-14)
    assert lowest_stable_gain(Servo()) == 0
    assert routh_hurwitz_gain(Servo().replace(**{"controller.lead_time": 0.0})) == float("inf")


def test_without_lead_the_gain_decides_nothing():
    """tau_d = 0: sigma2 tau_i > J or not, whatever K."""
    weak = Servo().replace(**{"controller.lead_time": 0.0})
    strong = weak.replace(**{"friction.viscous": 0.2})
    assert (lowest_stable_gain(weak), lowest_stable_gain(strong)) == (float("inf"), 0.0)
    for gain in (1e-4, 0.1, 10.0):
        assert not linear_loop(weak, gain).stable and linear_loop(weak, gain).poles[0].real > 0
        assert linear_loop(strong, gain).stable and linear_loop(strong, gain).poles[0].real < 0


@pytest.mark.parametrize("servo", [SMOOTH, LIGHTLY_DAMPED])
def test_the_limit_is_where_poles_cross(servo):
    """At the limit chi = (J s + kd + sigma2)(s^2 + kp/J): a pair on the imaginary axis; the poles agree beside it."""
    limit = lowest_stable_gain(servo)
    kp, kd, _ = servo.torque_gains(limit)
    poles = linear_loop(servo, limit).poles
    exact = [1j * np.sqrt(kp / servo.inertia), -(kd + servo.friction.viscous) / servo.inertia]
    assert np.min(np.abs(poles - exact[0])) < 1e-12 * abs(exact[0])
    assert np.min(np.abs(poles - exact[1])) < 1e-12 * abs(exact[1])
    for factor in (1 - 1e-6, 1 + 1e-6):
        loop = linear_loop(servo, limit * factor)
        assert loop.stable == (factor > 1) == (loop.poles[0].real < 0)
        # The gain margin is the distance to that limit: the loop is lost by lowering the gain.
        assert (loop.lowest_factor if loop.stable else loop.highest_factor) == pytest.approx(1 / factor, rel=1e-12)
        assert loop.phase_crossovers[0].frequency == pytest.approx(abs(exact[0]), rel=1e-9)


def test_stable_for_every_gain_with_the_friction_of_table_1():
    for gain in np.geomspace(1e-6, 1e3, 91):
        loop = linear_loop(Servo(), float(gain))
        assert loop.stable and loop.poles[0].real < 0 and loop.damping_ratio > 0
        assert (loop.phase_crossovers, loop.lowest_factor, loop.highest_factor) == ((), 0.0, float("inf"))


@pytest.mark.parametrize("gain", [1e-3, 0.02, 0.1, 0.6, 30.0])
@pytest.mark.parametrize("servo", [Servo(), SMOOTH, LIGHTLY_DAMPED])
def test_crossovers_lie_on_the_loop(servo, gain):
    loop = linear_loop(servo, gain)
    assert len(loop.gain_crossovers) == 1  # Descartes, see the module
    at = loop.gain_crossovers[0]
    value = open_loop(servo, gain).response(np.array([at.frequency]))[0]
    assert abs(value) == pytest.approx(1, rel=1e-12)
    assert value == pytest.approx(-np.exp(1j * np.radians(at.margin)), abs=1e-12)
    assert (at.margin > 0) == loop.stable
    for c in loop.phase_crossovers:
        value = open_loop(servo, gain).response(np.array([c.frequency]))[0]
        assert value == pytest.approx(-1 / c.margin, rel=1e-9)
    for pole in loop.poles:  # 1 + L = 0
        assert open_loop(servo, gain).response(np.array([pole / 1j]))[0] == pytest.approx(-1, rel=1e-8)


def test_poles_solve_the_equations_of_motion():
    """They are the eigenvalues of x1' = x2, J x2' = m - sigma2 x2, x3' = x1."""
    kp, kd, ki = Servo().torque_gains(0.1)
    J, sigma2 = 0.026, 0.1
    matrix = np.array([[0, 1, 0], [-kp / J, -(kd + sigma2) / J, -ki / J], [1, 0, 0]])
    closed = open_loop(Servo(), 0.1).closed
    assert closed / closed[0] == pytest.approx(np.poly(matrix), rel=1e-12)


def test_several_gain_crossovers():
    """L = k (s^2 + 1)/(s (s^2 + a s + b)): |L| = 1 solved by hand through its cubic in omega^2.

    With (w - 1)^2 k^2 = w ((b - w)^2 + a^2 w) and the roots w = 1/2, 2, 4 prescribed: k^2 = product = 4,
    a^2 - 2 b = k^2 - 6.5 = -2.5, and b^2 + 2 k^2 = 1/2 2 + 1/2 4 + 2 4 = 11, so b = sqrt 3, a^2 = 2 sqrt 3 - 2.5.
    """
    b = np.sqrt(3)
    a = np.sqrt(2 * b - 2.5)
    found = gain_crossovers([2, 0, 2], [1, a, b, 0])
    assert [c.frequency**2 for c in found] == pytest.approx([0.5, 2, 4], rel=1e-12)
    for c in found:
        value = 2 * (1 - c.frequency**2) / (1j * c.frequency * (b - c.frequency**2 + 1j * a * c.frequency))
        assert value == pytest.approx(-np.exp(1j * np.radians(c.margin)), abs=1e-12)
        assert -180 < c.margin <= 180


def test_conditionally_stable_loop():
    """L = (s + 1)^2/s^3 crosses the negative axis once: arg = -270 + 2 atan(omega) = -180 at omega = 1, |L| = 2.

    Exact: s^3 + k (s + 1)^2 is stable for 2 k^2 > k, k > 1/2.  And 1/(s + 1)^3 crosses at sqrt 3 with |L| = 1/8.
    """
    (only,) = phase_crossovers([1, 2, 1], [1, 0, 0, 0])
    assert (only.frequency, only.margin) == pytest.approx((1, 0.5), rel=1e-12)
    (only,) = phase_crossovers([1], [1, 3, 3, 1])
    assert (only.frequency, only.margin) == pytest.approx((np.sqrt(3), 8), rel=1e-12)


def test_a_touching_crossover_is_one_and_no_crossover_is_none():
    assert gain_crossovers([0.5], [1, 1]) == ()
    # |1 + j omega|^2/|...| touching one: L = 2 s/(s + 1)^2 has its maximum |L| = 1 at omega = 1.
    touching = gain_crossovers([2, 0], [1, 2, 1])
    assert all(c.frequency == pytest.approx(1, abs=1e-6) for c in touching) and touching
    with pytest.raises(InputError, match="every frequency"):
        gain_crossovers([1, -1], [1, 1])
    with pytest.raises(InputError, match="every frequency"):
        phase_crossovers([1], [2])


def ringing(frequency: float, size: float) -> OpenLoop:
    """0.5/(s + 1) + size 2 zeta w0 s/(s^2 + 2 zeta w0 s + w0^2), zeta = 0.1."""
    ring = np.array([1, 0.2 * frequency, frequency**2])
    slow, fast = 0.5 * ring, size * 0.2 * frequency * np.array([1.0, 1.0, 0.0])
    return OpenLoop(np.polyadd(slow, fast), np.polymul([1, 1], ring))


def test_no_turn_of_a_delay_that_counts_is_passed_over():
    """Where it turns the phase 1600 times below the ringing, a limit is the largest 1/|L| of all negative real L; where
    it does so 16,000 times it is refused, and answered where the ringing is too small to count."""
    opened = ringing(1e4, 0.9)
    omega = np.linspace(0.01, 2e4, 2_000_001)
    L = opened.response(omega, 1.0)
    across = np.flatnonzero((L.imag[1:] * L.imag[:-1] < 0) & (L.real[1:] < 0))
    assert margins_of(opened, 1.0).highest_factor == pytest.approx(1 / np.abs(L[across]).max(), rel=1e-6)
    with pytest.raises(InputError, match=r"delay = 1: turns the phase 1.59e\+04 times below 1e\+05 rad"):
        margins_of(ringing(1e5, 0.9), 1.0)
    with pytest.raises(InputError, match="only the first 2000 turns are looked at: shorten the delay"):
        margins_of(ringing(1e5, 1.5), 1.0)
    small, none = margins_of(ringing(1e5, 0.1), 1.0), margins_of(ringing(1e5, 0.0), 1.0)
    assert small.stable and small.highest_factor == pytest.approx(none.highest_factor, rel=1e-4)


def test_the_row_of_a_loop_has_its_phase_margin():
    """|L| = 1 at the crossover, and 180 degrees less its phase there, by complex numbers."""
    servo, gain = Servo(), 0.3
    (kp, kd, ki), row = servo.torque_gains(gain), {k: v[0] for k, v in linear_loop(servo, gain)._columns().items()}
    s = 1j * row["crossover_rad_per_s"]
    L = (kd * s**2 + kp * s + ki) / (s**2 * (servo.inertia * s + servo.friction.viscous))
    assert abs(L) == pytest.approx(1, rel=1e-9)
    assert row["phase_margin_deg"] == pytest.approx(np.degrees(np.angle(-L)), abs=1e-7)


def test_controller_shape():
    """Report, Figure 1: equal times give the minimum |C| = 2 K at omega = 1/tau, where the phase is 0."""
    omega = np.geomspace(0.1, 1000, 4001)
    size = np.abs(Servo().controller.response(0.3, 1j * omega))
    assert size.min() == pytest.approx(0.6, rel=1e-5)
    assert omega[size.argmin()] == pytest.approx(2 * np.pi, rel=3e-3)
    assert Servo().controller.response(0.3, np.array([2j * np.pi]))[0] == pytest.approx(0.6, abs=1e-15)


def test_command(capsys, tmp_path):
    picture = tmp_path / "bode.png"
    code, out, err = run(capsys, "loop", "--gain", 0.02, "--gain", 0.1, "--json", "--plot", picture)
    assert (code, err) == (0, "") and out.count("\n") == 1 and picture.stat().st_size > 10_000
    record = json.loads(out)
    assert record["lowest_stable_gain"] == 0
    assert [loop["gain"] for loop in record["loops"]] == [0.02, 0.1] and record["loops"][0]["stable"]
    code, out, _ = run(capsys, "loop", "--gain", 0.02, "--set", "friction.viscous=0", "--details")
    assert code == 0 and "unstable" in out and "0.0320762143" in out
    assert run(capsys, "loop")[0] == run(capsys, "loop", "--gain", 0)[0] == run(capsys, "loop", "--gain", "x")[0] == 2
    assert run(capsys, "loop", "--gain", 0.1, "--plot", tmp_path / "no" / "f.png")[0] == 2
