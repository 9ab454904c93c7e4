"""What the tests of files share: a command line, the contents of a folder, a disk that is full."""

from __future__ import annotations

import errno
import itertools
import os
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest

from casahunt import cli
from casahunt.views.commands import tune as command_tune
from casahunt.views.pictures import tune as pictures_tune

ROOT = Path(__file__).resolve().parent.parent
posix = pytest.mark.skipif(os.name != "posix", reason="signals, links, devices")


def contents(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir()}


def run(capsys, *words: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = cli.main([str(word) for word in words])
    return code, *capsys.readouterr()


def full_disk(monkeypatch, *, numbers: Sequence[int] = range(1000)) -> None:
    """What is written gets as far as the disk and no further; of the files those with these numbers."""
    count, fsync = itertools.count(), os.fsync

    def full(handle: int) -> None:
        if next(count) in numbers:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", full)


def cheap_tuning(monkeypatch) -> None:
    """A tuning that takes no time: only what is written matters here."""
    found = SimpleNamespace(verification=SimpleNamespace(unverified=(), against=()))
    for name, value in (("tune", found), ("before_tasks", None), ("record_of", {"gain": 1.0}), ("page", "<html>")):
        monkeypatch.setattr(command_tune, name, lambda *a, value=value, **k: value)
    monkeypatch.setattr(pictures_tune, "evidence_images", lambda *a, **k: {})
