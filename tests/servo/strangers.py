"""Parts that somebody else would write, one of each kind: a plant, a controller that a drive runs by a rule of its own,
and a remedy.  They know the names of signals, and nothing else of casahunt.
"""

from __future__ import annotations

from casahunt.servo.parts import Law, Part, PartMode, Remedy


def _front(x, s, p):
    return p.shaft_stiffness * (x.x1 - x.middle_angle) + p.shaft_damping * (x.x2 - x.middle_rate)


def _rear(x, s, p):
    return p.belt_stiffness * (x.middle_angle - x.load_angle) + p.belt_damping * (x.middle_rate - x.load_rate)


THREE_MASSES = Part(
    "three masses", ("x1", "x2", "middle_angle", "middle_rate", "load_angle", "load_rate"),
    {"inertia": 0.0012, "middle_inertia": 0.0004, "load_inertia": 0.004, "shaft_stiffness": 180.0,
     "shaft_damping": 0.5, "belt_stiffness": 400.0, "belt_damping": 0.5},
    angles=("x1", "middle_angle", "load_angle"),
    gives={
        "motor_angle": lambda x, s, p: x.x1,
        "motor_rate": lambda x, s, p: x.x2,
        "pull": lambda x, s, p: s.torque + s.compensation + s.external - _front(x, s, p),
        "load_angle": lambda x, s, p: x.load_angle,
        "load_rate": lambda x, s, p: x.load_rate,
        "load_pull": lambda x, s, p: _rear(x, s, p) + s.load_external,
    },
    modes=(PartMode("", Law({
        "x1": lambda x, s, p: s.moving * x.x2,
        "x2": lambda x, s, p: s.moving * (s.pull - s.friction) / p.inertia,
        "middle_angle": lambda x, s, p: x.middle_rate,
        "middle_rate": lambda x, s, p: (_front(x, s, p) - _rear(x, s, p)) / p.middle_inertia,
        "load_angle": lambda x, s, p: s.load_moving * x.load_rate,
        "load_rate": lambda x, s, p: s.load_moving * (s.load_pull - s.load_friction) / p.load_inertia,
    })),),
)  # fmt: skip
"""Motor, pulley and carriage, with two elastic shafts between them."""


def _forgets(x, s, p):
    return p.forgets ** (p.sample_time / p.forgetting_time) * x.rate_seen + (
        1 - p.forgets ** (p.sample_time / p.forgetting_time)
    ) * s.rate


OBSERVING_PI = Part(
    "PI with observed rate", ("x3", "rate_seen"),
    {"motor_gain": 1.0, "gain": 1.0, "kp": 4.0, "ki": 30.0, "kd": 0.12, "forgetting_time": 1e-3,
     "forgets": 0.36787944117144233},
    gives={
        "kp": lambda x, s, p: p.gain * p.motor_gain * p.kp,
        "ki": lambda x, s, p: p.gain * p.motor_gain * p.ki,
        "demand": lambda x, s, p: -p.gain * p.motor_gain * (p.kp * s.error + p.ki * x.x3 + p.kd * x.rate_seen),
        "integral": lambda x, s, p: x.x3,
    },
    modes=(PartMode("", Law({
        "x3": lambda x, s, p: s.integrand - s.leak_rate * x.x3,
        "rate_seen": lambda x, s, p: (s.rate - x.rate_seen) / p.forgetting_time,
    }, sampled={"rate_seen": _forgets})),),
)  # fmt: skip
"""A PI whose rate is the state of a filter, which a drive runs by the exact rule of a held input, not by ours."""

STANDING_LEAK = Part(
    "standing leak", (), {"standing_leak": 0.0}, size="standing_leak",
    gives={"leak_rate": lambda x, s, p: p.standing_leak * (1 - s.moving)},
)  # fmt: skip


def rests(size, p):
    """As with a leak: |kp x1 + ki x1/size| <= Fs."""
    largest = p["static"] / (p["kp"] + p["ki"] / size)
    return (-largest, p["static"]), (largest, -p["static"])


FORGETS_WHERE_IT_STANDS = Remedy("standing leak", "standing_leak", "1/s", rests, STANDING_LEAK, scale="rate", last=1e3)
"""An integrator that forgets while the servo stands still."""
