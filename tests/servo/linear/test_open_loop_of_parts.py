"""The linear loop of a loop of parts against that of the servo, and against transfer functions written down."""

import casadi as ca
import numpy as np
import pytest

from casahunt import InputError, Servo, linear_loop, margins
from casahunt.servo.linear.margins import gain_crossovers, phase_crossovers
from casahunt.servo.linear.open_loop import linear_stable, open_loop_of_parts
from casahunt.servo.parts import (
    BACK_CALCULATION,
    CLAMPING,
    DEAD_BAND,
    DERIVATIVE_FILTER,
    ERROR_FILTER,
    FEEDFORWARD,
    FREEZE,
    INTEGRATOR,
    LEAK,
    P_PI,
    PID_BY_GAINS,
    RESET_AT_STOP,
    RESET_AT_ZERO,
    SWITCH,
    TORQUE_LIMIT,
    TWO_MASSES,
    TWO_MASSES_LOAD_SEEN,
    Loop,
    loop_of,
    series,
    transfer_function,
)  # fmt: skip
from casahunt.servo.parts.inertia import INERTIA

J, VISCOUS = 0.026, 0.1
KP, KI, KD = 2.0, 2 * np.pi, 1 / (2 * np.pi)
"""Table 1's; gains of its controller, in units of K cm."""


def plain(gain=0.04):
    return loop_of(Servo(), "switch", gain)


def same(found, numerator, denominator):
    """Margins by the crossovers of a transfer function that is written down, the loop stable."""
    least = min(at.margin % 360 for at in gain_crossovers(numerator, denominator))
    assert found.stable and found.phase_margin == pytest.approx(least, rel=1e-9)
    factors = [at.margin for at in phase_crossovers(numerator, denominator)]
    assert found.lowest_factor == pytest.approx(max((f for f in factors if f < 1), default=0.0), rel=1e-8)
    assert found.highest_factor == pytest.approx(min((f for f in factors if f > 1), default=np.inf), rel=1e-8)


@pytest.mark.parametrize("gain", [0.04, 0.3, 3.0])
@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_of_the_plain_servo(model, gain):
    servo = Servo().replace(**{"friction.viscous": 0.02})
    found, truth = margins(loop_of(servo, model, gain)), margins(servo, gain)
    for name in ("frequency", "phase_margin", "lowest_factor", "highest_factor", "stable"):
        assert getattr(found, name) == pytest.approx(getattr(truth, name), rel=1e-9, nan_ok=True), name


def test_a_leak():
    """C(s) = kp + kd s + ki/(s + leak)."""
    K, leak = 0.04 * 16, 0.3
    numerator = K * np.polyadd(np.polymul([KD, KP], [1, leak]), [KI])
    same(margins(plain().with_parts(LEAK, leak=leak)), numerator, np.polymul([J, VISCOUS, 0], [1, leak]))


def test_a_filtered_error():
    """C(s)/(T s + 1); beyond the phase that it costs the loop is unstable."""
    K = 0.04 * 16
    T = 0.02
    same(margins(plain().with_parts(ERROR_FILTER, filter_time=T)),
         K * np.array([KD, KP, KI]), np.polymul([J, VISCOUS, 0, 0], [T, 1]))  # fmt: skip
    slow = margins(plain().with_parts(ERROR_FILTER, filter_time=0.2))
    assert not slow.stable and slow.phase_margin < 0 and np.isnan(slow.lowest_factor)


def test_two_masses():
    """P(s) = (JL s^2 + k) / (s ((J s + b)(JL s^2 + k) + k JL s)), the motor measured."""
    k, JL, K = 100.0, J, 0.04 * 16
    bar = np.array([JL, 0, k])
    denominator = np.polymul([1, 0], np.polyadd(np.polymul([J, VISCOUS], bar), [k * JL, 0]))
    loop = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR))
    numerator = np.polymul(K * np.array([KD, KP, KI]), bar)
    poles = np.roots(np.polyadd(np.polymul([1, 0], denominator), numerator))
    assert poles.real.max() < 0
    same(margins(loop), numerator, np.polymul([1, 0], denominator))


