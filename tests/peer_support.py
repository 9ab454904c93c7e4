"""The independent engines that some tests compare with, and what to install where one is missing."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

PEERS = ("heyoka", "control")
"""Of the extra `bench`; .ci/run installs it where there are wheels."""


def needs(module: str) -> Any:
    """One of `PEERS`, or a module that uses one; the test, or its whole module, is skipped where that is missing."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name not in PEERS:
            raise
        pytest.skip(f"{error.name} is not installed: pip install '.[bench]'", allow_module_level=True)
