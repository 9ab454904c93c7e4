"""What tests of cycles of users' systems share: van der Pol's oscillator and its truth."""

from __future__ import annotations

from casahunt.hybrid import Mode, System
from casahunt.orbits.orbit import Orbit

START = {"x": 2.0, "v": 0.0}
VAN_DER_POL = {
    0.0: (6.6632868593231301897, 2.00861986087484313651),
    1e-3: (6.663288410191840899744, 2.009205683333108884127),
}
"""Constant force: period and x where v = 0, mu = 1; Taylor series of order 30 in 30 digits."""


def van_der_pol(**changed: float) -> System:
    smooth = Mode("smooth", lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x + p.force})
    return System("van der Pol", ("x", "v"), {"mu": 1.0, "force": 0.0} | changed, (smooth,))


def assert_period(orbit: Orbit, truth: float) -> None:
    """The error estimate holds, and is what was asked for."""
    assert abs(orbit.period / truth - 1) <= 3 * orbit.period_error + 1e-14
    assert orbit.status.ok
