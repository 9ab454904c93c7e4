"""The product of parts: the plain servo in every form of its controller, the limits of each part, what is refused."""

import math
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from peer_support import needs
from scipy import signal
from stick_map_support import border

from casahunt import InputError, NoOrbit, Options, Servo, Units, find_fold, find_orbit
from casahunt.continuation import follow, special_curve
from casahunt.motion import simulate
from casahunt.orbits import find_cycle, orbit_ensemble
from casahunt.servo.parts.cascade import P_PI, P_PI_FILTERED
from casahunt.servo.parts.dead_band import DEAD_BAND, ERROR_DEAD_BAND, HYSTERESIS
from casahunt.servo.parts.error_filter import ERROR_FILTER
from casahunt.servo.parts.feedforward import FEEDFORWARD
from casahunt.servo.parts.filtered_derivative import DERIVATIVE_FILTER, DERIVATIVE_FILTER_BY_N
from casahunt.servo.parts.filters import series
from casahunt.servo.parts.freeze import FREEZE
from casahunt.servo.parts.inertia import INERTIA
from casahunt.servo.parts.leak import LEAK
from casahunt.servo.parts.linear_controller import state_space
from casahunt.servo.parts.linear_forms import from_object, transfer_function
from casahunt.servo.parts.loads import LOADS
from casahunt.servo.parts.loop import Loop
from casahunt.servo.parts.lugre import LUGRE
from casahunt.servo.parts.part import Part
from casahunt.servo.parts.pid import INTEGRATOR, PID_BY_GAINS, PID_BY_TIMES
from casahunt.servo.parts.plain_loop import loop_of
from casahunt.servo.parts.reset import RESET_AT_CENTRE, RESET_AT_STOP, RESET_AT_ZERO
from casahunt.servo.parts.switch import BY_DIRECTION, LOAD_SWITCH, NO_FRICTION, SWITCH
from casahunt.servo.parts.table import remedy_of, with_remedy
from casahunt.servo.parts.torque_limit import BACK_CALCULATION, CLAMPING, TORQUE_LIMIT
from casahunt.servo.parts.two_masses import TWO_MASSES, TWO_MASSES_LOAD_SEEN
from casahunt.servo.parts.verbs import fold_in, loop_cycle
from casahunt.servo.parts.with_exponent import WITH_EXPONENT

PLAIN = (INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR)


@pytest.fixture(scope="module")
def plain():
    return find_orbit(Servo(), "switch", 0.04, options=Options(tol=1e-9))


def cycle_of(loop, **start):
    state = loop.state(x1=-0.05, **start)
    return find_cycle(loop.system, loop.mode_at(**state), start=state, follow="gain", tol=1e-9)


def same(orbit, other, tol=1e-9):
    return [orbit.period, orbit.amplitude] == pytest.approx([other.period, other.amplitude], rel=tol)


@pytest.mark.parametrize("controller", [PID_BY_TIMES, PID_BY_GAINS, P_PI])
def test_a_controller_in_each_of_its_forms(plain, controller):
    assert same(cycle_of(Loop((INERTIA, SWITCH, controller, INTEGRATOR))), plain)


def test_a_cascade_sums_what_its_filter_of_the_velocity_leaves():
    """m/e = K cm Kv (1 + 1/(Tn s)) (Kp + s/(1 + Tf s)), of one transfer function."""
    Kp, Kv, Tn, Tf = 5.0, 0.17, 0.12, 6e-3
    cascade = {"position_gain": Kp, "velocity_gain": Kv, "reset_time": Tn, "gain": 0.05}
    over = np.polymul([Tn, 0.0], [Tf, 1.0])
    above = Kv * np.polymul([Tn, 1.0], np.polyadd(Kp * np.array([Tf, 1.0]), [1.0, 0.0]))
    ours = cycle_of(Loop((INERTIA, SWITCH, P_PI_FILTERED, INTEGRATOR), {**cascade, "velocity_filter": Tf}))
    assert same(ours, cycle_of(Loop((INERTIA, SWITCH, transfer_function(above, over)), {"gain": 0.05})))
    assert not same(ours, cycle_of(Loop((INERTIA, SWITCH, P_PI, INTEGRATOR), cascade)), 1e-3)


