"""What sampling and delay do to the linear loops of a search, in closed form.

At z = exp(i omega T), with s = i v and v = tan(omega h)/h, h = T/2, the parts of sampled/linear.py are

    difference quotient     s/(1 + s h)
    sum                     1/s + h by rectangles, 1/s by trapezoids
    plant behind its hold   (1 - s h) (1 + beta s)/(s (J' s + sigma2)),   J' = J x/tanh x, beta = (J' - J)/sigma2

with x = sigma2 h/J.  The lag 1 + s h goes into the gains as the filter of a derivative does, kp + ki/s + kd s/(1 + s h)
= (kp + ki h + ki/s + (kd + kp h) s)/(1 + s h), and what is left beside them has the size 1:

    L(i omega) = (kp' + ki/s + kd' s)/(s (J' s + sigma2)) (1 + beta s) (1 - s h)/(1 + s h) exp(-i omega D)

So loops of a drive are continuous ones with other gains at the frequency v, which lose more phase.  That is exact but
for |1 + beta s|, of the second order in x, a delay that is no whole number of samples, and what a drive may have
besides: a filter of the derivative or of the error, and a leak.  The checks have all of it.

h = 0 is the loop that is not sampled: v = omega.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Lag:
    """Sampling and delay.

    Attributes
    ----------
    delay : D [s].
    half : h [s], half a sample; 0: the loop is not sampled.
    rectangle : whether the sum is one of rectangles.
    """

    delay: float = 0.0
    half: float = 0.0
    rectangle: bool = True

    def seen(self, J: Any, sigma2: Any, kp: Any, ki: Any, kd: Any) -> tuple[Any, Any, Any, Any, Any]:
        """J', sigma2, kp', ki, kd' of numbers, arrays or expressions, to the second order in x."""
        p = kp + ki * self.half if self.rectangle else kp
        return J * (1 + (sigma2 * self.half / J) ** 2 / 3), sigma2, p + ki * self.half, ki, kd + p * self.half

    def lost(self, J: Any, sigma2: Any, v: Any) -> Any:
        """The phase [rad] that is lost at v [rad/s]; J: J'."""
        if not self.half:
            return v * self.delay
        atan = ca.atan if isinstance(v, ca.MX) else np.arctan
        return (2 + self.delay / self.half) * atan(v * self.half) - atan(v * sigma2 * self.half**2 / (3 * J))
