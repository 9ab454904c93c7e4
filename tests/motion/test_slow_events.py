"""Two zeros of an event beside each other: it all but stands there, and its place is known no better than that."""

from __future__ import annotations

import math

import numpy as np
import pytest

from casahunt.hybrid import Event, Mode, System
from casahunt.motion import simulate

WAYS = {
    "straight": ({"field": lambda x, p: {"x": 1.0}}, lambda x: x - 0.5),
    "curved": ({"field": lambda x, p: {"x": x.x}}, lambda x: math.log(x / 0.5)),
    "closed form": ({"flow": lambda x, t, p: {"x": x.x + t}}, lambda x: x - 0.5),
    "intervals": ({"field": lambda x, p: {"x": x.x}, "stiff": True}, lambda x: math.log(x / 0.5)),
}
"""What a mode says, and when it comes to x from 1/2."""


def between(d: float, event, way: str) -> System:
    """One mode up to the first zero and behind the second one, another between them."""
    said = WAYS[way][0]
    ends = [Event("in", event, -1, to="inside")], [Event("out", event, +1, to="outside")]
    return System("two zeros", ("x",), {"d": d}, tuple(
        Mode(name, ends=tuple(own), **said) for name, own in zip(("outside", "inside"), ends, strict=True)
    ))  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("d", [1e-3, 1e-4, 1e-5, 5e-7, 3e-7])
def test_the_stated_error_holds_at_each_event(d, way):
    """(x - 1)^2 = d^2 at 1 - d and 1 + d; before, 5e-8 off with an error of 0.0, or not seen at all.

    By intervals a pair so narrow that the polynomial does not show it may be passed by as a contact is.
    """
    motion = simulate(between(d, lambda x, p: (x.x - 1) ** 2 - p.d**2, way), x=0.5, duration=0.9)
    if way == "intervals" and not motion.events:
        assert d**2 < 1e-7
        return
    assert [crossing.event for crossing in motion.events] == ["in", "out"]
    for crossing, place in zip(motion.events, (1 - d, 1 + d), strict=True):
        assert abs(crossing.time - WAYS[way][1](place)) <= motion.error * motion.duration + 1e-15
        assert abs(crossing.before[0] - place) <= motion.error * motion.sizes["x"] + 1e-15
    if way != "intervals":
        assert motion.error < 1e-14


@pytest.mark.parametrize("way", WAYS)
def test_an_event_that_is_rounded_says_so(way):
    """The same scalar with 1e4 added and taken off: it is zero for rounding all about its place."""
    d = 1e-4
    motion = simulate(between(d, lambda x, p: ((x.x - 1) ** 2 + 1e4) - (1e4 + p.d**2), way), x=0.5, duration=0.9)
    if way == "intervals" and not motion.events:
        return
    off = [abs(c.before[0] - place) for c, place in zip(motion.events, (1 - d, 1 + d), strict=True)]
    assert 1e-12 < max(off) <= motion.error * motion.sizes["x"] and motion.error < 1e-6
    assert np.all(np.isfinite(off))