def test_a_transfer_function():
    numerator, denominator = [0.2, 2.0, 6.0], [0.01, 1.0, 0.0]
    loop = Loop((INERTIA, SWITCH, transfer_function(numerator, denominator)), {"gain": 0.04})
    same(margins(loop), 0.64 * np.array(numerator), np.polymul([J, VISCOUS, 0], denominator))


def test_what_compensates_dry_friction_leaves_the_linear_loop_as_it_is():
    found = margins(plain().with_parts(FEEDFORWARD, compensated=0.5))
    assert found.phase_margin == margins(plain()).phase_margin


@pytest.mark.parametrize(("part", "size"), [
    (DEAD_BAND, 0.01), (FREEZE, 1.0), (RESET_AT_ZERO, 0.5), (RESET_AT_STOP, 0.5),
])  # fmt: skip
def test_a_loop_that_is_not_linear_has_none(part, size):
    loop = plain().with_parts(part, **{part.size: size})
    assert open_loop_of_parts(loop) is None
    with pytest.raises(InputError, match=f"is not linear: {part.name} switch"):
        margins(loop)


@pytest.mark.parametrize("part", [TORQUE_LIMIT, CLAMPING, BACK_CALCULATION])
def test_within_a_torque_limit_the_loop_is_that_without(part):
    """Of large motions its margins say nothing: whether these grow for ever is not known by them."""
    K, loop = 0.04 * 16, plain().with_parts(part, torque_limit=0.9)
    same(margins(loop), K * np.array([KD, KP, KI]), [J, VISCOUS, 0, 0])
    assert linear_loop(loop).stable and linear_stable(loop) is None


NOTCH = {"notch_frequency": 60.0, "notch_damping": 0.4, "notch_depth": 0.2}


@pytest.mark.parametrize(("filters", "numbers", "numerator", "denominator"), [
    (("low-pass",), {"low_pass": 5.0}, [5], [1, 5]),
    (("lead",), {"lead_zero": 12.0, "lead_pole": 90.0}, [90 / 12, 90], [1, 90]),
    (("notch",), NOTCH, [1, 2 * 0.2 * 0.4 * 60, 3600], [1, 2 * 0.4 * 60, 3600]),
    (("second-order low-pass",), {"filter_frequency": 80.0, "filter_damping": 0.6}, [6400], [1, 96, 6400]),
    (("notch", "low-pass"), NOTCH | {"low_pass": 40.0},
     40 * np.array([1, 2 * 0.2 * 0.4 * 60, 3600]), np.polymul([1, 2 * 0.4 * 60, 3600], [1, 40])),
])  # fmt: skip
def test_filters_behind_the_controller_are_in_the_loop(filters, numbers, numerator, denominator):
    """A low-pass of 5 rad/s makes the loop unstable, whose phase margin was that without it."""
    gain = 0.1
    without, s = plain(gain), 1j * np.geomspace(0.1, 300, 40)
    found = open_loop_of_parts(without.with_parts(series(*filters), **numbers))
    L = open_loop_of_parts(without).response(s.imag) * np.polyval(numerator, s) / np.polyval(denominator, s)
    assert found.response(s.imag) == pytest.approx(L, rel=1e-10)
    assert found.stable == (filters != ("low-pass",))


