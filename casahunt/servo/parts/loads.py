"""Torques from outside: a constant one, such as gravity's, and a spring to the set point.

    external = -load - stiffness x1     [N m]

At a constant set point the integrator absorbs a constant torque: whatever the friction, the motion is that without it,
the integrator's content apart, also that from rest, where the integral carries the load (`Loop.at_rest`).  A limit of
the torque, and a leak, are met sooner on one side.
"""

from __future__ import annotations

import math

from .part import Part

LOADS = Part(
    "loads", (), {"load_torque": 0.0, "spring": 0.0},
    ranges={"load_torque": (-math.inf, math.inf), "spring": (-math.inf, math.inf)},
    gives={"external": lambda x, s, p: -p.load_torque - p.spring * s.motor_angle},
)  # fmt: skip
