"""The PID servo with LuGre friction of the paper that introduced it, and its hunting cycle, computed independently.

Source of the servo: Canudas de Wit, Olsson, Astrom and Lischinsky, "A new model for control of systems with friction",
IEEE Transactions on Automatic Control 40 (1995) 419-425; canudas.toml.  Its controller has complex zeros.

Source of the reference values: the Taylor engine of taylor.py (LuGre: ten half cycles from one next to the cycle, after
which nothing moves; mu is the ratio of the steps by which they settle.  Switch: the fixed point of the event map).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from casahunt import Servo, load

TOML = Path(__file__).with_name("canudas.toml")
"""The servo as a file."""


def servo() -> Servo:
    """The servo of the paper.

    Returns servo, read from its file.
    """
    return cast(Servo, load(TOML))


GAIN = 1.0
"""K: the controller as in the paper."""
REFERENCE: dict[str, dict[str, Any]] = {
    "switch": {"amplitude": 0.06692297315, "period": 23.72560778},
    "lugre": {"amplitude": 0.063902510333, "period": 24.436786456, "mu": 0.0784},
}
"""At `GAIN`: amplitude [m], period [s] and half multiplier, correct as printed."""
