"""What the tests of files share: a command line, the contents of a folder, a disk that is full."""

from __future__ import annotations

import errno
import itertools
import os
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest

from casahunt.views.commands import diagram as command_diagram
from casahunt.views.commands import tune as command_tune
from casahunt.views.evidence.page import TITLE
from casahunt.views.pictures import tune as pictures_tune

ROOT = Path(__file__).resolve().parent.parent
posix = pytest.mark.skipif(os.name != "posix", reason="signals, links, devices")


def results(*models: str) -> dict[str, bytes]:
    """What an earlier run may have left in a folder, by name: little more of each file than casahunt knows it by."""
    signs = command_tune.FILES | dict.fromkeys(command_diagram.PICTURES, command_diagram.PICTURE_SIGN)
    signs |= {f"{model}{end}": sign for model in models for end, sign in command_diagram.SIGNS.items()}
    return {name: sign + b"\nold\n" for name, sign in signs.items()}


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
    found = SimpleNamespace(servo=None, gain=1.0, verification=SimpleNamespace(unverified=(), against=()))
    for name, value in (
        ("tune", found),
        ("evidence_record", {"gain": 1.0}),
        ("evidence_page", TITLE),
    ):
        monkeypatch.setattr(command_tune, name, lambda *a, value=value, **k: value)
    monkeypatch.setattr(pictures_tune, "evidence_images", lambda *a, **k: {})