@pytest.mark.parametrize(("part", "absent"), [
    (DEAD_BAND, 0.0), (HYSTERESIS, 0.0), (LEAK, 0.0), (FREEZE, math.inf), (RESET_AT_ZERO, 1.0), (RESET_AT_STOP, 1.0),
    (ERROR_FILTER, 0.0), (FEEDFORWARD, 0.0), (TORQUE_LIMIT, math.inf), (CLAMPING, math.inf),
    (DERIVATIVE_FILTER, 0.0), (DERIVATIVE_FILTER_BY_N, math.inf),
])  # fmt: skip
def test_a_part_of_size_zero_is_none(part, absent):
    """Not even its modes are left."""
    loop = Loop(PLAIN).with_parts(part)
    assert loop.value(part.size) == absent and loop.system == Loop(PLAIN).system


@pytest.mark.parametrize(("parts", "values", "tol"), [
    ((*PLAIN, LEAK), {"leak": 1e-9}, 1e-8),
    ((*PLAIN, RESET_AT_STOP), {"reset_at_stop": 1 - 1e-10}, 1e-9),
    ((*PLAIN, FEEDFORWARD), {"compensated": 1e-10}, 1e-8),
    ((*PLAIN, FREEZE), {"dwell": 5.0}, 1e-9),  # it sticks for 4.64 s
    ((*PLAIN, TORQUE_LIMIT), {"torque_limit": 0.6}, 1e-9),  # Fs = 0.53
    ((*PLAIN, CLAMPING), {"torque_limit": 0.6}, 1e-9),
    ((*PLAIN, BACK_CALCULATION), {"torque_limit": 0.6}, 1e-9),
    ((*PLAIN, LOADS), {"load_torque": 0.2}, 1e-9),  # the integrator absorbs it
    ((INERTIA, BY_DIRECTION, PID_BY_GAINS, INTEGRATOR), {}, 1e-9),
])  # fmt: skip
def test_limits_are_those_of_the_plain_servo(plain, parts, values, tol):
    assert same(cycle_of(Loop(parts, values)), plain, tol)


HALVES = {"inertia": 0.013, "load_inertia": 0.013, "shaft_damping": 1.0}


@pytest.mark.parametrize(("parts", "size", "values", "more"), [
    ((*PLAIN, DERIVATIVE_FILTER), "derivative_filter", (1e-5, 5e-6, 2.5e-6), {}),
    ((*PLAIN, ERROR_FILTER), "filter_time", (1e-5, 5e-6, 2.5e-6), {}),
    ((*PLAIN, series("low-pass")), "low_pass", (1e5, 2e5, 4e5), {}),
    pytest.param((TWO_MASSES, *PLAIN[1:]), "shaft_stiffness", (5e4, 1e5, 2e5, 4e5), HALVES, marks=pytest.mark.slow),
])  # fmt: skip
def test_a_filter_that_grows_fast_and_a_shaft_that_grows_stiff(plain, parts, size, values, more):
    """Extrapolated to none, in powers of the size or of its inverse."""
    rigid = {"load_angle": -0.05} if more else {}
    periods = np.array([cycle_of(Loop(parts, {size: value, **more}), **rigid).period for value in values])
    for power in range(1, len(values)):
        periods = (2**power * periods[1:] - periods[:-1]) / (2**power - 1)
    assert periods[0] == pytest.approx(plain.period, rel=1e-9)


@pytest.mark.parametrize("controller", [PID_BY_TIMES, P_PI])
def test_a_filtered_derivative_by_time_and_by_N_of_any_form(controller):
    """N = kd/(kp Tf), of Table 1 kd/kp = 1/(4 pi)."""
    by_time = cycle_of(Loop((*PLAIN, DERIVATIVE_FILTER), {"derivative_filter": 0.01}))
    parts = INERTIA, SWITCH, controller, INTEGRATOR, DERIVATIVE_FILTER_BY_N
    assert same(cycle_of(Loop(parts, {"derivative_n": 100 / (4 * math.pi)})), by_time)


