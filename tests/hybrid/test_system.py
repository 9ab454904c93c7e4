"""Cycles as data: which of their boundaries are kinks of the field and no more."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from casahunt.hybrid.system import Cycle, Phase, VectorEvent, VectorMode

LAWS = {
    "right": VectorMode("right", abs, unsplit="both"), "left": VectorMode("left", abs, unsplit="both"),
    "both": VectorMode("both", abs),
    "rest": VectorMode("rest", abs),
}  # fmt: skip


def cycle(*phases: str, jumps: bool = False) -> Cycle:
    """A cycle of these modes; with a jump at the end of the first phase."""
    made = tuple(
        Phase(LAWS[mode], VectorEvent(f"from {mode}", abs), abs if jumps and k == 0 else None)
        for k, mode in enumerate(phases)
    )
    return Cycle("here and there", ("x",), (), made, np.eye(1), 1)


@pytest.mark.parametrize(("phases", "kinks"), [
    (("right", "left"), [True, True]), (("right", "both"), [True, True]), (("right", "rest"), [False, False]),
    (("right", "left", "rest"), [True, False, False]), (("rest", "rest"), [False, False]), (("both",), [False]),
])  # fmt: skip
def test_between_parts_of_one_mode_there_are_kinks(phases, kinks):
    made = cycle(*phases)
    assert [made.at_a_kink(k) for k in range(len(phases))] == kinks
    assert len(made.without_kinks) == kinks.count(False)


def test_a_jump_is_more_than_a_kink():
    made = cycle("right", "left", jumps=True)
    assert [made.at_a_kink(k) for k in range(2)] == [False, True] and made.without_kinks == (("both", "from right"),)


def test_a_hash_that_is_known_does_not_travel():
    """Functions and strings have other hashes in another process: a record that came from there would never be met."""
    phase = cycle("right", "left").phases[0]
    assert hash(phase) == hash(Phase(phase.mode, VectorEvent("from right", abs)))
    assert "_hash" in vars(phase)
    assert "_hash" in vars(phase.mode)
    arrived = pickle.loads(pickle.dumps(phase))
    assert arrived == phase
    assert not {"_hash"} & {*vars(arrived), *vars(arrived.mode), *vars(arrived.end)}
    assert hash(arrived) == hash(phase)
