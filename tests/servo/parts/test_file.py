"""A loop in a file."""

import pytest

from casahunt import InputError
from casahunt.servo.parts import DEAD_BAND, INERTIA, INTEGRATOR, PID_BY_TIMES, SWITCH, Loop, load_loop
from casahunt.servo.parts.file import named_parts

PARTS = '["one inertia", "Switch friction", "PID by times", "integrator", "dead band"]'


def test_a_loop_is_that_of_its_parts(tmp_path):
    path = tmp_path / "loop.toml"
    path.write_text(f"[loop]\nparts = {PARTS}\n[values]\ngain = 0.1\ndead_band = 0.01\n")
    loop = load_loop(path)
    parts = INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR, DEAD_BAND
    assert loop.system == Loop(parts, {"gain": 0.1, "dead_band": 0.01}, loop.name).system


def test_every_part_has_a_name_of_its_own_but_for_the_reset():
    """There is one for each friction model, where events may not stand."""
    from casahunt.servo import parts as room

    every = [getattr(room, name) for name in room.__all__ if type(getattr(room, name)).__name__ == "Part"]
    assert len(every) == len(named_parts()) + 1


@pytest.mark.parametrize(("text", "sentence"), [
    ("", r"must say parts ="),
    ("[loop]\nparts = []", r"must say parts ="),
    ("[loop]\nparts = [3]", r"must be the name of a part"),
    (f"[loop]\nparts = {PARTS}\n[value]\ngain = 1", r"unknown table 'value'.*values"),
    (f"[loop]\nparts = {PARTS}\n[values]\ndead_bnd = 1", r"unknown parameter 'dead_bnd'.*dead_band"),
    (f"[loop]\nparts = {PARTS}\n[values]\ngain = 'high'", r"gain = 'high'"),
    ('[loop]\nparts = ["one inertla"]', r"unknown part 'one inertla'.*one inertia"),
    ('[loop]\nparts = ["backlash"]', r"backlash: is no remedy, and no part of this model"),
])  # fmt: skip
def test_what_is_refused(tmp_path, text, sentence):
    path = tmp_path / "loop.toml"
    path.write_text(text)
    with pytest.raises(InputError, match="loop file .*" + sentence):
        load_loop(path)
