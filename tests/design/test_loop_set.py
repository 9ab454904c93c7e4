"""The worst loop of a box and the gains that keep a margin, against the complex response on the frequency axis."""

from __future__ import annotations

import math

import numpy as np
import pytest

from casahunt import Demands, Friction, Pid, Servo
from casahunt.design.tune.demands import DEMANDS
from casahunt.design.tune.loop_set import Table, allowed, common, loop_box, shortfall
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.sampled_loop import Lag

NAMES = ("servo.inertia", "friction.viscous", "controller.lead_time", "controller.integral_time", "servo.motor_gain")


def phases(points: np.ndarray, gains: np.ndarray, delay: float) -> np.ndarray:
    """Phase [rad] above -180 degrees where |L| = 1, for (m, 5) loops and (m,) gains: complex arithmetic, bisection."""
    J, viscous, lead, integral, cm = points.T

    def response(omega):
        s = 1j * omega
        return gains * cm * (lead * s + 1) * (integral * s + 1) / (integral * s * s * (J * s + viscous))

    low, high = np.full(gains.size, 1e-8), np.full(gains.size, 1e10)
    for _ in range(90):
        middle = np.sqrt(low * high)
        outside = np.abs(response(middle)) > 1
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    # Without delay the phase is above -180 degrees by less than 180, or below it by at most 90: no need to unwrap.
    turned = np.angle(-response(low))
    return turned - low * delay


def box_of(ranges: dict[str, tuple[float, float]], delay: float):
    return loop_box(Servo(), ranges, Lag(delay))


@pytest.mark.parametrize(
    "ranges, gain, delay, factors",
    [
        ({"servo.inertia": (0.008, 0.026)}, 0.712, 0.008, (1.0, 1.0)),
        ({"servo.inertia": (0.001, 0.2), "friction.viscous": (0.0, 0.05)}, 0.05, 0.004, (1.0, 1.0)),
        ({"servo.motor_gain": (2.0, 30.0), "servo.inertia": (0.01, 0.08)}, 0.1, 0.006, (1.0, 3.0)),
        ({"controller.lead_time": (0.01, 0.3), "servo.motor_gain": (4.0, 64.0)}, 0.06, 0.0, (0.2, 1.0)),
        ({"friction.viscous": (0.02, 0.2)}, 0.04, 0.0, (0.1, 5.0)),
    ],
)
def test_no_loop_of_a_dense_grid_is_worse(ranges, gain, delay, factors):
    found = box_of(ranges, delay).worst(gain, factors)
    servo, n = Servo(), 161 if len(ranges) == 1 else 41
    base = [servo.inertia, servo.friction.viscous, servo.controller.lead_time, servo.controller.integral_time, 16.0]
    axes = [np.linspace(*ranges[name], n) if name in ranges else np.array([base[i]]) for i, name in enumerate(NAMES)]
    factor = np.geomspace(*factors, 9) if factors[0] < factors[1] else np.ones(1)
    grid = [axis.ravel() for axis in np.meshgrid(*axes, factor, indexing="ij")]
    points, gains = np.stack(grid[:5], axis=1), gain * grid[5]
    least = float(np.min(phases(points, gains, delay)))
    assert found.phase <= least + 1e-9
    assert found.phase == pytest.approx(least, abs=3e-2)  # the spacing of the grid
    # It is a loop of the box.
    own = np.array([[*(found.values[name] for name in NAMES[:4]), 1.0]])
    assert phases(own, np.array([found.kappa]), delay)[0] == pytest.approx(found.phase, abs=1e-8)
    low, high = np.array([ranges.get(name, (value, value)) for name, value in zip(NAMES, base, strict=True)]).T
    assert (low[:4] <= own[0, :4]).all() and (own[0, :4] <= high[:4]).all()
    assert low[4] * factors[0] * (1 - 1e-9) <= found.kappa / gain <= high[4] * factors[1] * (1 + 1e-9)


