"""The loop of two masses as built, against its map from sample to sample written out with scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete, tf2ss

from casahunt import Drive, InputError, Servo, margins, simulate_sampled
from casahunt.servo.linear.pulse_transfer import gain_in, pulse_transfer
from casahunt.servo.parts import (
    CLAMPING,
    DEAD_BAND,
    FREEZE,
    INERTIA,
    INTEGRATOR,
    LOAD_SWITCH,
    NO_FRICTION,
    P_PI,
    PID_BY_GAINS,
    SWITCH,
    TWO_MASSES,
    TWO_MASSES_LOAD_SEEN,
    Loop,
    Part,
    loop_of,
    series,
    state_space,
    transfer_function,
)

FILTERED = series("notch", "low-pass")


def filters(numbers: dict[str, float], T: float) -> list[tuple[np.ndarray, ...]]:
    """Notch and low-pass by the backward rule, as scipy has them."""
    w, damping, depth, low = numbers.values()
    continuous = [
        ([1.0, 2 * depth * damping * w, w**2], [1.0, 2 * damping * w, w**2]),
        ([low], [1.0, low]),
    ]
    return [cont2discrete(tf2ss(*each), T, method="backward_diff")[:4] for each in continuous]


class Axis:
    """A random axis: its loop, its drive, and its map written out."""

    def __init__(self, random: np.random.Generator) -> None:
        J, JL = 10.0 ** random.uniform(-4, -3, 2) * (1, 3)
        k, d = 10.0 ** random.uniform(0.5, 2.5), 10.0 ** random.uniform(-5, -2)
        self.b, self.bL = 0.002, float(random.choice([0.0, 1e-3]))
        Kp, Kv, Tn = random.uniform(5, 60), 10 ** random.uniform(-2.5, -0.5), 10 ** random.uniform(-2, -0.5)
        self.kp, self.ki, self.kd = Kv * (Kp + 1 / Tn), Kv * Kp / Tn, Kv
        self.load_seen, self.filtered = bool(random.random() < 0.5), bool(random.random() < 0.5)
        self.numbers = {
            "inertia": J, "load_inertia": JL, "shaft_stiffness": k, "shaft_damping": d, "load_damping": self.bL,
            "viscous": self.b, "motor_gain": 1.0, "gain": 1.0, "position_gain": Kp, "velocity_gain": Kv,
            "reset_time": Tn,
        }  # fmt: skip
        self.filter = {"notch_frequency": math.sqrt(k * (1 / J + 1 / JL)), "notch_damping": 0.5, "notch_depth": 0.1,
                       "low_pass": 2e3} if self.filtered else {}  # fmt: skip
        T = float(10 ** random.uniform(-4, -2.3))
        self.drive = Drive(sample_time=T, delay=float(random.choice([0.0, 0.3, 1.0, 1.4, 3.7])) * T,
                           integration=str(random.choice(["rectangle", "trapezoid"])))  # fmt: skip
        self.A = np.array([
            [0, 1, 0, 0, 0], [-k / J, -(d + self.b) / J, k / J, d / J, 1 / J],
            [0, 0, 0, 1, 0], [k / JL, d / JL, -k / JL, -(d + self.bL) / JL, 0], [0, 0, 0, 0, 0],
        ])  # fmt: skip

    def loop(self, gain: float = 1.0) -> Loop:
        plant = TWO_MASSES_LOAD_SEEN if self.load_seen else TWO_MASSES
        parts = (plant, SWITCH, P_PI, INTEGRATOR, *([FILTERED] if self.filtered else []))
        return Loop(parts, {**self.numbers, **self.filter, "gain": gain})

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A, b, c at the samples: u = -c s, then A s + b u; s: x, torques on their way, last error, sum, filters."""
        T, late = self.drive.sample_time, int(self.drive.delay // self.drive.sample_time + 1e-9)
        part = self.drive.delay - late * T
        behind = filters(self.filter, T) if self.filtered else []
        at = np.cumsum([4, late + 1, 1, 1, *(len(each[0]) for each in behind)])
        one = np.eye(at[-1])
        x, on_way, e0, w0 = one[:4], one[4 : at[1]], one[at[1]], one[at[2]]
        e = x[2 if self.load_seen else 0]
        w = w0 + T * ((e0 + e) / 2 if self.drive.integration == "trapezoid" else e)
        c = self.kp * e + self.ki * w + self.kd * (e - e0) / T
        rows = []
        for (A, B, C, D), end in zip(behind, at[4:], strict=True):
            own = one[end - len(A) : end]
            rows.append(A @ own + B @ c[None])
            c = (C @ own + D * c)[0]
        torques = [*on_way, None]
        b = np.zeros(at[-1])
        state = x
        for torque, lasts in ((torques[0], part), (torques[1], T - part)):
            moved = expm(self.A * lasts)[:4]
            b[:4] = moved[:, :4] @ b[:4] + (moved[:, 4] if torque is None else 0)
            state = moved[:, :4] @ state + np.outer(moved[:, 4], np.zeros(at[-1]) if torque is None else torque)
        b[at[1] - 1] = 1.0
        A = np.vstack([state, on_way[1:], np.zeros((1, at[-1])), e[None], w[None], *rows])
        return A, b, c

    def radius(self, factor: float) -> float:
        """The largest size of an eigenvalue at a factor of the gain."""
        A, b, c = self.matrices()
        return float(np.abs(np.linalg.eigvals(A - factor * np.outer(b, c))).max())


@pytest.mark.parametrize("seed", range(12))
def test_the_response_of_two_masses(seed):
    random = np.random.default_rng(seed)
    axis = Axis(random)
    A, b, c = axis.matrices()
    T = axis.drive.sample_time
    omega = math.pi / T * np.array([0.003, 0.02, 0.1, 0.3, 0.7, 0.97])
    found = pulse_transfer(axis.loop(), axis.drive).response(omega)
    exact = [c @ np.linalg.solve(np.exp(1j * w * T) * np.eye(b.size) - A, b) for w in omega]
    assert found == pytest.approx(np.array(exact), rel=1e-9)


def test_limits_of_two_masses():
    """Stable where no eigenvalue is outside; 0.1 per cent within each limit too, and not as far beyond."""
    random, seen, limits = np.random.default_rng(3), {True: 0, False: 0}, 0
    for _ in range(60):
        axis = Axis(random)
        found = margins(axis.loop(), drive=axis.drive)
        assert found.stable == (axis.radius(1.0) < 1)
        seen[found.stable] += 1
        if not found.stable:
            continue
        low, high = found.lowest_factor, found.highest_factor
        assert 0 <= low < 1 < high < math.inf
        assert axis.radius(0.999 * high) < 1 < axis.radius(1.001 * high)
        assert low == 0 or axis.radius(1.001 * low) < 1 < axis.radius(0.999 * low)
        limits += low > 0
        for between in np.geomspace(max(1.001 * low, 1e-3), 0.999 * high, 9):
            assert axis.radius(between) < 1
    assert min(seen.values()) > 10 and limits > 3


def test_a_controller_by_its_transfer_function_is_run_by_the_backward_rule():
    numerator, denominator, T = [0.2, 2.0, 6.0], [0.01, 1.0, 0.0], 2e-3
    loop = Loop((TWO_MASSES, SWITCH, transfer_function(numerator, denominator)), {"gain": 0.04})
    pid = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), {"gain": 0.04, "kp": 1.0, "ki": 0.0, "kd": 0.0})
    omega = np.geomspace(0.1, 1500, 7)
    z = np.exp(1j * omega * T)
    C = np.polyval(numerator, (1 - 1 / z) / T) / np.polyval(denominator, (1 - 1 / z) / T)
    drive = Drive(sample_time=T, delay=3e-4)
    found, of_one = (pulse_transfer(each, drive).response(omega) for each in (loop, pid))
    assert found == pytest.approx(C * of_one, rel=1e-9)