def test_where_the_load_is_measured_the_cycle_is_another_one():
    """With a soft shaft; and it is one: by a motion of half the tolerance, once round."""
    loop = Loop((TWO_MASSES_LOAD_SEEN, *PLAIN[1:]), {"inertia": 0.013, "load_inertia": 0.013, "shaft_damping": 0.05})
    seen = cycle_of(loop, load_angle=-0.05)
    unseen = cycle_of(Loop((TWO_MASSES, *PLAIN[1:]), dict(loop.values)), load_angle=-0.05)
    assert seen.half and abs(seen.period / unseen.period - 1) > 1e-3


def test_friction_by_direction_has_no_symmetry():
    parts = INERTIA, BY_DIRECTION, PID_BY_GAINS, INTEGRATOR
    orbit = cycle_of(Loop(parts, {"static_back": 0.6, "coulomb_back": 0.46}))
    assert orbit.repeats == 1 and len(orbit.arcs) == 4 and orbit.stable
    mirrored = Loop(parts, {"static": 0.6, "coulomb": 0.46, "static_back": 0.53, "coulomb_back": 0.44})
    assert same(cycle_of(mirrored), orbit, 1e-8)


def test_a_transfer_function_is_its_controller(plain):
    """PID with a filtered derivative, by gains and as a polynomial, and by objects of other packages."""
    kp, ki, kd, Tf = 2.0, 2 * math.pi, 1 / (2 * math.pi), 1e-3
    by_gains = cycle_of(Loop((*PLAIN, DERIVATIVE_FILTER), {"derivative_filter": Tf}))
    num, den = [kd + kp * Tf, kp + ki * Tf, ki], [Tf, 1.0, 0.0]
    assert same(cycle_of(Loop((INERTIA, SWITCH, transfer_function(num, den)))), by_gains)
    given = signal.TransferFunction(num, den)
    for controller in (given, given.to_ss()):
        assert same(cycle_of(Loop((INERTIA, SWITCH, from_object(controller)))), by_gains, 1e-8)


def test_filters_in_series_are_the_product_of_their_polynomials(plain):
    """In another realisation: one transfer function; and a parameter of one can be followed."""
    kp, ki, kd, Tf, numbers = 2.0, 2 * math.pi, 1 / (2 * math.pi), 1e-2, {"notch_frequency": 60.0, "low_pass": 200.0}
    chain = Loop((*PLAIN, DERIVATIVE_FILTER, series("lead", "notch", "low-pass", "second-order low-pass")),
                 {"derivative_filter": Tf, "lead_zero": 40.0, **numbers})  # fmt: skip
    num, den = np.array([kd + kp * Tf, kp + ki * Tf, ki]), np.array([Tf, 1.0, 0.0])
    for over, under in (([1 / 40, 1], [1 / 100, 1]), ([1, 0.1 * 60, 3600], [1, 60, 3600]), ([1], [1 / 200, 1]),
                        ([1e4], [1, 140, 1e4])):  # fmt: skip
        num, den = np.polymul(num, over), np.polymul(den, under)
    orbit = cycle_of(chain)
    assert same(cycle_of(Loop((INERTIA, SWITCH, transfer_function(num, den)))), orbit, 1e-8)
    assert not same(orbit, plain, 1e-2)
    assert follow(orbit, "gain", to=0.05, max_points=9).values[-1] == pytest.approx(0.05)


def test_a_controller_of_python_control():
    control = needs("control")
    num, den = [0.16, 2.0, 6.3], [1e-3, 1.0, 0.0]
    assert from_object(control.TransferFunction(num, den)) is transfer_function(num, den)
    for sampled in (True, 0.01):
        with pytest.raises(InputError, match="is sampled"):
            from_object(control.TransferFunction(num, [1.0, 1.0, 0.0], sampled))
    with pytest.raises(InputError, match="several inputs or outputs"):
        from_object(control.StateSpace(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2))))


def test_bristles_as_a_part():
    servo, options = Servo(), Options(tol=1e-9)
    loop = loop_of(servo, "lugre", 0.04)
    orbit = cycle_of(loop)
    assert loop.parts[1] is LUGRE and same(orbit, find_orbit(servo, "lugre", 0.04, options=options), 1e-8)


