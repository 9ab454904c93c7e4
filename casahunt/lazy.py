"""Public names of a room that are looked up when they are first read: who uses a room loads no more of it than that.

    if TYPE_CHECKING:
        from .language import Event, Mode, System

    __getattr__ = lazily(__name__)
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

_SHOWN = re.compile(r"^    from \.([\w.]+) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)
"""An import that only the type checker makes."""


def lazily(module: str) -> Callable[[str], Any]:
    """The `__getattr__` of a module whose public names are those that it imports for the type checker.

    module: its `__name__`. Returns function from a name to its value, which is then kept in the module. Raises
    AttributeError: from that function, for any other name.
    """
    own, homes = sys.modules[module], dict[str, dict[str, str]]()
    for home, several, one in _SHOWN.findall(own.__spec__.loader.get_source(module)):  # type: ignore[union-attr]
        names = (name.strip().split(" as ") for name in (several or one).split(",") if name.strip())
        homes.setdefault(home, {}).update((name[-1], name[0]) for name in names)
    home_of = {name: home for home, names in homes.items() for name in names}

    def __getattr__(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home = import_module(f".{home_of[name]}", own.__package__)
        for each, there in homes[home_of[name]].items():  # all: one may be named as the module is, which stands there
            setattr(own, each, getattr(home, there))
        return getattr(own, name)

    return __getattr__
