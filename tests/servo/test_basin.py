"""The border between settling and hunting: against the reference amplitudes and by the Taylor engine."""

from __future__ import annotations

import json

import pytest

from casahunt import InputError, NoOrbit, Options, Servo, cli
from casahunt.servo.basin import basin
from problems import table1
from problems.taylor import switch_half_cycle

UNSTABLE = {model: {row["K"]: row for row in table1.REFERENCE[model]["unstable"]} for model in ("switch", "lugre")}


@pytest.mark.parametrize("gain", [0.1, 0.4, 0.61])
def test_switch_border(gain):
    found = basin(Servo(), "switch", gain, options=Options(tol=1e-9))
    assert found.border == pytest.approx(UNSTABLE["switch"][gain]["amplitude"], rel=3e-9)
    assert found.confirmed and found.inside.start < found.border < found.outside.start
    for sign in (-1, 1):  # the first swing, by the independent engine
        a = found.border * (1 + sign * 0.01)
        assert (switch_half_cycle(Servo(), gain, a)[0] > a) == (sign > 0)


@pytest.mark.parametrize("gain", [0.1, 0.6])
def test_lugre_border(gain):
    """The unstable amplitude is the reference's; the stick position lies within 4 Fs/sigma0 of it."""
    found = basin(Servo(), "lugre", gain)
    assert found.unstable.amplitude == pytest.approx(UNSTABLE["lugre"][gain]["amplitude"], rel=2e-6)
    assert found.confirmed and 0 < found.unstable.amplitude - found.border < 4 * 0.53 / 2.2e4


def test_no_cycle_no_border(capsys):
    with pytest.raises(NoOrbit, match="no hunting limit cycle"):
        basin(Servo(), "switch", 0.7)
    with pytest.raises(InputError):
        basin(Servo(), "switch", 0.1, offset=0.9)
    assert cli.main(["basin", "--gain", "0.7"]) == 1
    assert cli.main(["basin"]) == 2
    capsys.readouterr()
    assert cli.main(["basin", "--gain", "0.6", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["confirmed"] and record["inside"]["outcome"] == "settles"
    assert cli.main(["basin", "--gain", "0.6"]) == 0 and "settles" in capsys.readouterr().out
