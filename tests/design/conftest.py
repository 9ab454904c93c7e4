"""Table 1 and its tuning: computed once for all tests that only read them."""

from __future__ import annotations

import pytest

from casahunt import Options, Servo
from casahunt.design.tune.check import SAMPLES
from casahunt.design.tune.demands import Demands
from casahunt.design.tune.tuning import Tuning, tune

TIGHT = Options(tol=1e-9)


@pytest.fixture(scope="session")
def servo() -> Servo:
    return Servo()


@pytest.fixture(scope="session")
def plain(servo) -> Tuning:
    """Table 1, gain only, at a tight tolerance."""
    return tune(servo, "switch", demands=Demands(margin=0.1), options=TIGHT)


@pytest.fixture
def unscanned(monkeypatch):
    """Leave out the scan of the event map, which `plain` has shown, and most samples of sets: both take seconds."""
    monkeypatch.setattr("casahunt.design.tune.check.scanned", lambda *_: ("not scanned", "clear"))
    monkeypatch.setitem(SAMPLES, "switch", 2)