@pytest.mark.parametrize("parts", [
    (*PLAIN, LEAK, DEAD_BAND),
    (TWO_MASSES, BY_DIRECTION, PID_BY_GAINS, DERIVATIVE_FILTER, INTEGRATOR, CLAMPING, RESET_AT_STOP),
    (*PLAIN, series("lead", "low-pass")), (INERTIA, LUGRE, transfer_function([0.16, 2.0, 6.3], [1e-3, 1.0, 0.0])),
])  # fmt: skip
def test_a_loop_can_be_sent_to_another_process(parts):
    """Its lambdas by where they stand: the system that comes back is equal, and shares what is compiled."""
    loop = Loop(parts, {part.size: 0.1 for part in parts if part.size})
    again = pickle.loads(pickle.dumps(loop))
    assert again.system == loop.system and again.system.vector_form == loop.system.vector_form
    assert again.parameters == loop.parameters and [part.name for part in again.parts] == [part.name for part in parts]


def test_a_part_that_nobody_finds_again_cannot_be_sent():
    with pytest.raises(pickle.PicklingError, match="the part 'leak' cannot be sent: it must be a global of a module"):
        pickle.dumps(Loop((*PLAIN, replace(LEAK)), {"leak": 0.1}))


def test_members_of_an_ensemble_are_those_of_other_processes():
    loop = Loop((*PLAIN, LEAK), {"leak": 0.1})
    orbit = cycle_of(loop)
    leaks = np.linspace(0.09, 0.12, 4)[:, None]
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        there, here = (orbit_ensemble(orbit, ["leak"], leaks, executor=how) for how in (executor, None))
    assert (there.periods == here.periods).all() and np.isfinite(here.periods).all()


@pytest.mark.slow
def test_the_border_in_two_parameters_is_that_of_the_stick_map():
    """Dead band against gain, from 0.04 to 0.3."""
    loop = Loop((*PLAIN, DEAD_BAND), {"dead_band": 0.01})
    fold = follow(cycle_of(loop), "dead_band", to=0.3, options=Options(tol=1e-7), max_points=40).special[0]
    curve = special_curve(fold, "dead_band", "gain", to=0.3)
    assert curve.values[-1, 1] == pytest.approx(0.3)
    size = curve.values[-1, 0]
    assert size == pytest.approx(border(0.3, "dead band", size, 1.001 * size, 1.8 * size), rel=1e-6)


@pytest.mark.parametrize(("parts", "values", "sentence"), [
    ((*PLAIN, DEAD_BAND, HYSTERESIS), {"dead_band": 0.01, "hysteresis": 0.01}, "both give the integrand"),
    ((*PLAIN, LEAK, LEAK), {"leak": 0.1}, "both give the leak"),
    (PLAIN, {"backlash": 0.1}, "unknown parameter 'backlash'"),
    ((INERTIA, PID_BY_GAINS, INTEGRATOR), {}, "no part of the loop gives the signal 'moving'"),
    ((*PLAIN, RESET_AT_CENTRE), {"reset": 0.5}, "reset does not go with these parts: none has the event 'centre'"),
    ((INERTIA, LUGRE, *PLAIN[2:], FREEZE), {"dwell": 0.5}, "freeze does not go .* none has the event 'breakaway"),
])  # fmt: skip
def test_parts_that_do_not_go_together(parts, values, sentence):
    with pytest.raises(InputError, match=sentence):
        Loop(parts, values).system  # noqa: B018


BACKWARDS = Part("controller of its own torque", gives={"error": lambda x, s, p: s.torque})
TWICE = Part("second integrator", ("x3",))


@pytest.mark.parametrize(("part", "values", "sentence"), [
    (FREEZE, {"dwell": -1.0}, r"dwell = -1: must be at least 1e-"),
    (FREEZE, {"dwell": 0.0}, r"dwell = 0: must be at least 1e-"),
    (ERROR_DEAD_BAND, {"remaining_gain": 1.5}, r"remaining_gain = 1.5: must be between 0 and 1 \(error dead band\)"),
    (DEAD_BAND, {"dead_band": -0.01}, r"dead_band = -0.01: must be at least 0 \(dead band\)"),
    (RESET_AT_STOP, {"reset_at_stop": 1.1}, r"reset_at_stop = 1.1: must be between -inf and 1"),
    (LEAK, {"leak": math.nan}, "leak"),
])  # fmt: skip
def test_values_out_of_range(part, values, sentence):
    with pytest.raises(InputError, match=sentence):
        Loop((*PLAIN, part), values)
    assert Loop((*PLAIN, LOADS), {"load_torque": -0.2}).value("load_torque") == -0.2  # what may have either sign


