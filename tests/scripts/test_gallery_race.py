"""The gallery's race: every peer that is installed gets the right cycle; a missing one is a row with the reason."""

from __future__ import annotations

import sys

import pytest
from peer_support import needs

from scripts.race import gallery, precision
from scripts.race.entries import entries
from scripts.race.rows import Row

QUICK = ("van der Pol, mu = 10", "belt", "relay", "dry friction")
"""Smooth and symmetric; stick and slip; three states; forced and mirrored."""
SLOWER = tuple(name for name in entries() if name not in QUICK)
BESIDE = gallery.NEIGHBOUR
STARTS = [
    *((name, factor) for name in QUICK for factor in (None, BESIDE)),
    *(pytest.param(name, (None, BESIDE)[k % 2], marks=pytest.mark.slow) for k, name in enumerate(SLOWER)),
]
"""Of an entry off its own cycle or beside a neighbour's, in turn; of the quick ones both."""
RIGHT = 1e-6
"""Error that the settings here are far below."""


def errors(tasks, entry):
    return [entry.error(*task.action()) for task in tasks]


@pytest.mark.parametrize(("name", "factor"), STARTS)
def test_solve_ivp(name, factor):
    pytest.importorskip("scipy")
    entry = entries()[name]()
    assert max(errors(gallery.shooting_tasks(entry, factor, (1e-10,))[:1], entry)) < RIGHT


@pytest.mark.parametrize(("name", "factor"), STARTS)
def test_solve_bvp(name, factor):
    pytest.importorskip("scipy")
    entry = entries()[name]()
    tasks = gallery.bvp_tasks(entry, factor, (1e-6,))
    assert max(errors(tasks, entry)) < RIGHT


@pytest.mark.parametrize(("name", "factor"), STARTS)
def test_heyoka(name, factor):
    needs("heyoka")
    entry = entries()[name]()
    first, again = errors(gallery.taylor_tasks(entry, factor, (2.2e-16,)), entry)
    assert first < 1e-11 and again < 1e-11  # what double precision leaves of twenty digits


@pytest.mark.parametrize("name", ["van der Pol, mu = 10", "Rossler"])
def test_auto(name):
    auto = pytest.importorskip("scripts.peers.gallery_auto")  # scipy
    entry = entries()[name]()
    rows = list(gallery.auto_rows("scene", "model", entry, gallery.NEIGHBOUR, 1))
    if len(rows) == 1 and "not installed" in rows[0].note:
        pytest.skip(rows[0].note)
    assert min(row.error for row in rows if row.error is not None) < 1e-8, auto.__name__


def test_of_a_pair_the_neighbour_is_another_cycle():
    """What a peer is given is not the answer."""
    pytest.importorskip("scipy")
    from scripts.peers import gallery_shooting as shooting

    entry = entries()["relay"]()
    near = shooting.solve(entry.known.beside(gallery.NEIGHBOUR), 1e-8, "DOP853")
    assert entry.error(near.period, near.largest) > 1e-3


def test_casahunt_from_a_neighbour():
    entry = entries()["belt"]()
    (task,) = gallery.ours(entry, gallery.NEIGHBOUR, (1e-8,))
    (row,) = gallery.measured("belt", "m", [task], entry, 1)
    assert row.method == "casahunt" and row.error < 1e-8 and row.seconds > 0


def test_a_missing_peer_is_a_row_with_the_reason(monkeypatch):
    monkeypatch.setitem(sys.modules, "heyoka", None)
    entry = entries()["belt"]()
    (row,) = gallery.measured("belt", "m", gallery.taylor_tasks(entry, None, (1e-9,)), entry, 1)
    assert row.seconds is None and "left out" in row.note and "heyoka" in row.note


def row(method, seconds, error, note=""):
    return Row("gallery", "p", method, "", seconds, error, None, note)


def test_the_table_takes_the_fastest_that_is_exact():
    rows = [
        row("casahunt", 0.1, 1e-12), row("solve_bvp", 0.001, 1e-6), row("solve_bvp", 0.03, 1e-10),
        row("solve_bvp", 0.5, 1e-13), row("solve_ivp shooting", 0.002, 3e-7), row("heyoka shooting", None, None, "no"),
        row("heyoka shooting, first time", None, None, "left out: no module"),
    ]  # fmt: skip
    (line,) = precision.in_table(rows)
    assert line == {
        "problem": "p", "casahunt": "100", "its error": "1e-12", "first time": "fails", "solve_bvp": "30",
        "shooting": "2.0 (3e-07)", "heyoka": "fails", "heyoka, first time": "left out",
    }  # fmt: skip
    assert "| p | 100 | 1e-12 |" in precision.as_markdown([line])


def test_a_curve_leaves_out_what_is_beaten():
    rows = [row("m", 1.0, 1e-3), row("m", 2.0, 1e-2), row("m", 3.0, 1e-9), row("m", 2.5, 0.0), row("m", None, None)]
    assert precision.front(rows) == [(1.0, 1e-3), (2.5, precision.FLOOR)]


def test_the_picture(tmp_path):
    rows = [
        Row("belt", f"belt at 0.2, {start}", method, "", 0.1, 1e-6, None)
        for start in (gallery.OFF, gallery.BESIDE)
        for method in precision.STYLES
    ]
    precision.panels(rows, tmp_path / "gallery.png")
    assert (tmp_path / "gallery.png").stat().st_size > 10_000
    precision.panels([], tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()


def test_what_fails_slowly_is_not_asked_for_more(monkeypatch):
    def fails():
        raise gallery.Gave("no")

    entry = entries()["belt"]()
    tasks = [gallery.Task("m", setting, fails) for setting in ("loose", "tight")]
    assert [r.setting for r in gallery.measured("s", "m", tasks, entry, 1)] == ["loose", "tight"]
    monkeypatch.setattr(gallery, "SLOW", -1.0)
    (only,) = gallery.measured("s", "m", tasks, entry, 1)
    assert only.setting == "loose" and "fails after" in only.note