def test_what_a_drive_adds_that_is_not_linear_is_left_out():
    loop, drive = loop_of(Servo(), "switch", 0.04), Drive(sample_time=1e-3)
    bare = margins(loop, drive=drive)
    more = Drive(sample_time=1e-3, encoder=2000, quantise_torque=0.01, dead_band=0.01, dwell=0.1, reset=0.5,
                 reset_at_stop=0.5, error_dead_band=0.02, compensated=0.5)  # fmt: skip
    assert margins(loop, drive=more) == bare == margins(Servo(), 0.04, drive=drive)


def test_within_a_torque_limit_the_loop_as_built_is_that_without():
    loop, drive = loop_of(Servo(), "switch", 0.04), Drive(sample_time=1e-3)
    assert margins(loop.with_parts(CLAMPING, torque_limit=0.9), drive=drive) == margins(loop, drive=drive)


@pytest.mark.parametrize("part", [DEAD_BAND, FREEZE])
def test_a_loop_that_is_not_linear_has_no_margins_as_built(part: Part):
    loop = loop_of(Servo(), "switch", 0.04).with_parts(part, **{part.size: 0.1})
    with pytest.raises(InputError, match=f"is not linear: {part.name} switch"):
        margins(loop, drive=Drive(sample_time=1e-3))