def test_the_worst_loop_may_lie_inside_of_the_box():
    """Little viscous friction: stable at a large and barely unstable at a tiny motor gain, worst in between."""
    ends = (1e-4, 30.0)
    found = box_of({"servo.motor_gain": ends, "friction.viscous": (0.05, 0.05)}, 0.0).worst(0.04, (1.0, 1.0))
    cm = np.geomspace(*ends, 20001)
    points = np.tile([0.026, 0.05, 1 / (2 * np.pi), 1 / (2 * np.pi), 16.0], (cm.size, 1))
    points[:, 4] = cm
    values = phases(points, np.full(cm.size, 0.04), 0.0)
    i = int(np.argmin(values))
    assert values[i] < min(values[0], values[-1]) - 0.01
    assert found.phase == pytest.approx(float(values[i]), abs=1e-7)
    assert found.kappa / 0.04 == pytest.approx(float(cm[i]), rel=1e-2)


def test_allowed_gains_end_where_the_margin_does():
    box, demands = box_of({"servo.inertia": (0.008, 0.026)}, 0.008), Demands(phase_margin=30, gain_margin=2.0)
    table = Table([box], demands, 1e-3, 10.0)
    J = np.linspace(0.008, 0.026, 50)
    points = np.tile([0.0, 0.1, 1 / (2 * np.pi), 1 / (2 * np.pi), 16.0], (J.size, 1))
    points[:, 0] = J
    for name, factor, least in ((DEMANDS[0], 1.0, math.radians(30)), (DEMANDS[2], 2.0, 0.0)):
        ((_, high),) = allowed([box], demands, table, name)
        assert np.min(phases(points, np.full(J.size, factor * high), 0.008)) == pytest.approx(least, abs=1e-5)
        assert np.min(phases(points, np.full(J.size, factor * high * 1.001), 0.008)) < least


def test_an_interval_narrower_than_the_table_is_found():
    """The phase margin asked for is the largest there is, less a hair."""
    box = box_of({}, 0.01)
    gains = np.geomspace(0.01, 1, 4001)
    points = np.tile([0.026, 0.1, 1 / (2 * np.pi), 1 / (2 * np.pi), 16.0], (gains.size, 1))
    values = phases(points, gains, 0.01)
    best = float(gains[np.argmax(values)])
    demands = Demands(phase_margin=math.degrees(float(values.max()) - 1e-6), gain_margin=1.0)
    ((low, high),) = allowed([box], demands, Table([box], demands, 1e-3, 10.0), DEMANDS[0])
    assert low < best < high and high / low < 1.01
    assert shortfall([box], demands, low, DEMANDS[0])[0] <= 0


def test_common_gains():
    assert common([[(1.0, 2.0), (3.0, 5.0)], [(1.5, 4.0)]]) == [(1.5, 2.0), (3.0, 4.0)]
    assert common([[(1.0, 2.0)], [(3.0, 4.0)]]) == []


def test_a_table_knows_all_crossovers():
    """|L| of this loop by gains rises between two frequencies: the least phi of three, by a polynomial's roots."""
    controller, lag = Pid(kp=1.886, ki=0.8, kd=5.16), 0.2
    servo = Servo(inertia=0.28, motor_gain=1.0, controller=controller, friction=Friction(viscous=5.0))
    found = Table([loop_box(servo, {}, Lag(lag))], Demands(phase_margin=30, gain_margin=1.0), 0.3, 3.0)
    several, off = 0, []
    for gain, missed in zip(found.gains.tolist(), found.missed[0].tolist(), strict=True):
        crossings = linear_loop(servo, gain).gain_crossovers
        several += len(crossings) > 1
        off.append(abs(math.radians(30) - min(math.radians(c.margin) - c.frequency * lag for c in crossings) - missed))
    assert several > 5
    # Next to where a pair of crossovers appears phi jumps: there the table may be off by a step of its gains.
    assert np.sort(off)[-3] < 1e-2
