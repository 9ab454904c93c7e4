"""A slip that a plane cuts: the motion comes to reach that no more, and the branch goes on past its fold all the same.

The truths are the unstable cycles of the servo of Table 1, by its event map.
"""

import numpy as np
import pytest

from casahunt.collocation.mesh import evaluate_phase
from casahunt.continuation import follow, poincare_section
from casahunt.orbits import Options
from casahunt.servo.parts import INERTIA, INTEGRATOR, PID_BY_TIMES, SWITCH, Loop
from casahunt.servo.parts.verbs import loop_cycle
from problems import table1

SWITCH_TRUTH = table1.REFERENCE["switch"]
SPEED = 1


def speed_at(part):
    """The plane of the speed that the slip has at this part of it, for the one that is crossed most steeply."""

    def plane(family, orbit, start):
        t, u, setting = start
        before, after = evaluate_phase(t, u, setting.fractions, 0, np.array([part, part + 1e-4]))
        return SPEED, part, bool((np.linalg.inv(family.closure.matrix) @ (after - before))[SPEED] > 0)

    return plane


@pytest.mark.parametrize(("row", "part"), [(0, None), (1, None), (1, 0.8), (2, 0.8)])
def test_the_branch_of_a_cut_slip_does_not_come_back_along_itself(monkeypatch, row, part):
    truth = SWITCH_TRUTH["unstable"][row]
    cycle = loop_cycle(Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": truth["K"]}))
    assert not poincare_section.badly_cut(cycle)  # nothing of it vanishes that leaves a cycle
    with monkeypatch.context() as patch:
        if part is not None:
            patch.setattr(poincare_section, "_steepest", speed_at(part))
        cut = poincare_section.cut_elsewhere(cycle, Options(tol=1e-8))
    assert len(cut.arcs) == 3
    branch = follow(cut, "gain", to=3.0, back=truth["K"])
    (fold,) = branch.special
    assert (fold.kind, branch.missed, branch.end.kind) == ("fold", (), "range")
    assert fold.value == pytest.approx(SWITCH_TRUTH["fold"]["K"], rel=1e-7)
    assert branch.orbits[-1].amplitude == pytest.approx(truth["amplitude"], rel=1e-7)
    assert branch.orbits[-1].period == pytest.approx(truth["period"], rel=1e-7)