@pytest.mark.parametrize(("parts", "names"), [
    ((INERTIA, SWITCH, PID_BY_TIMES), ("inertia", "static", "stribeck_velocity", "integral_time")),
    ((TWO_MASSES, BY_DIRECTION, P_PI), ("load_inertia", "static_back", "reset_time")),
    ((TWO_MASSES_LOAD_SEEN, NO_FRICTION, LOAD_SWITCH, P_PI_FILTERED),
     ("load_static", "load_stribeck_velocity", "reset_time", "velocity_filter")),
    ((INERTIA, LUGRE, PID_BY_GAINS), ("static", "coulomb", "stiffness")),
    ((INERTIA, WITH_EXPONENT, PID_BY_GAINS), ("static", "stribeck_exponent")),
])  # fmt: skip
def test_what_something_is_divided_by_is_above_zero(parts, names):
    """F = m a has no solution at m = 0, a relative velocity none at v_s = 0, and so on: refused by name, at once."""
    loop = Loop((*parts, INTEGRATOR), units=Units("linear", "mm"))
    for name in names:
        with pytest.raises(InputError, match=f"^{name.replace('inertia', 'mass')} = 0: must be "):
            loop.replace(**{name: 0.0})


@pytest.mark.parametrize(("parts", "values", "sentence"), [
    ((INERTIA, SWITCH), {"static": 0.43}, r"^static = 0.43: must be at least 0.44 \(coulomb\)"),
    ((INERTIA, BY_DIRECTION), {"coulomb_back": 0.6}, r"^static_back = 0.53: must be at least 0.6 \(coulomb_back\)"),
    ((TWO_MASSES, SWITCH, LOAD_SWITCH), {"load_static": 0.4}, r"^load_static = 0.4: must be .* \(load_coulomb\)"),
])  # fmt: skip
def test_friction_that_holds_less_at_rest_than_it_takes_sliding_is_none(parts, values, sentence):
    with pytest.raises(InputError, match=sentence):
        Loop((*parts, PID_BY_GAINS, INTEGRATOR), values)


@pytest.mark.parametrize(("part", "sentence"), [
    (BACKWARDS, "the signals .*demand.* depend on each other without a state in between"),
    (TWICE, "integrator and second integrator do not go together: both have the state x3"),
])  # fmt: skip
def test_parts_that_contradict_each_other(part, sentence):
    with pytest.raises(InputError, match=sentence):
        Loop((*PLAIN, part)).system  # noqa: B018


def test_closed_forms_are_those_of_modes_that_only_integrate():
    """Found from the parts: while the plain servo sticks, and not with a leak; at a limit nothing breaks away."""
    flows = {mode.name: mode.flow is not None for mode in Loop(PLAIN).system.modes}
    assert flows == {"slip+": False, "slip-": False, "stick": True}
    leaking = Loop((*PLAIN, LEAK), {"leak": 0.1}).system
    assert not any(mode.flow for mode in leaking.modes)
    limited = Loop((*PLAIN, TORQUE_LIMIT), {"torque_limit": 0.6}).system.mode("stick, at upper limit")
    assert [event.name for event in limited.ends] == ["leaves upper limit"]


def test_a_motion_begins_in_the_mode_of_its_state():
    loop = Loop((*PLAIN, DEAD_BAND), {"dead_band": 0.01})
    starts = {"slip+": {"x2": 0.1}, "slip-": {"x2": -0.1}, "stick": {}}
    for band, x1 in (("", 0.02), (", inside", 0.005)):
        for mode, start in starts.items():
            assert loop.mode_at(**loop.state(x1=x1, **start)) == mode + band
    assert loop.mode_at(**loop.state(x1=-1.0)) == "slip+" and loop.mode_at(**loop.state(x1=1.0)) == "slip-"


