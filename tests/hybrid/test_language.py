"""A user's system: what is wrong with it is said in one sentence that names the culprit; systems are data."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from casahunt.errors import InputError
from casahunt.hybrid import Event, Mode, System
from casahunt.hybrid.system import Cycle, Phase
from casahunt.motion.simulation import simulate
from casahunt.orbits import find_cycle


def van_der_pol(x, p):
    return {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x}


def height(x, p):
    return x.x


def turn(p):
    return 2 * math.pi / p.mu


def turned_back(x, p):
    return {"v": -0.8 * x.v}


def system(*modes: Mode, **changed: Any) -> System:
    """The van der Pol oscillator, in part another."""
    given: dict[str, Any] = {
        "name": "oscillator", "states": ("x", "v"), "parameters": {"mu": 1.0},
        "modes": modes or (Mode("free", van_der_pol),),
    }  # fmt: skip
    return System(**(given | changed))


def with_field(function: Any) -> Callable[[], System]:
    return lambda: system(Mode("free", function))


def with_event(**changed: Any) -> Callable[[], System]:
    event = Event("hits", height, -1, to="free")
    return lambda: system(Mode("free", van_der_pol, ends=(replace(event, **changed),)))


def v_is(value: Callable[[Any, Any], Any]) -> Callable[[], System]:
    return with_field(lambda x, p: {"x": x.v, "v": value(x, p)})


EVENT = Event("hits", height, -1, to="free")
FIELD, HITS, SYSTEM = "mode 'free': field", "event 'hits' of mode 'free'", "system 'oscillator'"
JUMPS, TWO = "mode 'free': field of the state 'v' jumps", "write two modes"
BAD: dict[str, tuple[Callable[[], System], str]] = {
    # Fields
    "unknown state": (v_is(lambda x, p: x.w), f"{FIELD}: there is no state 'w'; there is x, v"),
    "unknown parameter": (v_is(lambda x, p: p.nu), f"{FIELD}: there is no parameter 'nu'; there is mu"),
    "time": (v_is(lambda x, p: x.t), f"{FIELD}: there is no state 't'.* forcing_period"),
    "missing derivative": (with_field(lambda x, p: {"x": x.v}), f"{FIELD} says nothing of the state v"),
    "one too many": (with_field(lambda x, p: {"x": 0, "v": 0, "w": 0}), f"{FIELD} speaks of w; the states are x, v"),
    "list": (with_field(lambda x, p: [x.v, x.x]), f"{FIELD} must return states by name, such as .'x': .*, not .SX"),
    "vector": (v_is(lambda x, p: ca.vertcat(x.x, x.v)), rf"{FIELD} of the state 'v' must return a scalar.*\(2, 1\)"),
    "none": (v_is(lambda x, p: None), f"{FIELD} of the state 'v' must return a scalar, not None"),
    "math": (v_is(lambda x, p: math.sin(x.x) - x.v), f"{FIELD} of the state 'v' is NaN.* casadi.sin, not"),
    "nan": (v_is(lambda x, p: math.nan * x.x), f"{FIELD} of the state 'v' is NaN"),
    "infinite": (v_is(lambda x, p: x.x + math.inf), f"{FIELD} of the state 'v' holds an infinite number"),
    "if": (v_is(lambda x, p: 1 if x.x > 0 else -1), f"{FIELD} cannot be evaluated.*truth value.* casadi.if_else"),
    "max": (v_is(lambda x, p: max(x.x, 0)), f"{FIELD} cannot be evaluated.*fmax"),
    "comparison": (v_is(lambda x, p: x.x > x.v), rf"{JUMPS} \(by 1.* where v = x: {TWO}"),
    "friction": (v_is(lambda x, p: p.mu * ca.sign(x.v)), rf"{JUMPS} \(by 2, .* where v = 0: {TWO}"),
    "choice": (v_is(lambda x, p: ca.if_else(x.x > 1.37e5, 0, p.mu)), rf"{JUMPS} \(by 1.* where x = 137000: {TWO}"),
    "a narrow choice": (v_is(lambda x, p: ca.logic_and(x.x > 1e-7, x.x < 1.001e-7)), f"{JUMPS} .* where x = 1"),
    "parts that nearly meet": (v_is(lambda x, p: ca.if_else(x.x > 1.2, 1, 0.8333 * x.x)), rf"{JUMPS} \(by 4e-05"),
    "a small jump": (v_is(lambda x, p: 1e6 * x.x + 1e-3 * ca.sign(x.v)), f"{JUMPS} .* where v = 0"),
    "a jump of size 0": (v_is(lambda x, p: (p.mu - 1) * ca.sign(x.v)), f"{JUMPS} .* where v = 0"),
    "where it is defined": (v_is(lambda x, p: ca.log(x.x) * ca.sign(x.v - 1)), rf"{JUMPS} .* where \(v-1\) = 0"),
    "steps": (v_is(lambda x, p: ca.floor(x.x / 0.01)), rf"{JUMPS} .* where floor\(\(x/0.01\)\) does"),
    "ceiling": (v_is(lambda x, p: ca.ceil(x.x)), f"{JUMPS} .* where ceil"),
    "sawtooth": (v_is(lambda x, p: ca.fmod(x.x, 0.7)), rf"{JUMPS} \(by 0.7, .* where fmod\(x, 0.7\) does"),
    "remainder": (v_is(lambda x, p: ca.remainder(x.x, 0.7)), rf"{JUMPS} \(by 0.7, .* where remainder"),
    "copied sign": (v_is(lambda x, p: ca.copysign(p.mu, x.v)), rf"{JUMPS} \(by 2, .* where copysign"),
    "angle of two": (v_is(lambda x, p: ca.atan2(x.v, x.x)), rf"{JUMPS} \(by 6.28, .* where atan2\(v, x\) does"),
    "square wave": (lambda: system(Mode("free", lambda x, p: {"x": x.v, "v": ca.sign(ca.sin(x.t))}),
                                   forcing_period=turn), f"{JUMPS} .* where sin"),
    "a sign in disguise": (v_is(lambda x, p: x.v / ca.fabs(x.v)), rf"{JUMPS} \(by 2, .* where v = 0: {TWO}"),
    "another": (v_is(lambda x, p: (x.x - x.v) / ca.sqrt((x.x - x.v) ** 2)), rf"{JUMPS} .* where \(x-v\) = 0: {TWO}"),
    "a third": (v_is(lambda x, p: ca.fmax(x.x - 1, 0) / (x.x - 1)), rf"{JUMPS} \(by 1, .* where \(x-1\) = 0: {TWO}"),
    "by a power": (v_is(lambda x, p: x.v * (x.v * x.v) ** -0.5), rf"{JUMPS} \(by 2, .* where sq\(v\) = 0: {TWO}"),
    "a pole cut off": (v_is(lambda x, p: ca.tanh(1 / (x.v - p.mu))), rf"{JUMPS} \(by 2, .* where \(v-mu\) = 0"),
    "a pole as an angle": (v_is(lambda x, p: ca.atan(1 / x.v)), rf"{JUMPS} \(by 3.14, .* where v = 0"),
    "angle of a tangent": (v_is(lambda x, p: ca.atan(ca.tan(3 * x.v))), rf"{JUMPS} \(by 3.14, .* where cos"),
    "by a logarithm": (v_is(lambda x, p: x.v / ca.exp(ca.log(x.v * x.v) / 2)), rf"{JUMPS} \(by 2, "),
    "angle beside nothing": (v_is(lambda x, p: ca.atan2(x.v, 0)), rf"{JUMPS} \(by 3.14, .* where v = 0"),
    "a switch by a pole": (v_is(lambda x, p: 1 / (1 + ca.exp(1 / x.v))), rf"{JUMPS} \(by 1, .* where v = 0"),
    "sign of a mode": (lambda: system(Mode("free", lambda x, p: {"x": x.v, "v": ca.if_else(p.sign * x.x > 0, 1, 0)},
                                           sign=-1)), JUMPS),
    "flow jumps": (lambda: system(Mode("rest", flow=lambda x, t, p: {"x": x.x, "v": x.v + (t > 1)})),
                   "mode 'rest': flow of the state 'v' jumps .* where t = 1"),
    "event jumps": (with_event(function=lambda x, p: x.x * ca.sign(x.v)), f"{HITS}: function jumps over zero where v"),
    "index": (v_is(lambda x, p: x[0]), f"{FIELD} cannot be evaluated.* written x.name"),
    "division": (v_is(lambda x, p: 1 / 0), f"{FIELD} cannot be evaluated with CasADi's symbols: division by zero"),
    "arguments": (with_field(lambda x: {}), rf"{FIELD} cannot be evaluated.* takes \(x, p\)"),
    "own symbol": (v_is(lambda x, p: ca.SX.sym("q")), f"{FIELD} of the state 'v' depends on q, which is no state"),
    "number": (with_field(3), f"{FIELD} must be a function, not 3"),
    "neither": (with_field(None), "mode 'free': needs a field, or a flow"),
    "flow": (lambda: system(Mode("rest", flow=lambda x, t, p: {"x": x.x})), "mode 'rest': flow says nothing of"),
    "flow of two": (lambda: system(Mode("rest", flow=height)), r"mode 'rest': flow cannot .* a flow takes \(x, t, p\)"),
    # Modes
    "holds": (lambda: system(Mode("free", van_der_pol, holds=lambda x, p: [x.x])), "mode 'free': holds must return"),
    "feature": (lambda: system(Mode("free", van_der_pol, feature=1)), "mode 'free': feature must be a function, not 1"),
    "unsplit": (lambda: system(Mode("free", van_der_pol, unsplit="whole")),
                "mode 'free': unsplit = 'whole': must be another of the modes free"),
    "slack": (lambda: system(Mode("free", van_der_pol, slack=-0.1)), "mode 'free': slack = -0.1: must not be negative"),
    "ends": (lambda: system(Mode("free", van_der_pol, ends=EVENT)), r"mode 'free': ends must be a tuple of Events"),
    "twice": (lambda: system(*2 * (Mode("free", van_der_pol),)), f"{SYSTEM}: more than one mode is called free"),
    "mode list": (lambda: system(modes=[Mode("free", van_der_pol)]), f"{SYSTEM}: modes must be a tuple"),
    "no mode": (lambda: system(modes=()), f"{SYSTEM}: modes must be a tuple of at least one Mode"),
    "no Mode": (lambda: system(modes=(van_der_pol,)), f"{SYSTEM}: <function van_der_pol.* among the modes is no Mode"),
    "mode name": (lambda: system(Mode(["a"], van_der_pol)), r"the name of a mode must be a text, not \['a'\]"),
    "sign": (lambda: system(Mode("free", van_der_pol, sign="+")), r"mode 'free': sign = '\+': must be a finite number"),
    "signless": (v_is(lambda x, p: p.sign), f"{FIELD}: there is no parameter 'sign'; there is mu"),
    "two signs": (lambda: system(Mode("free", van_der_pol, sign=1), parameters={"mu": 1, "sign": 1}),
                  f"{SYSTEM}: p.sign is the sign of a mode, and a parameter"),
    # Events
    "leads nowhere": (with_event(to="stick"), f"{HITS}: leads to 'stick', which is none of the modes free"),
    "leads to 3": (with_event(to=3), f"{HITS}: to must be a function, not 3"),
    "no direction": (with_event(direction=None), f"{HITS}: direction = None: must be .1 .rising., -1 .falling. or 0"),
    "direction 2": (with_event(direction=2), f"{HITS}: direction = 2"),
    "direction True": (with_event(direction=True), f"{HITS}: direction = True"),
    "directions": (with_event(direction=np.array([1, -1])), f"{HITS}: direction = array"),
    "vector event": (with_event(function=lambda x, p: ca.vertcat(x.x, x.v)), f"{HITS}: function must return a scalar"),
    "constant event": (with_event(function=lambda x, p: p.mu), f"{HITS}: function does not change with any state"),
    "truth as event": (with_event(function=lambda x, p: x.x > 0), f"{HITS}: function does not change with any state"),
    "event name": (with_event(name=None), "mode 'free': the name of an event must be a text, not None"),
    "event twice": (lambda: system(Mode("free", van_der_pol, ends=(EVENT, EVENT))), f"{HITS}: .* need different names"),
    "reset": (with_event(reset=lambda x, p: {"w": 0}), f"{HITS}: reset speaks of w; the states are x, v"),
    "reset list": (with_event(reset=lambda x, p: [-x.v]), f"{HITS}: reset must return states by name"),
    # Names and numbers
    "parameter": (lambda: system(parameters={"mu": math.nan}), "parameter 'mu' = nan: must be a finite number"),
    "parameter text": (lambda: system(parameters={"mu": "1"}), "parameter 'mu' = '1': must be a finite number"),
    "parameter pairs": (lambda: system(parameters=[("mu", 1)]), f"{SYSTEM}: parameters must be a mapping"),
    "no name": (lambda: system(states=("x", "2v")), f"{SYSTEM}: '2v' among its states is no name"),
    "keyword": (lambda: system(parameters={"lambda": 1.0}), f"{SYSTEM}: 'lambda' among its parameters is no name"),
    "private": (lambda: system(states=("x", "_values")), f"{SYSTEM}: '_values' among its states is no name"),
    "states text": (lambda: system(states="xv"), rf"{SYSTEM}: states must be a tuple of names, such as \('x', 'v'\)"),
    "states twice": (lambda: system(states=("x", "x")), f"{SYSTEM}: one of its states stands there twice: x, x"),
    "title": (lambda: system(name=""), "the name of a system must be a text, not ''"),
    "angle": (lambda: system(angles=("theta",)), f"{SYSTEM}: the angle 'theta' is none of the states x, v"),
    "a jump": (lambda: system(symmetries=(np.diag([1, -0.8]),)), f"{SYSTEM}: a symmetry .* S S = 1; .* reset"),
    "ragged": (lambda: system(symmetries=([[1, 0], [1]],)), rf"{SYSTEM}: a symmetry .*\(2, 2\)"),
    "one matrix": (lambda: system(symmetries=np.diag([1, -1])), f"{SYSTEM}: symmetries must be a tuple of matrices"),
    # Forcing
    "forced twice": (lambda: system(states=("x", "t"), forcing_period=turn), f"{SYSTEM}: a forced system has its time"),
    "forcing number": (lambda: system(forcing_period=1.0), f"{SYSTEM}: forcing_period must be a function, not 1.0"),
    "forcing": (lambda: system(forcing_period=lambda p: 2 / p.w), f"{SYSTEM}: forcing_period: there is no .* 'w'"),
    "backwards": (lambda: system(forcing_period=lambda p: -p.mu), f"{SYSTEM}: forcing_period = -1: must be greater"),
}  # fmt: skip


MEETS: dict[str, Callable[[Any, Any], Any]] = {
    "|v|": lambda x, p: ca.fabs(x.v),
    "v sign v": lambda x, p: ca.sign(x.v) * x.v,
    "saturation": lambda x, p: ca.if_else(x.x > p.mu, p.mu, ca.if_else(x.x < -p.mu, -p.mu, x.x)),
    "dead band": lambda x, p: 1e5 * ca.if_else(ca.fabs(x.x) > 0.3, x.x - 0.3 * ca.sign(x.x), 0),
    "table": lambda x, p: ca.pw_lin(x.x, [0, 0.1, 0.3], [1, 1.2, 1.3]),
    "a direction with a least length": lambda x, p: x.x / ca.fmax(ca.fabs(x.x), 1e-6),
    "|x| by its root": lambda x, p: x.x / ca.sqrt(ca.fabs(x.x)) + x.v**2 / ca.fabs(x.v),
    "|x|, or a pole": lambda x, p: ca.fmin(1, 1 / ca.fabs(x.x)) + 1 / ca.fabs(x.v),
    "orifice": lambda x, p: ca.sign(x.x - x.v) * ca.sqrt(ca.fabs(x.x - x.v)),
    "orifice under pressure": lambda x, p: ca.if_else(x.x > 1e5, ca.sqrt(x.x - 1e5), -ca.sqrt(1e5 - x.x)),
    "contact": lambda x, p: 1e6 * ca.if_else(x.x > 0.1, (x.x - 0.1) ** 1.5, 0),
    "steep": lambda x, p: ca.if_else(x.x > 1, 1e9 * (x.x - 1), 0),
    "sine of an angle": lambda x, p: ca.sin(ca.atan2(x.v, x.x)) + ca.cos(ca.remainder(x.x, 2 * ca.pi)),
    "remainder of an angle": lambda x, p: ca.sin(ca.fmod(x.x, 2 * ca.pi)),
    "sign of another": lambda x, p: ca.copysign(x.v**2, x.v),
    "no division by zero": lambda x, p: ca.if_else(x.x == 0, 1, ca.sin(x.x) / x.x),
    "by a parameter": lambda x, p: ca.if_else(p.mu > 0.5, 1, -1) * x.x,
    "poles": lambda x, p: 1 / x.x + ca.tan(x.v) + ca.log(x.x**2) + 1 / ca.tan(x.x) + ca.sin(1e3 * x.v) / x.v,
    "both sides of a pole": lambda x, p: ca.atan(ca.tan(x.x) ** 2) + ca.exp(-1 / x.v**2) + 1 / (1 + ca.exp(1 / x.v**2)),
    "nearly a sign": lambda x, p: x.v / ca.sqrt(x.v**2 + 1e-12) + x.x * (x.x**2 + 1e-10) ** -0.5 + ca.tanh(1e8 * x.v),
    "beside a pole": lambda x, p: x.x / (x.x + p.mu) + x.x / (x.x**2 + x.v**2) ** 1.5 + (x.x**2 - 1) / (x.x - 1),
    "a power of a parameter": lambda x, p: ((1e8 + x.x) - 1e8) / (1 + x.v) + ca.fabs(x.x) ** p.mu,
    "tanh": lambda x, p: ca.if_else(ca.fabs(x.x) > 25, ca.sign(x.x), ca.tanh(x.x)),
}  # fmt: skip


@pytest.mark.parametrize("name", MEETS)
def test_parts_that_meet_may_stay_in_one_mode(name):
    assert v_is(MEETS[name])().states == ("x", "v")


def test_what_is_zero_but_for_rounding_does_not_jump():
    """(c (q v)/(c x)) x - q v: at some numbers it was refused, among a remedy's sizes, in a process that read it."""
    def slides(x, p):
        return {"x": x.v, "v": (p.c * (p.q * x.v) / (p.c * x.x)) * x.x - p.q * x.v}

    for q in 10 ** np.random.default_rng(1).uniform(-3, 1, 60):
        numbers = {"c": 7.3, "q": float(q)}
        made = System("slides", modes=(Mode("slides", slides),), states=("x", "v"), parameters=numbers)
        assert made.states == ("x", "v")


