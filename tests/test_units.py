"""Quantities with their units: read from text, carried by servos and loops, and written in the units of their axis.

The sizes of units are those of the SI brochure (9th edition, tables 2 to 8) and of NIST SP 811 (appendix B.8).
"""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from casahunt import Drive, Friction, InputError, Pid, Servo, Units, load, load_drive
from casahunt.axis_units import quantity as said
from casahunt.axis_units import shown_in, units_of_table
from casahunt.quantities import in_si, number_in, unit_of_text, with_its_unit
from casahunt.servo.parts import load_loop
from casahunt.servo.servo import with_overrides
from problems.ball_screw import BY_HAND, TOML

BROCHURE = {
    "mm": "1e-3", "um": "1e-6", "µm": "1e-6", "in": "0.0254", "ft": "0.3048", "kg": "1", "g": "1e-3", "t": "1e3",
    "lb": "0.45359237", "oz": "0.028349523125", "N": "1", "kN": "1e3", "lbf": "4.4482216152605", "kgf": "9.80665",
    "N s/mm": "1e3", "N/(mm s)": "1e3", "N/mm": "1e3", "kg m2": "1", "g cm^2": "1e-7", "kg cm²": "1e-4", "mN m": "1e-3",
    "N cm": "1e-2", "ms": "1e-3", "min": "60", "h": "3600", "1/s": "1", "mV/rad": "1e-3", "N·m": "1", "Nm": "1",
}  # fmt: skip
"""Of units without pi: their size in SI."""
ANGLES = {"deg": 180, "°": 180, "gon": 200, "arcmin": 10800, "arcsec": 648000, "rev": Fraction(1, 2)}
"""Of angles: how many are pi."""
LINEAR = '[units]\nmotion = "linear"\nlength = "mm"\n'


@pytest.mark.parametrize("unit", BROCHURE)
def test_sizes_of_units_are_those_of_the_brochure(unit):
    factor = unit_of_text(unit)[0]
    assert factor == Fraction(BROCHURE[unit])
    for number in ("57", "0.1", "1e-3", "123456.789"):  # what is read is the double nearest to the decimal
        x = in_si("x", f"{number} {unit}", (unit,))
        assert x == float(Fraction(number) * Fraction(BROCHURE[unit]))
        assert number_in(x, unit) == pytest.approx(float(number), rel=3e-16)


@pytest.mark.parametrize("unit", ANGLES)
def test_sizes_of_angles(unit):
    assert float(unit_of_text(unit)[0]) == pytest.approx(math.pi / float(ANGLES[unit]), rel=3e-16)


@pytest.mark.parametrize("text", ["30", "1e-3", "abc", "", "1.5e", "5 e3", "nan", "1,5", "0x10s"])
def test_what_is_no_number_with_a_unit(text):
    assert with_its_unit(text) is None or text == "0x10s"


def test_an_axis_in_mm_is_the_one_written_by_hand():
    servo = load(TOML)
    assert servo == BY_HAND
    assert servo.units == Units("linear", "mm", "N", "kg") and servo.units != BY_HAND.units  # shown, not compared
    assert servo.replace(**{"friction.static": 100.0}).units == servo.units
    changed = with_overrides(servo, ["friction.static=0.12 kN", "servo.mass = 30000 g", "friction.viscous=800"])
    assert changed == BY_HAND.replace(**{"friction.static": 120.0})


def test_a_loop_in_mm_is_the_one_written_by_hand(tmp_path):
    path = tmp_path / "loop.toml"
    parts = ["two masses", "Switch friction", "cascade P-PI", "integrator", "torque limit"]
    own = 'mass = "12 kg"\nload_mass = "18 kg"\nshaft_stiffness = "40 N/um"\nshaft_damping = "2 N s/mm"\n'
    own += 'motor_gain = 1\ngain = "0.001 V/mm"\nposition_gain = "30 1/s"\nvelocity_gain = "3 N s/mm"\n'
    own += 'reset_time = "20 ms"\nstatic = "90 N"\ncoulomb = "65 N"\nstribeck_velocity = "2 mm/s"\n'
    own += 'force_limit = "1 kN"\nviscous = "0.8 N s/mm"\n[drive]\nsample_time = "1 ms"\nencoder = "1 um"\n'
    path.write_text(f"{LINEAR}[loop]\nparts = {parts}\n[values]\n{own}")
    loop = load_loop(path)
    assert loop.parameters == pytest.approx(loop.parameters, rel=0) and loop.units.linear
    assert {name: loop.value(name) for name in loop.values} == {
        "inertia": 12.0, "load_inertia": 18.0, "shaft_stiffness": 4e7, "shaft_damping": 2e3, "motor_gain": 1.0,
        "gain": 1.0, "position_gain": 30.0, "velocity_gain": 3e3, "reset_time": 0.02, "static": 90.0, "coulomb": 65.0,
        "stribeck_velocity": 2e-3, "torque_limit": 1e3, "viscous": 800.0,
    }  # fmt: skip


def test_the_drive_of_a_linear_axis(tmp_path):
    path = tmp_path / "servo.toml"
    drive = '\n[drive]\nsample_time = "1 ms"\nencoder = "0.5 um"\ndead_band = "3 um"\nquantise_force = "20 mN"\n'
    path.write_text(TOML.read_text() + drive)
    found = load_drive(path)
    assert found.count == pytest.approx(5e-7, rel=3e-16)
    assert (found.sample_time, found.dead_band, found.quantise_torque) == (1e-3, 3e-6, 0.02)
    assert found == Drive(sample_time=1e-3, encoder=found.encoder, dead_band=3e-6, quantise_torque=0.02)


