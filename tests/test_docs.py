"""docs/theory.md: its numbers are what the library gives, its modules exist, its links lead somewhere."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from map_support import map_fold

from casahunt import Options, Orbit, find_fold, find_orbit
from casahunt.servo.equilibria import equilibria
from casahunt.servo.gains import routh_hurwitz_gain
from problems import table1

ROOT = Path(__file__).resolve().parent.parent
THEORY = ROOT / "docs" / "theory.md"
TEXT = THEORY.read_text(encoding="utf-8")
SERVO = table1.servo()
MEASURED = table1.REFERENCE["experiment"]
LISTED = dict(
    re.findall(
        r"^\| (\w+) \| ([\d.e-]+) \|", TEXT.split("<!-- checked -->")[1].split("<!-- end -->")[0], re.MULTILINE
    )
)


def orbit(model: str, gain: float, branch: str = "stable") -> Orbit:
    return find_orbit(SERVO, model, gain, branch=branch, options=Options(tol=1e-8))


COMPUTED: dict[str, Callable[[], float]] = {
    "routh_hurwitz_gain": lambda: routh_hurwitz_gain(SERVO),
    "sharp_right": lambda: equilibria(SERVO, "lugre", 0.04).sharp[1],
    "simple_right": lambda: equilibria(SERVO, "lugre", 0.04).simple[1],
    "layer": lambda: equilibria(SERVO.replace(**{"friction.viscous": 0.02}), "lugre", 0.02).threshold,
    "below_amplitude": lambda: orbit("switch", 0.02).amplitude,
    "below_period": lambda: orbit("switch", 0.02).period,
    "switch_amplitude_ratio": lambda: orbit("switch", MEASURED["K"]).amplitude / MEASURED["amplitude"],
    "switch_period_ratio": lambda: orbit("switch", MEASURED["K"]).period * MEASURED["frequency_hz"],
    "lugre_amplitude_ratio": lambda: orbit("lugre", MEASURED["K"]).amplitude / MEASURED["amplitude"],
    "lugre_period_ratio": lambda: orbit("lugre", MEASURED["K"]).period * MEASURED["frequency_hz"],
    "switch_unstable_period": lambda: orbit("switch", 0.0321, "unstable").period,
    "lugre_unstable_period": lambda: orbit("lugre", 0.0321, "unstable").period,
    "switch_fold": lambda: find_fold(SERVO, "switch", options=Options(tol=1e-9)).gain,
    "lugre_fold": lambda: find_fold(SERVO, "lugre", options=Options(tol=1e-9)).gain,
    "map_fold": lambda: map_fold(SERVO).gain,
}
SLOW = ("lugre_unstable_period", "lugre_fold", "map_fold")


def test_every_listed_number_is_checked():
    assert list(LISTED) == list(COMPUTED)


@pytest.mark.parametrize("key", [pytest.param(k, marks=[pytest.mark.slow] if k in SLOW else []) for k in COMPUTED])
def test_number(key):
    """To half a unit of the last digit printed, and a rounding error more."""
    text = LISTED[key]
    mantissa, _, exponent = text.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    assert COMPUTED[key]() == pytest.approx(float(text), abs=0.5001 * unit)


def test_modules_named_in_the_text_exist():
    named = set(re.findall(r"`([\w/]+\.py)`", TEXT))
    assert len(named) > 15
    assert not [n for n in named if not (ROOT / "casahunt" / n).is_file() and not (ROOT / n).is_file()]


def test_links_lead_somewhere():
    for page in (THEORY, ROOT / "docs" / "figures" / "captions.md"):
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).is_file(), f"{page.name} points to {target}"