def test_what_is_asked_at_an_event_alone_may_jump():
    """Resets, conditions and features: a jump in them is passed by no motion of the mode."""
    hits = Event("hits", height, -1, to="free", reset=lambda x, p: {"v": -0.8 * x.v - ca.sign(x.v)})
    mode = Mode("free", van_der_pol, holds=lambda x, p: ca.sign(x.x), feature=lambda x, p: x.v > 0, ends=(hits,))
    assert system(mode).mode("free") == mode


def test_an_event_may_jump_where_it_is_not_zero():
    """Its zeros are where they are without."""
    assert with_event(function=lambda x, p: ca.if_else(x.v > 0, 2, 1) * x.x)().states == ("x", "v")


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_system_is_refused_in_one_sentence(name):
    define, sentence = BAD[name]
    with pytest.raises(InputError, match=f"^{sentence}") as refusal:
        define()
    assert "\n" not in str(refusal.value) and len(str(refusal.value)) < 330


STATES = {"x": 2.0, "v": 0.0}
WRONG_CALLS = {
    "missing": ({"x": 2.0}, {}, "oscillator: no value is given for the state v"),
    "unknown": (STATES | {"w": 0}, {}, "unknown state 'w'"),
    "timeless": (STATES | {"t": 0}, {}, "unknown state 't'"),
    "nan": ({"x": math.nan, "v": 0.0}, {}, "state x = nan: must be a finite number"),
    "mode": (STATES, {"mode": "stick"}, r"unknown mode 'stick' \(known: free\)"),
    "parameter": (STATES, {"parameters": {"nu": 1}}, "unknown parameter 'nu'; did you mean 'mu'"),
    "parameter nan": (STATES, {"parameters": {"mu": math.nan}}, "mu = nan: must be a finite number"),
    "tolerance": (STATES, {"tol": -1}, "tol = -1: must"),
}


