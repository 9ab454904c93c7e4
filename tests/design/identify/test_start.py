"""Where a fit starts: the friction of a swing of servos whose friction is known; and records that nothing fitted."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import Servo, find_orbit, identify
from casahunt.design.identify.fit import Data
from casahunt.design.identify.matched import matched
from casahunt.servo.servo import flatten
from scripts.identify import Made


def swing_of(servo: Servo, model: str, gain: float) -> Data:
    """What a record of a servo's cycle says of amplitude and period."""
    orbit = find_orbit(servo, model, gain)
    nothing = np.zeros(1)
    return Data(nothing, nothing, gain, orbit.period, 1e-3, orbit.amplitude, 0.0, 0.0, nothing, "swing")


@pytest.mark.parametrize("model", ["switch", "lugre"])
@pytest.mark.parametrize("factors", [(1.4, 0.6), (0.6, 0.1), (2.0, 1.9), (1.0, 1.0)])
def test_a_swing_tells_static_and_coulomb_friction(model, factors):
    """From values that are far off, and hunt with no gain, hunt elsewhere, or are right."""
    true = Servo().replace(**{"friction.static": 0.5, "friction.coulomb": 0.41})
    wrong = true.replace(**{"friction.static": 0.5 * factors[0], "friction.coulomb": 0.41 * factors[1]})
    found = matched(wrong, model, swing_of(true, model, 0.1))
    assert found is not None
    assert found.friction.static == pytest.approx(0.5, rel=0.01)
    assert found.friction.coulomb == pytest.approx(0.41, rel=0.01)


def test_a_swing_that_no_friction_gives_is_not_found():
    """Its period is that of no servo with this inertia."""
    data = swing_of(Servo(), "switch", 0.1)
    short = Data(*[getattr(data, name) for name in ("times", "position", "gain")], 0.01, 1e-3, data.amplitude, 0.0, 0.0,
                 data.shape, "short")  # fmt: skip
    assert matched(Servo(), "switch", short) is None


@pytest.mark.parametrize(
    "number, model",
    [(15, "switch"), (63, "lugre"), pytest.param(2, "switch", marks=pytest.mark.slow),
     pytest.param(60, "lugre", marks=pytest.mark.slow), pytest.param(76, "switch", marks=pytest.mark.slow)],
)  # fmt: skip
def test_its_own_model_explains_a_record(number, model):
    """That sticks for a part in two hundred of a period, or hardly moves, or comes to its cycle slowly: all refused."""
    made = Made(number, 7, model, (2000.0, 20000.0))
    found = identify([made.record], made.starts[0], made.gain, model, advise=False)
    assert found.judgement.explained
    for name in ("friction.static", "friction.coulomb"):
        assert found.values[name] == pytest.approx(flatten(made.servo)[name], rel=0.05), name
