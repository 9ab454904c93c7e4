"""Public names of a room that are looked up when they are first read: who uses a room loads no more of it than that.

    __getattr__ = lazily(__name__, {"language": ("Event", "Mode", "System")})
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazily(module: str, homes: Mapping[str, tuple[str, ...]]) -> Callable[[str], Any]:
    """The `__getattr__` of a module whose public names are those of other modules of its package.

    module: its `__name__`. Returns function from a name to its value, which is then kept in the module. Raises
    AttributeError: from that function, for any other name.
    """
    own, home_of = sys.modules[module], {name: home for home, names in homes.items() for name in names}

    def __getattr__(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home = import_module(f".{home_of[name]}", own.__package__)
        for each in homes[home_of[name]]:  # all of them: one may be named as the module is, which stands there now
            setattr(own, each, getattr(home, each))
        return getattr(own, name)

    return __getattr__