@pytest.mark.parametrize("name", WRONG_CALLS)
def test_a_wrong_question_is_refused(name):
    states, how, sentence = WRONG_CALLS[name]
    for ask in (find_cycle, lambda *a, **k: simulate(*a, duration=1.0, **k)):
        with pytest.raises(InputError, match=f"^{sentence}"):
            ask(system(), **how, **states)
        with pytest.raises(InputError, match=f"^{sentence}"):
            ask(system(), **how, start=states)


def test_what_is_asked_of_one_alone():
    for duration in (0, -1.0, math.inf, "long"):
        with pytest.raises(InputError, match="^duration = "):
            simulate(system(), duration=duration, **STATES)
    with pytest.raises(InputError, match="^unknown parameter 'nu'"):
        find_cycle(system(), follow="nu", **STATES)
    with pytest.raises(InputError, match="^unknown state 'w'"):
        find_cycle(system(), measure="w", **STATES)


def test_a_successor_that_is_no_mode():
    """It is known when the event is met."""
    for there in ("stick", None):
        lost = with_event(to=lambda x, p, there=there: there)()
        with pytest.raises(InputError, match=rf"^{HITS}: leads to {there!r}, which is none of the modes free"):
            simulate(lost, duration=10.0, **STATES)


def test_a_turn_of_the_forcing_at_other_parameters():
    """The time at the start is in units of the turn that the forcing then takes."""
    forced = system(Mode("free", lambda x, p: {"x": x.v, "v": x.t}), forcing_period=turn)
    with pytest.raises(InputError, match="forcing_period = -3.14.*: must be greater than 0"):
        simulate(forced, duration=1.0, parameters={"mu": -2.0}, **STATES)
    motion = simulate(forced, duration=1.5, parameters={"mu": 4.0}, t=0.25, x=0.0, v=0.0)
    assert motion.end["t"] == pytest.approx(1.75, rel=1e-14)
    assert motion.end["v"] == pytest.approx((1.75**2 - 0.25**2) / 2, rel=1e-12)


