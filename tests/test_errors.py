"""Refusals on their way to another process: what a worker raises, its caller gets whole."""

from __future__ import annotations

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import pytest

from casahunt.errors import ComesToRest, HuntsIrregularly, InputError, NoOrbit, NotFollowed, Status
from casahunt.motion.segment import NoEnd
from casahunt.servo.parts import INERTIA, INTEGRATOR, PID_BY_TIMES, SWITCH, Loop
from casahunt.servo.parts.exponent import largest_exponent
from casahunt.servo.parts.fate import Swing
from casahunt.servo.parts.verbs import loop_cycle

LOOP = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 1.0})
SWING = Swing({"x1": 0.1}, 0.1, 2.0, {}, True)
REFUSALS = [
    InputError("gain: must be above 0"),
    NoOrbit("there is none", Status.NOT_FOUND, evidence="a fold"),
    ComesToRest("it rests", Status.NOT_FOUND, evidence="followed for 3 s"),
    NotFollowed("the motion", Status.NOT_FOUND, evidence="a mode does not hold", time=1.5),
    HuntsIrregularly("it hunts", Status.NOT_FOUND, amplitude=(0.1, 0.2), between=(1.0, 3.0),
                     swing=SWING, measure=partial(largest_exponent, LOOP, SWING)),
    NoEnd("no end after 3 s", 3.0),
]  # fmt: skip


@pytest.mark.parametrize("refusal", REFUSALS, ids=lambda each: type(each).__name__)
def test_a_refusal_arrives_as_it_was_raised(refusal):
    again = pickle.loads(pickle.dumps(refusal))
    assert type(again) is type(refusal) and str(again) == str(refusal)
    for name in vars(refusal):
        assert getattr(again, name) == getattr(refusal, name) or name in ("swing", "_measure")
    if isinstance(refusal, HuntsIrregularly):
        assert vars(again.swing) == vars(SWING) and again._measure.func is largest_exponent
        assert again._measure.args[0].parameters == LOOP.parameters


def test_a_refusal_of_a_worker_leaves_the_others_their_work():
    """One that cannot be made again in the caller's process breaks the pool, and every task in it."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        refused, found = pool.submit(_refused), pool.submit(loop_cycle, LOOP.replace(gain=0.1))
        with pytest.raises(NotFollowed) as caught:
            refused.result()
        assert caught.value.time == 1.5
        assert found.result().amplitude > 0


def _refused():
    raise NotFollowed("the motion", Status.NOT_FOUND, evidence="a mode does not hold", time=1.5)
