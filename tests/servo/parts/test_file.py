"""A loop in a file."""

from pathlib import Path

import pytest

from casahunt import InputError, load, load_drive
from casahunt.servo import parts as room
from casahunt.servo.parts import (
    DEAD_BAND,
    INERTIA,
    INTEGRATOR,
    PID_BY_TIMES,
    RESET_AT_CENTRE,
    RESET_AT_ZERO,
    SWITCH,
    Loop,
    Part,
    friction_table,
    load_loop,
    series,
    state_space,
    transfer_function,
)
from casahunt.servo.parts.file import named_parts

PROBLEMS = Path(__file__).parents[3] / "problems"
PARTS = '["one inertia", "Switch friction", "PID by times", "integrator", "dead band"]'


def test_a_loop_is_that_of_its_parts(tmp_path):
    path = tmp_path / "loop.toml"
    path.write_text(f"[loop]\nparts = {PARTS}\n[values]\ngain = 0.1\ndead_band = 0.01\n")
    loop = load_loop(path)
    parts = INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR, DEAD_BAND
    assert loop.system == Loop(parts, {"gain": 0.1, "dead_band": 0.01}, loop.name).system


def test_one_call_reads_both_kinds_of_files(tmp_path):
    path = tmp_path / "axis.toml"
    path.write_text(f"[loop]\nparts = {PARTS}\n[values]\ngain = 0.1\n[drive]\nsample_time = 0.001\n")
    assert load(path).system == load_loop(path).system and load_drive(path).sample_time == 1e-3
    path.write_text(f"[loop]\nparts = {PARTS}\n[friction]\nstatic = 0.5\n")
    with pytest.raises(InputError, match=r"axis\.toml': unknown table 'friction'"):
        load(path)


def loaded(tmp_path, parts):
    path = tmp_path / "loop.toml"
    path.write_text(f"[loop]\nparts = [{parts}]\n")
    return load_loop(path)


def test_every_part_has_a_name_of_its_own_but_for_the_reset(tmp_path):
    """There is one for each friction model, where events may not stand: the file's is that which fits."""
    assert [name for name, parts in named_parts().items() if len(parts) > 1] == ["reset"]
    assert {part.name for part in vars(room).values() if isinstance(part, Part)} <= set(named_parts())
    for friction, reset in (("Switch friction", RESET_AT_ZERO), ("LuGre friction", RESET_AT_CENTRE)):
        for names in (["reset", friction], [friction, "reset"]):
            others = '"one inertia", "PID by gains", "integrator"'
            assert reset in loaded(tmp_path, f'{others}, "{names[0]}", "{names[1]}"').parts


def test_parts_that_are_made_of_lists(tmp_path):
    """The same objects as from Python."""
    loop = loaded(tmp_path, '''"one inertia",
        {part = "friction table", velocity = [0.0, 0.02, 1.0], torque = [0.5, 0.4, 0.5], static = 0.53},
        {part = "transfer function", numerator = [0.16, 2.0, 6.28], denominator = [0.001, 1.0, 0.0]},
        {part = "series", filters = ["notch", "low-pass"]}''')
    made = friction_table([0, 0.02, 1.0], [0.5, 0.4, 0.5], 0.53), transfer_function([0.16, 2.0, 6.28], [1e-3, 1.0, 0.0])
    assert loop.parts == (INERTIA, *made, series("notch", "low-pass"))
    pi = loaded(tmp_path, '"one inertia", "Switch friction", {part="state space", A=[[0.0]], B=[1.0], C=[6.28], D=2.0}')
    assert pi.parts[-1] is state_space([[0]], [1], [6.28], 2)


@pytest.mark.parametrize(("text", "sentence"), [
    ("", r"must say parts ="),
    ("[loop]\nparts = []", r"must say parts ="),
    ("[loop]\nparts = [3]", r"must be the name of a part"),
    (f"[loop]\nparts = {PARTS}\n[value]\ngain = 1", r"unknown table 'value'.*values"),
    (f"[loop]\nparts = {PARTS}\n[values]\ndead_bnd = 1", r"unknown parameter 'dead_bnd'.*dead_band"),
    (f"[loop]\nparts = {PARTS}\n[values]\ngain = 'high'", r"gain = 'high'"),
    ('[loop]\nparts = ["transfer function"]', r"must say numerator: .part = .transfer function., numerator = "),
    ('[loop]\nparts = [{part="transfer function", numerator=[1]}]', r"must say denominator"),
    ('[loop]\nparts = [{part="transfer function", numerator=[1], denominatr=[1]}]', r"'denominatr'.*denominator"),
    ('[loop]\nparts = [{part="transfer function", numerator=["a"], denominator=[1]}]', r"numerator: every entry"),
    ('[loop]\nparts = [{part="series", filters=3}]', r"series: must be made of lists: filters"),
    ('[loop]\nparts = [{part="series", filters=["comb"]}]', r"unknown filter 'comb'"),
    ('[loop]\nparts = [{part="friction table", velocity=3, torque=[1]}]', r"friction table: must be made of lists"),
    ('[loop]\nparts = [{part="leak", leak=0.1}]', r"leak: leak: its numbers stand in the table .values."),
    ('[loop]\nparts = [{leak=0.1}]', r"must be the name of a part, or a table"),
    ('[loop]\nparts = ["one inertla"]', r"unknown part 'one inertla'.*one inertia"),
    ('[loop]\nparts = ["backlash"]', r"backlash: is no remedy, and no part of this model"),
])  # fmt: skip
def test_what_is_refused(tmp_path, text, sentence):
    path = tmp_path / "loop.toml"
    path.write_text(text)
    with pytest.raises(InputError, match="loop file .*" + sentence):
        load_loop(path)


def test_a_byte_order_mark_and_the_unit_of_every_time(tmp_path):
    """As editors of Windows write files; times of all parts take a unit."""
    path = tmp_path / "axis.toml"
    path.write_text('''[loop]
parts = ["one inertia", "Switch friction", "cascade P-PI, velocity filtered", "integrator"]
[values]
velocity_filter = "1.5 ms"
reset_time = "20 ms"
''', encoding="utf-8-sig")
    assert (load(path).value("velocity_filter"), load(path).value("reset_time")) == (1.5e-3, 20e-3)


def test_of_a_linear_axis_every_number_is_stated(tmp_path):
    """What its parts have of themselves is the rotary servo of Table 1; that there is no damping need not be said."""
    lines, path = (PROBLEMS / "belt_axis.toml").read_text().splitlines(True), tmp_path / "axis.toml"
    stated = lines[lines.index("[values]\n") + 1 : lines.index("[drive]\n") - 1]
    for line in stated:
        path.write_text("".join(other for other in lines if other != line))
        name = line.partition(" =")[0]
        if name.endswith("damping"):
            assert load(path).value(name) == 0
            continue
        with pytest.raises(InputError, match=f"{name}: must be given, of a linear axis nothing is taken from Table 1"):
            load(path)