def test_a_closure_that_does_not_close():
    """What a user's system cannot say, a cycle of the engine can, and is refused."""
    form = system(Mode("free", van_der_pol, ends=(EVENT,))).vector_form
    way_out = form.exits["free"][0]
    given = ("it", form.states, ("mu",), (Phase(form.modes["free"], way_out.event),))
    for repeats in (0, -1, True, 1.0):
        with pytest.raises(ValueError, match="repeats = "):
            Cycle(*given, closure=np.eye(2), repeats=repeats)
    with pytest.raises(ValueError, match="closure to the power 2 must be the identity; a jump is a phase's reset"):
        Cycle(*given, closure=np.diag([1.0, -0.8]), repeats=2)


# A system is data -----------------------------------------------------------------------------------------------------


def ball() -> System:
    bounce = Event("bounces", height, -1, to="flight", reset=turned_back)
    flight = Mode("flight", van_der_pol, holds=height, ends=(bounce,))
    return system(flight, forcing_period=turn, symmetries=(np.diag([1, -1]),), angles=("x",))


def test_equal_systems_are_equal():
    one, other = ball(), ball()
    assert one is not other and one == other and hash(one) == hash(other)
    others = (
        replace(one, name="another"),
        replace(one, parameters={"mu": 2.0}),
        replace(one, forcing_period=lambda p: p.mu),
        replace(one, symmetries=()),
        replace(one, angles=()),
        replace(one, modes=(replace(one.modes[0], slack=0.1),)),
    )
    assert len({one, other, *others}) == 7
    assert one != "oscillator"


