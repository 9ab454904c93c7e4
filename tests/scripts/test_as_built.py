"""How far the continuous loop is from the one as built: measured by the script, and of first order."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from scripts import as_built


@pytest.mark.slow
def test_amplitude_and_period_are_of_first_order():
    """The fold gain as built comes to the continuous one, too; behind that of servo 1 a lopsided cycle goes on."""
    for _, rows in as_built.order(1, first=2):
        for row in rows[:2]:
            assert as_built.fitted(row) == pytest.approx(1.0, abs=0.15)
        assert abs(rows[2, -1]) < 3e-3 and abs(rows[2, -1]) <= abs(rows[2, 0]) + 1e-3


@pytest.mark.slow
def test_many_counts_leave_stiction_the_cause():
    rows = list(as_built.encoder(3, 3))
    fine = [row for row in rows if row[0] >= 2 * 20]
    assert {row[1] for row in fine} == {"stiction"} and np.median([row[2] for row in fine]) < 0.02
    coarse = [row[1] for row in rows if row[0] <= 2]
    assert coarse.count("quantisation") > 0.7 * len(coarse)


@pytest.mark.slow
def test_what_lets_it_rest_in_a_band_holds_as_built_and_what_does_not_needs_one(monkeypatch):
    """Between two counts no reading is zero, so that a servo that may rest with none but a zero error never rests."""
    band, no_band = ("dead band", "shifted dead band", "hysteresis", "leak", "freeze"), ("gain", "reset", "derivative")
    monkeypatch.setattr(as_built, "ENCODERS", (0, 2000))
    monkeypatch.setattr(as_built, "remedies", partial(as_built.remedies, only=[*band, *no_band]))
    kinds = {row[1:4]: row[4] for row in as_built.cured(0, 0)}
    for name in band:
        assert {kinds[name, encoder, False] for encoder in as_built.ENCODERS} == {"at rest"}
    for name in no_band:
        assert kinds[name, 2000, False] == "hunting"
    assert kinds["gain", 2000, True] == kinds["derivative", 2000, True] == "at rest"
