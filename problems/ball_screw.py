"""A ball screw axis in mm, ball_screw.toml: a carriage of 30 kg under a cascade, written as a PID.

It hunts with 57.2 um: by this project alone.  The same axis written by hand in SI is `BY_HAND`.
"""

from __future__ import annotations

from pathlib import Path

from casahunt import Friction, Pid, Servo

TOML = Path(__file__).with_name("ball_screw.toml")
BY_HAND = Servo(
    inertia=30.0,
    motor_gain=1.0,
    controller=Pid(kp=240e3, ki=4500e3, kd=3e3),
    friction=Friction(static=90.0, coulomb=65.0, stribeck_velocity=2e-3, viscous=800.0, stiffness=30e6, damping=30e3),
)
"""In kg, N, m and s."""