def test_the_order_of_parameters_counts():
    """It is that of the vector p."""
    a, b = system(parameters={"mu": 1.0, "nu": 2.0}), system(parameters={"nu": 2.0, "mu": 1.0})
    assert a != b


def test_parameters_stay():
    given = {"mu": 1.0}
    it = system(parameters=given)
    given["mu"] = 3.0
    with pytest.raises(TypeError):
        it.parameters["mu"] = 2.0  # type: ignore[index]
    assert it.parameters == {"mu": 1.0} and it == system()


def test_systems_are_pickled():
    again = pickle.loads(pickle.dumps(ball()))
    assert again == ball() and hash(again) == hash(ball()) and again.vector_form is ball().vector_form


def test_equal_systems_have_equal_cycles():
    one, other = (find_cycle(system(), tol=1e-6, **STATES).cycle for _ in range(2))
    assert one == other and hash(one) == hash(other)
    assert find_cycle(system(name="another"), tol=1e-6, **STATES).cycle != one


def test_other_numbers_make_no_other_functions():
    calls = []

    def counted(x, p):
        calls.append(1)
        return van_der_pol(x, p)

    one = system(Mode("free", counted))
    other = one.with_numbers({"mu": 2.0})
    assert len(calls) == 1 and other == replace(one, parameters={"mu": 2.0}) and one.values().tolist() == [1.0]
    assert other.values().tolist() == [2.0] and len({one, other}) == 2
    for wrong in ({"nu": 2.0}, {"mu": np.nan}):
        with pytest.raises(InputError):
            one.with_numbers(wrong)


