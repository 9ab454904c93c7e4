"""The JSON of a command and the mapping of the same result say the same wherever they use the same name.

A command has null where a number does not belong to what was asked for; the result has its attribute there.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

import casahunt
from casahunt import Servo
from casahunt.cli import main

SERVO = Servo()
SAME = {
    "orbit --gain 0.1": (lambda: casahunt.find_orbit(SERVO, "switch", 0.1), None, 15),
    "fold": (lambda: casahunt.find_fold(SERVO, "switch"), None, 6),
    "loop --gain 0.1": (lambda: casahunt.linear_loop(SERVO, 0.1), "loops", 9),
    "equilibria --gain 0.1": (lambda: casahunt.equilibria(SERVO, "switch", 0.1), None, 4),
    "basin --gain 0.5": (lambda: casahunt.basin(SERVO, "switch", 0.5), None, 3),
    "simulate --gain 0.04 --time 20": (lambda: casahunt.simulate(SERVO, "switch", 0.04, time=20.0), None, 8),
}
"""By command: the result, the list that it is the first entry of, and names that both use at least."""


def numbers(value: Any) -> bool:
    """A number, a word, a truth value or a list of them: what may be called the same and be the same."""
    return all(map(numbers, value)) if isinstance(value, list) else not isinstance(value, dict)


@pytest.mark.parametrize("command", SAME)
def test_the_command_and_the_mapping_say_the_same(command, capsys):
    made, within, least = SAME[command]
    assert main([*command.split(), "--json", "--quiet"]) == 0
    printed = json.loads(capsys.readouterr().out)
    printed = printed[within][0] if within else printed
    mapping = json.loads(json.dumps(made().to_dict(table=False)))
    shared = [key for key in printed if key in mapping and key != "wall_s" and printed[key] is not None]
    shared = [key for key in shared if numbers(printed[key]) and numbers(mapping[key])]
    assert {key: printed[key] for key in shared} == {key: mapping[key] for key in shared}
    assert len(shared) >= least, shared
