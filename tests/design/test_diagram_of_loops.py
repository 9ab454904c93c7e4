"""The diagrams of both models, and what a diagram of a servo does not take."""

from __future__ import annotations

import pytest

from casahunt import InputError, Servo, diagram
from casahunt.servo.parts import INERTIA, INTEGRATOR, PID_BY_TIMES, SWITCH, Loop

START = 0.2


@pytest.mark.slow
def test_a_diagram_of_both_models_is_that_of_each():
    both = diagram(Servo(), start=START)
    assert [branch.model for branch in both] == ["switch", "lugre"]
    for branch in both:
        alone = diagram(Servo(), branch.model, start=START)
        assert branch.gains.tolist() == alone.values.tolist()
        assert branch.ended == alone.ended and branch.servo == Servo()
    with pytest.raises(InputError, match="model"):
        diagram(Servo(), "dahl", start=START)


def test_the_diagram_of_a_loop_is_that_of_the_servo_that_it_is():
    """Of the same parts, by other steps and from another event on: the fold, and the unstable cycle at the start."""
    loop = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.5})
    found, servo = diagram(loop, report=(seen := []).append), diagram(Servo(), "switch", start=0.5)
    folds = [[special.value for special in branch.special if special.kind == "fold"] for branch in (found, servo)]
    assert folds[0] == pytest.approx(folds[1], rel=2e-6) and len(folds[0]) == 1
    assert found.values[[0, -1]].tolist() == [0.5, 0.5] and not hasattr(found, "model")
    assert found.amplitudes[-1] == pytest.approx(servo.amplitudes[-1], rel=2e-6)
    assert [len(branch.orbits) for branch in seen] == sorted({len(branch.orbits) for branch in seen})
    assert len(seen) > 1 and seen[-1].orbits == found.orbits[: len(seen[-1].orbits)]


def test_what_leads_nowhere():
    loop = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.5})
    for asked, how, said in (
        ((Servo(), "switch"), {"vary": "static"}, "must be gain of a servo"),
        ((loop, "switch"), {}, "a loop has its friction as a part"),
        ((loop,), {"to": 0.5}, "it cannot go to 0.5"),
        ((loop,), {"vary": "dead_band"}, "dead_band"),
    ):
        with pytest.raises(InputError, match=said):
            diagram(*asked, **how)
