"""A test that a missing package skips says which one, and how to have it."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pytest
from peer_support import PEERS, needs

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("name", PEERS)
def test_a_missing_peer_is_named_with_its_extra(monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(pytest.skip.Exception, match=rf"^{name} is not installed: pip install '\.\[bench\]'$"):
        needs(name)
    bench = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["bench"]
    assert name in bench and ".[bench]" in (ROOT / ".ci" / "run").read_text()


def test_what_is_no_peer_is_no_reason_to_skip(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ModuleNotFoundError):
        needs("casadi")


def test_no_test_is_skipped_for_want_of_a_peer_without_a_word():
    """`importorskip` would name a module, not what to install."""
    for path in (ROOT / "tests").rglob("test_*.py"):
        for name in (*PEERS, "scripts.peers.servo_heyoka"):
            assert f'importorskip("{name}' not in path.read_text(), path