def test_a_gain_beside_that_of_the_loop_takes_its_place():
    drive, loop = Drive(sample_time=1e-3), loop_of(Servo(), "switch", 0.04)
    assert margins(loop, 0.1, drive=drive) == margins(Servo(), 0.1, drive=drive) != margins(loop, drive=drive)


@pytest.mark.parametrize("drive", [None, Drive(sample_time=1e-3, delay=4e-4)])
def test_friction_of_the_load_leaves_what_is_viscous_of_it(drive):
    """As the damping of the load, of which it is a part."""
    numbers = {"gain": 0.04, "shaft_damping": 0.01}
    own = Loop((TWO_MASSES, NO_FRICTION, LOAD_SWITCH, PID_BY_GAINS, INTEGRATOR), {**numbers, "load_viscous": 0.03})
    other = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), {**numbers, "viscous": 0.0, "load_damping": 0.03})
    assert margins(own, drive=drive).phase_margin == pytest.approx(margins(other, drive=drive).phase_margin, rel=1e-9)


def test_a_shaft_that_nothing_damps():
    """Poles and zeros of L on the axis: unstable with any gain where they leave to the right, as the roots say."""
    random, seen = np.random.default_rng(0), {True: 0, False: 0}
    for i in range(40):
        numbers = {"viscous": 0.0, "gain": 10 ** random.uniform(-2, 1), "shaft_stiffness": 10 ** random.uniform(1, 4),
                   "load_inertia": 0.026 * 10 ** random.uniform(-3, 1)}  # fmt: skip
        loop = Loop(((TWO_MASSES, TWO_MASSES_LOAD_SEEN)[i % 2], SWITCH, PID_BY_GAINS, INTEGRATOR), numbers)
        truth = bool((np.roots(pid_closed(loop)).real < 0).all())
        assert margins(loop).stable is margins(loop, delay=1e-9).stable is truth
        seen[truth] += 1
    assert min(seen.values()) > 10


@pytest.mark.parametrize("stiffness", [1e5, 1e8])
def test_far_below_its_resonance_the_shaft_is_rigid(stiffness):
    """What both masses turn by is no spring's, not by rounding either: L is that of their sum."""
    numbers = {"gain": 0.04, "shaft_stiffness": stiffness, "shaft_damping": 0.01}
    two = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), numbers)
    one = loop_of(Servo(inertia=0.052), "switch", 0.04)
    drive, omega = Drive(sample_time=1e-3, delay=3e-4), np.array([1e-6, 1e-4, 1e-2])
    found, rigid = (pulse_transfer(loop, drive).response(omega) for loop in (two, one))
    assert found == pytest.approx(rigid, rel=1e-11)


