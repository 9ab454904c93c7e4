"""Orbits for the tests of files: each computed once."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from casahunt import InputError, Options, Orbit, Servo, find_orbit

ORBITS = {
    "switch": ("switch", Servo(), 0.3, Options()),
    "switch full cycle": ("switch", Servo(), 0.3, Options(half=False)),
    "switch, another servo": ("switch", Servo(inertia=0.05), 0.1, Options(degree=5, kind="radau")),
    "lugre": ("lugre", Servo(), 0.3, Options()),
}
_computed: dict[str, Orbit] = {}


def computed(name: str) -> Orbit:
    if name not in _computed:
        model, servo, gain, options = ORBITS[name]
        _computed[name] = find_orbit(servo, model, gain, options=options)
    return _computed[name]


def assert_same(a: Orbit, b: Orbit) -> None:
    """Equal to the last bit."""
    for field in fields(Orbit):
        if field.name not in ("arcs", "scale"):
            assert getattr(a, field.name) == getattr(b, field.name), field.name
    assert np.array_equal(a.scale, b.scale)
    for x, y in zip(a.arcs, b.arcs, strict=True):
        assert (x.mode, x.event, x.duration) == (y.mode, y.event, y.duration)
        for name in ("breaks", "states", "end"):
            assert np.array_equal(getattr(x, name), getattr(y, name)), name
            assert getattr(x, name).shape == getattr(y, name).shape


def refusal(call, *arguments) -> str:
    """The message of the InputError that `call` must raise: one line."""
    with pytest.raises(InputError) as caught:
        call(*arguments)
    message = str(caught.value)
    assert message and "\n" not in message
    return message
