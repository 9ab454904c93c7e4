"""States of the page: addresses, files, ranges and what is refused in them."""

from __future__ import annotations

from urllib.parse import urlencode

import pytest
from explore_support import STATES, TABLE1, turned

from casahunt import InputError
from casahunt.views.explore.page import HIDDEN, LUGRE_ALONE, choices_of, command_line, controls_of, servo_file
from casahunt.views.explore.state import state_of_address, state_of_file


@pytest.mark.parametrize("name", STATES)
def test_an_address_reproduces_its_state(name):
    assert state_of_address(STATES[name].address()) == STATES[name]


@pytest.mark.parametrize("name", STATES)
def test_a_file_brings_the_same_problem_back(name):
    """To the last bit: a servo its numbers, a loop its parts and theirs."""
    problem = STATES[name].problem
    again = state_of_file(servo_file(STATES[name])).problem
    if problem.loop is None:
        assert (again.servo, again.gain, again.model) == (problem.servo, problem.gain, problem.model)
    else:
        assert again.loop.present == problem.loop.present or name.startswith("table")
        assert again.loop.parameters == problem.loop.parameters


BUILT = "[drive]\nsample_time = 0.001\nencoder = 2000\nderivative = 'filtered'\n"


def test_a_drive_goes_along_and_is_said():
    """In the address, in the file that the page writes, in the command; of a loop of parts as a remark."""
    state = state_of_file("[friction]\nstatic = 0.5\n" + BUILT)
    assert state.drive == {"sample_time": 0.001, "encoder": 2000, "derivative": "filtered"}
    assert state_of_address(state.address()) == state and "simulate" in state.note() and not TABLE1.note()
    again = state_of_file(servo_file(state))
    assert again == state and "--set drive.encoder=2000" in command_line(state)
    remedied = state.choose("remedy", "leak")
    assert "sample_time = 0.001" in servo_file(remedied) and state_of_file(servo_file(remedied)).is_loop
    with pytest.raises(InputError, match="drive.sample_time: must be given"):
        state_of_address("drive.encoder=2000")


def test_a_saved_file_brings_gain_step_and_model_and_another_one_leaves_them():
    state = turned(TABLE1.choose("model", "lugre"), gain=0.2, step=0.5)
    assert state_of_file(servo_file(state), beside=TABLE1) == state
    other = state_of_file("[friction]\nstatic = 0.5", beside=state)
    assert other == turned(state, friction__static=0.5)
    assert state_of_file(servo_file(STATES["loop"]), beside=state).values["gain"] == 0.04
    text = servo_file(state).replace("gain=0.2", "gain=-1")
    with pytest.raises(InputError, match="gain = -1: must be greater than 0"):
        assert state_of_file(text).problem


@pytest.mark.parametrize("text", ["", "# nothing\n"])
def test_an_empty_file_is_no_servo(text):
    with pytest.raises(InputError, match=r"holds nothing; a servo file has \[servo\]"):
        state_of_file(text)


@pytest.mark.parametrize("text", ["1_0", "\uff11", "\u0661", "0,2", "1e", ""])
def test_what_is_no_number(text):
    point = "; decimals take a point, 0.2" if text == "0,2" else ""
    with pytest.raises(InputError, match=f"must be a finite number{point}$"):
        state_of_address(urlencode({"gain": text}))


@pytest.mark.parametrize("name", STATES)
def test_every_number_has_a_control(name):
    state, made = STATES[name], controls_of(STATES[name])
    hidden = {*HIDDEN, *(() if state.model == "lugre" else LUGRE_ALONE)} if not state.is_loop else set()
    assert {control.key for control in made} == set(state.values) - hidden
    for control in made:
        assert control.low < control.high and control.low <= control.value <= control.high or control.zero
        assert not control.log or control.low > 0


def test_choices():
    assert choices_of(TABLE1)["remedy"]["chosen"] == "" and not choices_of(STATES["loop"])
    assert TABLE1.choose("remedy", "freeze").choose("model", "lugre").remedy == ""  # freeze is for Switch alone
    assert TABLE1.choose("remedy", "leak").choose("model", "lugre").remedy == "leak"
    assert TABLE1.choose("remedy", "leak").choose("remedy", "") == TABLE1
    with pytest.raises(InputError, match="parts of a loop"):
        STATES["loop"].choose("model", "lugre")


def test_the_form_of_the_controller_changes_no_controller():
    asked = turned(TABLE1, controller__lead_time=0.1, controller__integral_time=0.3)
    gains = asked.choose("controller", "gains")
    back = gains.choose("controller", "times")
    for state in (gains, back):
        problem = state.problem
        assert problem.servo.torque_gains(problem.gain) == pytest.approx(
            asked.problem.servo.torque_gains(asked.problem.gain), rel=1e-12
        )
    with pytest.raises(InputError, match="complex"):
        STATES["canudas"].choose("controller", "times")


@pytest.mark.parametrize(
    "address, said",
    [
        ("gain=-1", "gain = -1: must be greater than 0"),
        ("gain=nan", "gain = nan"),
        ("gain=inf", "gain = inf"),
        ("gain=fast", "gain = 'fast'"),
        ("step=0", "step = 0"),
        ("friction.static=0.1", "friction.static = 0.1: must be at least 0.44"),
        ("friction.statik=1", "did you mean 'friction.static'"),
        ("spring=inf", "spring = inf"),
        ("model=dahl", "unknown model"),
        ("remedy=hope", "unknown remedy"),
        ("remedy=leak&leak=-1", "leak = -1: must be at least 0"),
        ("model=lugre&remedy=freeze", "unknown remedy"),
        ("part=one+inertia&part=nothing", "unknown part"),
        ("part={&gain=1", "must be the name of a part"),
        ("&".join(f"a{i}=1" for i in range(1000)), "at most 200"),
    ],
)
def test_what_is_wrong_is_refused_in_a_sentence(address, said):
    with pytest.raises(InputError, match=r"^.*" + said.replace("(", r"\(")):
        assert state_of_address(address).problem


def test_a_file_that_is_none_is_refused():
    for text, said in (("[servo", "not valid TOML"), ("[x]\na = 1", "unknown section"), ("#" * 60000, "at most")):
        with pytest.raises(InputError, match=said):
            state_of_file(text)
