"""Remedies for loops of parts: the plain servo in any form has the servo's sizes, and what does not fit says why."""

import math

import pytest

from casahunt import InputError, Servo, Uncertainty, remedies
from casahunt.design.remedies import remedies as module
from casahunt.design.remedies.cures import Cure
from casahunt.servo.parts import (
    BY_DIRECTION,
    DEAD_BAND,
    INERTIA,
    INTEGRATOR,
    LEAK,
    P_PI,
    PID_BY_GAINS,
    PID_BY_TIMES,
    SWITCH,
    Loop,
    transfer_function,
)
from casahunt.servo.parts.table import REMEDY_NAMES

BAND, LEAKS, LEAST_KI = 0.0433457242337, 0.246844841, 0.026744044
"""Of Table 1 at K = 0.04, by independent event maps [rad], [1/s]; the last is where a symmetric cycle of the map loses
its stability; motions of another integrator come to rest beyond.  It goes on, unstable, to a fold at 0.02507950354."""


OTHER_FORMS = (pytest.param(part, marks=pytest.mark.slow) for part in (PID_BY_TIMES, P_PI))


@pytest.mark.parametrize("pid", [PID_BY_GAINS, *OTHER_FORMS], ids=lambda part: part.name)
def test_the_plain_servo_in_each_form(pid):
    loop = Loop((INERTIA, SWITCH, pid, INTEGRATOR), {"gain": 0.04})
    found = remedies(loop, only=["dead band", "leak"])
    assert (found.model, found.gain) == ("switch", 0.04) and found.best in ("dead band", "leak")
    sizes = {row.name: row.size for row in found.remedies}
    assert sizes["dead band"] == pytest.approx(BAND, rel=1e-9) and sizes["leak"] == pytest.approx(LEAKS, rel=2e-9)
    band = next(row for row in found.remedies if row.name == "dead band")
    assert band.rest_error == band.size and band.keeps_it_ended


@pytest.mark.slow
def test_times_are_gains():
    """Less integral action is a size where the controller is given by times, too."""
    loop = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.04})
    assert remedies(loop, only=["integral"]).remedies[0].size == pytest.approx(LEAST_KI, rel=2e-8)


@pytest.mark.slow
def test_a_friction_of_its_own_in_each_direction():
    """Equal ones have the servo's size; with others the set of rest positions is not known, and no price of it."""
    loop = Loop((INERTIA, BY_DIRECTION, P_PI, INTEGRATOR), {"gain": 0.04})
    (row,) = remedies(loop, only=["dead band"]).remedies
    assert row.size == pytest.approx(BAND, rel=1e-9) and row.ends_hunting and 0.1 < row.settling < 100
    assert row.rests == () and math.isnan(row.recommended_rest_error)
    assert remedies(loop, only=["dead band"], max_error=0.1).best == ""
    assert remedies(loop, only=["dead band"]).best == "dead band"


def test_what_does_not_fit_says_why(monkeypatch):
    """In a row beside others; alone it is refused: "none of these remedies ends it" was said of what nobody tried."""
    monkeypatch.setattr(module, "_row", lambda asked, remedy: Cure(remedy.name, remedy.unit, "none"))
    loop = Loop((INERTIA, BY_DIRECTION, P_PI, INTEGRATOR, DEAD_BAND), {"gain": 0.04, "dead_band": 0.01})
    names = ["dither", "integral", "hysteresis"]
    rows = remedies(loop, only=[*names, "leak"]).remedies
    said = {row.name: row.why for row in rows if row.kind == "does not fit"}
    assert len(rows) == 4 and said == {
        "dither": "it takes the place of Switch friction, which this loop does not have",
        "integral": "its size is ki, which no part of this loop has",
        "hysteresis": "dead band and hysteresis do not go together: both give the integrand",
    }
    with pytest.raises(InputError, match="^none of these remedies goes with this loop: hysteresis: dead") as refused:
        remedies(loop, only=names)
    assert all(f"{name}: {why}" in str(refused.value) for name, why in said.items())


def test_what_does_not_go_with_a_bristle_says_so(monkeypatch):
    monkeypatch.setattr(module, "_row", lambda asked, remedy: Cure(remedy.name, remedy.unit, "none"))
    rows = remedies(Servo(), "lugre", 0.04).remedies
    assert sorted(row.name for row in rows) == sorted(REMEDY_NAMES)
    said = {row.name: row.why for row in rows if row.kind == "does not fit"}
    assert said == dict.fromkeys(("freeze", "reset at a stop", "dither"), "it goes with Switch friction alone")
    with pytest.raises(InputError, match="goes with this loop: freeze: it goes with Switch friction alone$"):
        remedies(Servo(), "lugre", 0.04, only=["freeze"])


def test_a_part_that_nobody_reads_is_refused():
    """A leak of an integrator that is not there, and a torque on a load that is not there, would do nothing."""
    controller = transfer_function([0.16, 2.0, 6.28], [1e-3, 1.0, 0.0])
    with pytest.raises(InputError, match=r"^leak does nothing with these parts: .* it gives \(leak_rate\)$"):
        _ = Loop((INERTIA, SWITCH, controller, LEAK), {"leak": 0.1}).system


def test_an_uncertain_loop_is_refused():
    loop = Loop((INERTIA, SWITCH, P_PI, INTEGRATOR), {"gain": 0.04})
    with pytest.raises(InputError, match="uncertainty: is one of a servo's parameters"):
        remedies(loop, uncertainty=Uncertainty({"friction.static": (0.5, 0.55)}))


@pytest.mark.parametrize("given", [("lugre",), ("switch", 0.1)])
def test_a_loop_says_its_friction_and_gain_itself(given):
    """Others beside it would be left unseen."""
    with pytest.raises(InputError, match="model, gain: must be left out"):
        remedies(Loop((INERTIA, SWITCH, P_PI, INTEGRATOR), {"gain": 0.04}), *given)