def test_a_resonance_that_is_hardly_seen_is_not_passed_over():
    """A small load that rings: 0.1 per cent within the limit no eigenvalue is outside, and not as far beyond."""
    random, J, T = np.random.default_rng(0), 1e-3, 1e-3
    narrow = 0
    for _ in range(20):
        JL, w = J * 10 ** random.uniform(-5, -3), math.pi / T * random.uniform(0.1, 0.6)
        numbers = {"inertia": J, "load_inertia": JL, "shaft_stiffness": JL * w**2, "motor_gain": 1.0, "viscous": 0.01,
                   "shaft_damping": 2 * 10 ** random.uniform(-7, -5) * JL * w}  # fmt: skip
        pid = {"kp": 1.0, "ki": 4.0, "kd": 0.05, "gain": 1.0}
        loop = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), numbers | pid)
        drive = Drive(sample_time=T, delay=float(random.choice([0, 0.4, 1.3])) * T)
        found = margins(loop, drive=drive)
        assert found.stable is pulse_transfer(loop, drive).stable
        if found.stable:
            beside = (pulse_transfer(loop.replace(gain=f * found.highest_factor), drive) for f in (0.999, 1.001))
            assert [each.stable for each in beside] == [True, False]
            narrow += found.highest_factor < 10
    assert narrow > 3


@pytest.mark.parametrize(("stiffness", "gain", "T", "late"), [
    (18.732984863133797, 0.06602352254908797, 0.0031036199860549336, 0.4),
    (67.8641658714282, 0.4633733642725585, 0.00023235455541796332, 2.3),
    (38.179502525786205, 0.010209518347031443, 0.00021040257312469922, 0.4),
])  # fmt: skip
def test_a_pole_on_the_unit_circle_is_passed(stiffness, gain, T, late):
    """At whose frequency, to the last digit, the response is infinite."""
    loop = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR),
                {"viscous": 0.0, "shaft_stiffness": stiffness, "gain": gain})  # fmt: skip
    drive = Drive(sample_time=T, delay=late * T)
    assert margins(loop, drive=drive).stable is pulse_transfer(loop, drive).stable


def pid_closed(loop: Loop) -> np.ndarray:
    """The characteristic polynomial of two masses with a PID."""
    J, JL, k, kp, ki, kd = (loop.value(n) for n in ("inertia", "load_inertia", "shaft_stiffness", "kp", "ki", "kd"))
    K = loop.value("gain") * loop.value("motor_gain")
    over = [k] if TWO_MASSES_LOAD_SEEN in loop.parts else [JL, 0, k]
    return np.polyadd([J * JL, 0, k * (J + JL), 0, 0, 0], K * np.polymul([kd, kp, ki], over))


@pytest.mark.parametrize("t", [1e-6, 1e-3, 0.3, 30.0])
def test_the_gain_of_a_map_is_its_exponential_less_one(t):
    random = np.random.default_rng(1)
    for _ in range(20):
        A = np.diag(10.0 ** random.uniform(-1, 1, 5)) @ (random.normal(size=(5, 5)) - 3 * np.eye(5))
        A[:, 0] = 0
        found, exact = gain_in(A, t), expm(A * t) - np.eye(5)
        assert np.abs(found - exact).max() < 1e-12 * max(1, np.abs(exact).max())
        assert not found[:, 0].any()


def test_a_part_that_runs_away_within_a_sample_is_refused():
    """x' = x/T: by the backward rule (1 - 1) x = x, which has no solution."""
    runs_away = state_space([[1000.0]], [[1.0]], [[6.28]], 2.0)
    loop, drive = Loop((INERTIA, SWITCH, runs_away), {"gain": 0.04}), Drive(sample_time=1e-3)
    for verb in (
        lambda: margins(loop, drive=drive),
        lambda: simulate_sampled(loop, drive=drive, time=0.1),
        lambda: simulate_sampled(loop, drive=drive, time=0.1, velocity=1.0),  # it is not asked first whether it rests
    ):
        with pytest.raises(InputError, match="runs away within one sample"):
            verb()
