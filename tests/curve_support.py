"""Curves known in closed form, for those who follow them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from casahunt.continuation.plane_curve import Evaluation


@dataclass(frozen=True)
class Known:
    """phi of lambda = -(c - cusp) s - s^3 (cusp normal form; fold curve c = cusp - 3 s^2), or of another phi."""

    s: float
    position: float
    phi: object
    reach = (0.3, 0.1)

    def value(self, s: float, m: float) -> Evaluation | str:
        return Evaluation(float(self.phi(self.s + s, self.position + m)))  # type: ignore[operator]

    @property
    def gradient(self) -> tuple[float, float]:
        h = 1e-5
        by_s = (self.value(h, 0).value - self.value(-h, 0).value) / (2 * h)  # type: ignore[union-attr]
        by_c = (self.value(0, h).value - self.value(0, -h).value) / (2 * h)  # type: ignore[union-attr]
        return by_s, by_c

    def moved(self, s: float, m: float, reading: Evaluation) -> Known | str:
        return replace(self, s=self.s + s, position=self.position + m)