def test_a_system_is_changed_by_parts():
    assert replace(system(), parameters={"mu": 2.0}).values().tolist() == [2.0]
    assert system().values({"mu": 5}).tolist() == [5.0]
    np.testing.assert_array_equal(system().state({"v": 1, "x": 2}), [2.0, 1.0])


def thrown(x, p):
    return {"x": x.v, "v": -p.sign * p.g}


def fallen(x, t, p):
    return {"x": x.x + x.v * t - p.sign * p.g * t**2 / 2, "v": x.v - p.sign * p.g * t}


def far(x, p):
    return p.sign * x.x - p.far


def flipped(x, p):
    return {"v": x.v + p.sign * p.kick}


def beyond(x, p):
    return "right" if p.sign * x.x < 0 else "left"


def pulled(how: str) -> System:
    """A weight that is pulled to the right or to the left, and let go beyond p.far with a kick."""
    field, flow = (thrown, None) if how == "field" else (None, fallen)
    end = Event("far", far, -1, to=beyond, reset=flipped)
    return System("pulled", ("x", "v"), {"g": 2.0, "far": -3.0, "kick": 0.5},
                  (Mode("right", field, flow, sign=-1, ends=(replace(end),), holds=far, feature=far),
                   Mode("left", field, flow, sign=+1, ends=(end,), holds=far, feature=far)))  # fmt: skip


