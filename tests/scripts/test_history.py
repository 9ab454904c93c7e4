"""No history: answers are the same bits, by the same work, in any order and whatever is kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casahunt import Options
from casahunt.servo import find_fold
from scripts import history

NUMBERS = (48, 3, 20, 35)
"""Servos of the script that are quickly solved."""


@pytest.fixture
def large_caches():
    """What a test has shrunk is given back."""
    yield
    history.restored()


@pytest.mark.slow
def test_four_servos_in_two_orders(large_caches):
    """Each with empty caches, then together, in another order, with caches of one entry."""
    alone: dict[history.Question, history.Answer] = {}
    for number in NUMBERS:
        history.emptied()
        fold = history.Question(number, "switch", "fold", 0.0)
        alone |= dict(history.answers(1, [fold], "kept", Options(), history.WORK))
        gain = 0.7 * float.fromhex(alone[fold][0])
        for what in ("stable", "unstable"):
            question = history.Question(number, "switch", what, gain)
            alone |= dict(history.answers(1, [question], "kept", Options(), history.WORK))
    assert all(len(said) > 2 for said in alone.values())
    order = [list(alone)[i] for i in np.random.default_rng(0).permutation(len(alone))]
    together = dict(history.answers(1, order, "one entry", Options(), history.WORK))
    assert history.differences({"alone": alone, "together": together}) == {}


def test_a_history_is_seen(monkeypatch):
    """A last bit that depends on how many folds were located before, and the run that differs is named."""
    honest, before = find_fold.largest, []

    def with_memory(special, vary, *, options):
        before.append(special)
        found = honest(special, vary, options=options)
        return replace(found, value=np.nextafter(found.value, 1)) if len(before) > 1 else found

    monkeypatch.setattr(find_fold, "largest", with_memory)
    question = history.Question(48, "switch", "fold", 0.0)
    runs = {name: dict(history.answers(1, [question], "kept", Options(), history.WORK)) for name in ("alone", "again")}
    assert history.differences(runs) == {question: ["again"]}
    assert "differ" in history.table(runs) and "again: 0x" in history.table(runs)


@pytest.mark.slow
def test_the_script(capsys):
    assert history.main(["--servos", "2", "--lugre", "1", "--seed", "3"]) == 0
    assert " 0 differ from alone" in capsys.readouterr().out
