"""Switch friction whose drop has an exponent of its own: g(v) = Fc + (Fs - Fc) exp(-|v/vs|^n); the servo's is n = 2.

Published fits have n from 1/2 to 2 (Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994, section 2.1).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from .switch import TABLE_1, switch_friction

ROUNDED_OFF = 1e-24
"""Square of |v|/vs below which the power counts for nothing: at v = 0 it has a slope by v, and by n, of its own."""


def _torque(v: Any, p: Any) -> Any:
    power = ((v / p.stribeck_velocity) ** 2 + ROUNDED_OFF) ** (p.stribeck_exponent / 2)
    drop = (p.static - p.coulomb) * ca.exp(-power)
    return p.sign * (p.coulomb + drop) + p.viscous * v


WITH_EXPONENT = switch_friction(
    "Switch friction with exponent", {**TABLE_1, "stribeck_exponent": 2.0}, _torque,
    ranges={"stribeck_exponent": (0.1, 10.0)},
)  # fmt: skip