@pytest.mark.parametrize("how", ["field", "flow"])
def test_every_function_of_a_mode_sees_its_sign(how):
    """From rest at 0 a weight pulled with g is sqrt(2 d/g) later at the distance d; the other mode takes over."""
    system = pulled(how)
    motion = simulate(system, "left", x=0.0, v=0.0, duration=2.5, tol=1e-10)
    time, speed = math.sqrt(2 * 3 / 2), -math.sqrt(2 * 2 * 3)
    event = motion.events[0]
    assert event.time == pytest.approx(time, rel=1e-9) and event.mode == "left"
    assert event.behind == pytest.approx([-3.0, speed + 0.5], rel=1e-9)
    assert motion.phases[1].mode == "right"
    left = 2.5 - time
    assert motion.end["v"] == pytest.approx(speed + 0.5 + 2 * left, rel=1e-8)
    form = system.vector_form
    x, p = np.array([[1.0, -4.0], [0.0, 0.0]]), system.values()
    for name, sign in (("right", -1), ("left", 1)):
        mode = form.modes[name]
        assert mode.sign == sign
        assert mode.admissible(x, p, mode.sign) == pytest.approx(sign * x[0] + 3)
        assert mode.feature(x, p) == pytest.approx(sign * x[0] + 3)
    assert form.modes["left"].field == form.modes["right"].field  # compiled once