@pytest.mark.parametrize("parts", [
    (INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR, series("low-pass", "lead")),
    (INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR, DERIVATIVE_FILTER, series("notch")),
    (TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR, ERROR_FILTER, series("low-pass")),
    (TWO_MASSES_LOAD_SEEN, SWITCH, P_PI, INTEGRATOR, series("second-order low-pass", "notch")),
    (INERTIA, SWITCH, transfer_function([1.0, 20.0], [0.001, 1.0]), series("lead")),
])  # fmt: skip
def test_the_poles_are_those_of_the_motion(parts):
    """Of a servo whose dry friction is one number, while it slips: eigenvalues of its field's Jacobian."""
    loop = Loop(parts, {"gain": 0.1, "static": 0.4, "coulomb": 0.4})
    system = loop.system
    mode = next(mode for mode in system.vector_form.modes.values() if mode.flow is None)
    x, p = ca.SX.sym("x", len(system.states)), ca.SX.sym("p", len(system.parameters))
    slope = ca.Function("slope", [x, p], [ca.jacobian(mode.field(x, p, mode.sign), x)])
    A = np.array(slope(np.full(len(system.states), 0.1), system.values(None)))
    poles, truth = open_loop_of_parts(loop).poles, list(np.linalg.eigvals(A))
    for pole in poles:  # each is one of them
        nearest = min(truth, key=lambda other: abs(other - pole))
        assert pole == pytest.approx(nearest, rel=1e-6, abs=1e-6)
        truth.remove(nearest)
    assert not truth


def belt(random):
    """Two masses, the load on a shaft that is hardly damped, and L written down from the equations of motion."""
    J1, J2, k = 10.0 ** random.uniform(-4, -3, 3) * (1, 4, 1e5)
    damping, b = 10 ** random.uniform(-5, -2), 0.002
    kp, ki, kd = 10 ** random.uniform(-1, 1) * np.array([6, 60, 0.12])
    numbers = {"inertia": J1, "load_inertia": J2, "shaft_stiffness": k, "shaft_damping": damping, "motor_gain": 1.0,
               "kp": kp, "ki": ki, "kd": kd, "gain": 1.0, "viscous": b}  # fmt: skip
    loop = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), numbers)
    A = np.array([[0, 1, 0, 0, 0], [-k / J1, -(b + damping) / J1, k / J1, damping / J1, 0], [0, 0, 0, 1, 0],
                  [k / J2, damping / J2, -k / J2, -damping / J2, 0], [1, 0, 0, 0, 0]])  # fmt: skip
    return loop, A, np.array([0, 1 / J1, 0, 0, 0]), np.array([kp, kd, 0, 0, ki])


def rightmost(A, b, c, delay, points=40):
    """The largest real part of the poles: Chebyshev collocation of the generator of x' = A x - b c x(t - delay)."""
    if delay == 0:
        return np.linalg.eigvals(A - np.outer(b, c)).real.max()
    k, n = np.arange(points + 1), b.size
    x = np.cos(np.pi * k / points)
    weights = np.where((k == 0) | (k == points), 2, 1) * (-1.0) ** k
    D = np.outer(weights, 1 / weights) / (x[:, None] - x[None, :] + np.eye(points + 1))
    M = np.kron((D - np.diag(D.sum(axis=1))) * 2 / delay, np.eye(n))
    M[:n] = 0
    M[:n, :n], M[:n, -n:] = A, -np.outer(b, c)
    return np.linalg.eigvals(M).real.max()


@pytest.mark.parametrize("delay", [0.0, 1e-3])
def test_two_masses_on_a_shaft_that_is_hardly_damped(delay):
    """Stable where no pole is to the right; 0.1 per cent within each limit, and not as far beyond."""
    random, seen = np.random.default_rng(40), {True: 0, False: 0}
    for _ in range(30):
        loop, A, b, c = belt(random)
        found, size = margins(loop, delay=delay), rightmost(A, b, c, delay)
        assert found.stable == (size < 0), loop.values
        seen[found.stable] += 1
        for factor, outwards in ((found.lowest_factor, -1e-3), (found.highest_factor, 1e-3)) if found.stable else ():
            if 0 < factor < np.inf:
                assert rightmost(A, b, factor * (1 - outwards) * c, delay) < 0
                assert rightmost(A, b, factor * (1 + outwards) * c, delay) > 0
    assert not delay or min(seen.values()) > 3
