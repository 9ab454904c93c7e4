"""The servo's race: heyoka's user gets the cycles and folds of table 1; a missing heyoka is a row with the reason."""

from __future__ import annotations

import sys

import pytest
from peer_support import needs

from problems import table1
from scripts.race import scaling, taylor
from scripts.race.rows import Row, reference

RIGHT = 1e-9
"""Error that the tightest settings are far below; loose ones need not be."""


@pytest.mark.parametrize("gain", taylor.ALONG)
@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_stable_cycles_from_nothing(model, gain):
    needs("scripts.peers.servo_heyoka")
    error = taylor._asked("orbit-stable", model, gain)
    from scripts.peers import servo_heyoka as peer

    engine = (peer.SwitchTaylor if model == "switch" else peer.LugreTaylor)(1e-12)
    assert error(engine) < RIGHT
    assert engine.compiling > 0


@pytest.mark.slow
def test_the_unstable_cycle_and_the_fold():
    needs("scripts.peers.servo_heyoka")
    for scene in ("orbit-unstable", "fold"):
        rows = taylor.taylor_rows(scene, "switch", 1)
        timed = {r.setting: r for r in rows if r.method == taylor.METHOD}
        first = {r.setting: r for r in rows if r.method.endswith("first time")}
        assert timed["tol 2e-16"].error < RIGHT and timed["tol 1e-12"].error < RIGHT
        assert first["tol 2e-16"].seconds > timed["tol 2e-16"].seconds


def test_the_guess_is_not_the_answer():
    row = reference("switch", "orbit-unstable")
    from casahunt import find_orbit

    near = find_orbit(table1.servo(), "switch", taylor.NEIGHBOUR * row["K"], branch="unstable")
    assert abs(near.amplitude / row["amplitude"] - 1) > 1e-3


def test_a_missing_heyoka_is_a_row_with_the_reason(monkeypatch):
    monkeypatch.setitem(sys.modules, "heyoka", None)
    rows = taylor.taylor_rows("fold", "switch", 1)
    assert all(r.seconds is None and "left out" in r.note and "heyoka" in r.note for r in rows) and rows


@pytest.mark.slow
def test_slopes_of_known_lines(tmp_path):
    """Seconds that go like the square of the servos, and a picture of them."""
    rows = [Row(scaling.SCENE, "switch", "folds together", "servos", 1e-3 * n**2, 1e-9, n) for n in (1, 4, 16, 64)]
    rows.append(Row(scaling.SCENE, "switch", "heyoka", "servos", None, None, None, "no module named heyoka"))
    assert scaling.slopes(rows) == {("switch", "folds together", "servos"): pytest.approx(2, rel=1e-12)}
    scaling.drawn(rows, tmp_path / "lines.png")
    assert (tmp_path / "lines.png").stat().st_size > 10_000
    scaling.drawn(rows[-1:], tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()
