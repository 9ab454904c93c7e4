"""Where a part, a law or a function of one stands, so that a loop can be sent to another process.

    address    (module, name of the part there, way from it)     or     (maker, its arguments, way from it)

The way leads from attribute to attribute and from entry to entry: "modes", 1, "law".  Functions of parts may then be
lambdas, which cannot be sent; a part must be a global of a module, or say how it is made.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any

from .part import Edge, Law, Part, PartMode

Way = tuple[Any, ...]


@dataclass(frozen=True)
class Address:
    """Where something of a part stands: `root` is (module, name) or (maker, arguments)."""

    root: tuple[Any, Any]
    way: Way

    def found(self) -> Any:
        """What stands there."""
        first, second = self.root
        place: Any = getattr(import_module(first), second) if isinstance(first, str) else first(*second)
        for step in self.way:
            place = getattr(place, step) if isinstance(step, str) and is_dataclass(place) else place[step]
        return place


def packed(value: Any, parts: tuple[Part, ...]) -> Any:
    """What can be sent in the place of a value: of parts, laws and functions of these parts their addresses."""
    places = _places(parts)

    def pack(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(pack, value))
        return places.get(id(value), value)

    return pack(value)


@lru_cache(maxsize=64)
def _places(parts: tuple[Part, ...]) -> dict[int, Address]:
    """The addresses by identity; what is kept here keeps the parts, so that no other thing gets their identity."""
    return {
        id(thing): Address(root, way)
        for part, root in zip(parts, map(_root, parts), strict=True)
        for thing, way in _inside(part) if isinstance(thing, Part | Law) or callable(thing)
    }  # fmt: skip


def unpacked(value: Any) -> Any:
    """The value again."""
    if isinstance(value, tuple):
        return tuple(map(unpacked, value))
    return value.found() if isinstance(value, Address) else value


def _root(part: Part) -> tuple[Any, Any]:
    if part.made_by is not None:
        return part.made_by
    for module in list(sys.modules.values()):
        for name, value in list(vars(module).items()) if hasattr(module, "__dict__") else ():
            if value is part:
                return module.__name__, name
    raise pickle.PicklingError(f"the part {part.name!r} cannot be sent: it must be a global of a module")


def _inside(thing: Any, way: Way = ()) -> Iterator[tuple[Any, Way]]:
    """All that a part is made of, each with the way to it."""
    yield thing, way
    if isinstance(thing, Part | PartMode | Law | Edge):
        for field in fields(thing):
            yield from _inside(getattr(thing, field.name), (*way, field.name))
    elif isinstance(thing, Mapping):
        for key, value in thing.items():
            yield from _inside(value, (*way, key))
    elif isinstance(thing, tuple):
        for k, value in enumerate(thing):
            yield from _inside(value, (*way, k))