@pytest.mark.parametrize("points", [1, 2, 31, 32, 33, 100])
def test_a_scalar_at_any_number_of_points(points):
    form = system(Mode("free", van_der_pol, holds=lambda x, p: x.x - p.mu * x.v**2)).vector_form
    x = np.random.default_rng(points).standard_normal((2, points))
    values = form.modes["free"].admissible(x, np.array([0.7]), 0.0)
    assert values.shape == (points,) and values == pytest.approx(x[0] - 0.7 * x[1] ** 2, rel=1e-14)


def test_an_event_is_crossed_either_way():
    """x'' = -x from x = 1: zero at pi/2 + k pi, falling and rising; the cycle of an oscillator is met there too."""
    zero = Event("zero", height, 0, to="free")
    swing = system(Mode("free", lambda x, p: {"x": x.v, "v": -x.x}, ends=(zero,)))
    times = [crossing.time for crossing in simulate(swing, x=1.0, v=0.0, duration=8.0, tol=1e-10).events]
    assert times == pytest.approx([math.pi / 2, 3 * math.pi / 2, 5 * math.pi / 2], rel=1e-9)
    orbit = find_cycle(system(Mode("free", van_der_pol, ends=(zero,))), x=2.0, v=0.0)
    assert orbit.period == pytest.approx(6.6632868593231301897, rel=1e-8)
    assert orbit.repeats == 2 and orbit.signature == (("free", "zero"),)
    aside = Event("aside", lambda x, p: x.x - 0.3, 0, to="free")  # not symmetric: one way and the other in a period
    orbit = find_cycle(system(Mode("free", van_der_pol, ends=(aside,))), x=2.0, v=0.0)
    assert orbit.period == pytest.approx(6.6632868593231301897, rel=1e-8) and len(orbit.signature) == 2


def test_a_function_may_ask_whether_there_is_a_parameter():
    def damped(x, p):
        return {"x": x.v, "v": -x.x - (p.d * x.v if "d" in p else 0)}

    for d in (None, 0.1):
        one = system(Mode("free", damped), parameters={} if d is None else {"d": d})
        rate = math.exp(-(d or 0) * math.pi / 2)
        period = 2 * math.pi / math.sqrt(1 - (d or 0) ** 2 / 4)
        end = simulate(one, x=1.0, v=0.0, duration=period, tol=1e-10).end
        assert end["x"] == pytest.approx(rate ** (period / math.pi), rel=1e-8)


def test_a_function_is_called_with_symbols_once():
    calls = []

    def counted(x, p):
        calls.append(1)
        return van_der_pol(x, p)

    one = system(Mode("free", counted))
    find_cycle(one, x=2.0, v=0.0)
    assert len(calls) == 1
