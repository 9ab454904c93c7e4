"""Where a law or a function of a part stands, so that a loop can be sent to another process.

    address    (module, name of the part there, way from it)     or     (maker, its arguments, way from it)

The way leads from attribute to attribute and from entry to entry: "modes", 1, "law".  Functions of parts may then be
lambdas, which cannot be sent; a part (part.py) must be a global of a module, or say how it is made.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from typing import Any

from .part import Edge, Law, Part, PartMode, part_at

Way = tuple[Any, ...]


@dataclass(frozen=True)
class Address:
    """Where something of a part stands: `root` is that of the part."""

    root: tuple[Any, Any]
    way: Way

    def found(self) -> Any:
        """What stands there."""
        place: Any = part_at(*self.root)
        for step in self.way:
            place = getattr(place, step) if isinstance(step, str) and is_dataclass(place) else place[step]
        return place


def packed(value: Any, parts: tuple[Part, ...]) -> Any:
    """What can be sent in the place of a value: of laws and functions of these parts their addresses."""
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
        for part, root in ((part, part.root) for part in parts)
        for thing, way in _inside(part) if isinstance(thing, Law) or callable(thing)
    }  # fmt: skip


def unpacked(value: Any) -> Any:
    """The value again."""
    if isinstance(value, tuple):
        return tuple(map(unpacked, value))
    return value.found() if isinstance(value, Address) else value


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