BAD = {
    LINEAR + '[servo]\nmass = "30 kgg"\n': ["servo.mass = '30 kgg'", "unknown unit 'kgg'; did you mean 'kg'?"],
    LINEAR + '[servo]\nmass = "30 N"\n': ["servo.mass = '30 N': must be in kg, or in a multiple of that"],
    LINEAR + '[friction]\nstatic = "90 N m"\n': ["must be in N", "the axis is linear"],
    LINEAR + '[friction]\nstribeck_velocity = "2 rad/s"\n': ["must be in m/s"],
    LINEAR + '[friction]\nviscous = "3 N//mm"\n': ["must be written as N s/mm"],
    LINEAR + '[friction]\nviscous = "3 N/(mm"\n': ["must end in a bracket"],
    '[drive]\nsample_time = 0.001\nremaining_gain = "1 mm"\n': ["must be a number without a unit"],
    LINEAR + '[servo]\nmass = 30\ninertia = 30\n': ["is given twice"],
    LINEAR + '[drive]\nsample_time = 0.001\nencoder = 2000\n': ["must be the size of a count, such as '1 um'"],
    TOML.read_text().replace("1 N/V", "2 N/V"): ["controller.kp = '240 N/mm'", "in V where motor_gain is 2"],
    LINEAR + '[friction]\nstatic = 90\n': ["servo.mass", "must be given", "Table 1"],
    LINEAR + '[servo]\nmass = "1e99999999 kg"\n': ["servo.mass", "must be a finite number"],
    LINEAR + '[servo]\nmass = "3 kg99999999"\n': ["must be written as N s/mm"],
    TOML.read_text().replace("30 kg", "1e-99999999 kg"): ["servo.mass = 0: must be greater than 0"],
    TOML.read_text().replace("2 mm/s", "2 counts/s"): ["the size of a count is not known", "counts = '0.1 um'"],
    '[friction]\nstatic = "0.5 N"\n': ["must be in N m", "the axis is rotary"],
    '[servo]\nmass = 30\n': ["unknown key 'servo.mass'"],
    '[controller]\nlead_time = "2 mm"\n': ["must be in s"],
    '[units]\nmotion = "straight"\n': ["unknown units.motion 'straight'"],
    '[units]\nlength = "mm"\n': ["units.length: is of a linear axis"],
    LINEAR + 'angle = "deg"\n': ["units.angle: is of a rotary axis"],
    '[units]\nmotion = "linear"\nlength = "kg"\n': ["units.length = '1 kg': must be in m"],
    '[units]\nmotion = "linear"\nlength = "nmm"\n': ["units.length", "unknown unit 'nmm'"],
    '[units]\nmotion = "linear"\nlengths = "mm"\n': ["unknown key 'units.lengths'; did you mean 'units.length'?"],
    '[units]\nmotion = "linear"\ncounts = "2 N"\n': ["units.counts = '2 N': must be in m"],
    '[units]\nmotion = "linear"\ncounts = 2\n': ["must be a number above 0 with its unit"],
    'units = 3\n': ["units = 3: must be a table [units]"],
}  # fmt: skip


@pytest.mark.parametrize("text", BAD)
def test_what_is_wrong_is_said(text, tmp_path):
    path = tmp_path / "servo.toml"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        load(path)
    for words in BAD[text]:
        assert words in str(refusal.value)


SHOWN = {
    (5.718e-5, "rad"): "57.18 um", (0.005718, "rad"): "5.718 mm", (0.0005718, "rad"): "0.5718 mm", (0.0, "rad"): "0 mm",
    (25.0, "rad"): "25 m", (2e-3, "rad/s"): "2 mm/s", (3e-6, "rad/s"): "3 um/s", (91.37, "N m"): "91.37 N",
    (0.02, "N m"): "20 mN", (2.5e5, "N m"): "250 kN", (3000.0, "N m s/rad"): "3 N s/mm", (1.25, "V/rad"): "1.25 V/m",
    (30.0, "kg m2"): "30 kg", (1e-9, "rad s"): "1 nm s",
}  # fmt: skip


@pytest.mark.parametrize("quantity", SHOWN)
def test_prefixes_read_well(quantity):
    x, unit = quantity
    with shown_in(Units("linear", "mm", "N", "kg")):
        text = said(x, unit)
        assert text == SHOWN[quantity]
        number, label = with_its_unit(text)  # and back
        assert in_si("x", text, (Units("linear", "m", "N", "kg").label(unit),)) == pytest.approx(x, rel=1e-12)
    assert said(x, unit) == f"{x:.4g} {unit}"  # of a rotary axis without units as ever


def test_what_units_leave_out_is_in_si():
    assert Units("linear", "mm") == Units("linear", "mm", "N", "kg")
    assert Units() == Units("rotary", "rad", "N m", "kg m2")
    for wrong in ({"motion": "straight"}, {"coordinate": "mm"}, {"motion": "linear", "effort": "N m"}):
        with pytest.raises(InputError):
            Units(**wrong)


def test_counts_are_a_unit():
    units = units_of_table({"motion": "linear", "length": "counts", "counts": "0.1 um"})
    assert units.number(5e-6, "rad") == 50.0 and units.read("x", "3 counts", "rad") == 3e-7


def test_units_take_no_part_in_a_servo():
    friction, pid = Friction(static=90.0, coulomb=65.0), Pid(kp=1.0, ki=1.0, kd=1.0)
    one, other = (Servo(friction=friction, controller=pid, units=units) for units in (Units(), Units("linear", "mm")))
    assert one == other and hash(one) == hash(other) and repr(one) == repr(other)