@pytest.mark.parametrize(("make", "sentence"), [
    (lambda: transfer_function([1, 0, 0], [1, 1]), "improper"),
    (lambda: transfer_function([0], [1]), "must each have a coefficient"),
    (lambda: state_space(np.eye(2), [1], [1], [0]), "state space"),
    (lambda: state_space(np.eye(9), np.ones(9), np.ones(9), [0]), "at most 8"),
    (lambda: from_object(3.0), "float is no TransferFunction.*transfer_function"),
    (lambda: series("notch", "lowpass"), "unknown filter 'lowpass'.*low-pass"),
    (lambda: series("notch", "lead", "notch"), "'notch' twice"),
    (lambda: series(), "must have a filter: lead, notch"),
    (lambda: transfer_function([1.0, math.nan], [1.0, 0.0]), "finite number"),
    (lambda: from_object(SimpleNamespace(num=[[2.0, 6.28]], den=[[1.0, 0.0]])), "SimpleNamespace is no Transfer"),
    (lambda: from_object(SimpleNamespace(A=0, B=1, C=1, D=2, dt=0.01)), "SimpleNamespace is no Transfer"),
    (lambda: from_object(signal.TransferFunction([1.0], [1.0, 1.0], dt=0.01)), "is sampled"),
    (lambda: from_object(signal.StateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]], dt=True)), "is sampled"),
    (lambda: from_object(signal.TransferFunction([[2.0, 6.28], [1.0, 0.0]], [1.0, 0.0])), "several"),
    (lambda: from_object(signal.StateSpace(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)))), "several"),
    (lambda: from_object(signal.ZerosPolesGain([-1.0], [0.0], 2.0)), "is no TransferFunction or StateSpace"),
])  # fmt: skip
def test_controllers_that_are_none(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_a_slip_that_creeps_to_rest_is_followed_to_its_end():
    """With little integral action x decays like exp(-ki t/kp), and v with it, until rounding makes its sign."""
    loop = loop_of(Servo(), "switch", 0.1).replace(ki=0.05630083143549496)
    start = loop.state(x1=-0.015176674711052647)
    motion = simulate(loop.system, "stick", start=start, duration=1416.9523223606943, tol=1e-8)
    assert sum(phase.count for phase in motion.phases) < 2000
    assert abs(motion.end["x1"]) < 1e-11


def test_a_fold_in_another_parameter_is_that_in_the_gain():
    """At the static friction at which hunting ends, the gain is that of the servo's own fold."""
    cycle = loop_cycle(Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.1}), "static")
    found = fold_in(cycle, "static", sense=-1)
    assert find_fold(Servo().replace(**{"friction.static": found.value}), "switch").gain == pytest.approx(0.1, rel=1e-8)


def test_where_hunting_ends_nowhere_its_fold_is_looked_for_in_six_decades():
    """Too much of a feedforward makes the friction of a slip negative: it hunts with any gain."""
    plain = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.04})
    loop = with_remedy(plain, remedy_of("feedforward", "switch"), 0.5)
    with pytest.raises(NoOrbit, match="no largest gain .* 0.04 and 40000: .* no smallest .* 0.04 and 4e-08: "):
        find_fold(loop)


@pytest.mark.parametrize("model", ["switch", "lugre"])
@pytest.mark.parametrize("part", [None, FREEZE, DEAD_BAND, HYSTERESIS, RESET_AT_ZERO, TORQUE_LIMIT, FEEDFORWARD])
def test_a_step_either_way_is_its_mirror_image(model, part):
    loop = loop_of(Servo(), model, 0.1)
    loop = loop if part is None else loop.with_parts(part)
    assert loop.ways == (1.0,) and loop.carrying == {}
    assert loop.with_parts(LOADS, load_torque=0.01).ways == (1.0, -1.0)


def test_friction_by_direction_has_no_mirror_image():
    loop = Loop((INERTIA, BY_DIRECTION, PID_BY_TIMES, INTEGRATOR))
    same = {f"{name}_back": loop.value(name) for name in ("static", "coulomb", "viscous")}
    assert loop.replace(**same).ways == (1.0,)
    for name, value in same.items():
        assert loop.replace(**(same | {name: 1.01 * value})).ways == (1.0, -1.0)
