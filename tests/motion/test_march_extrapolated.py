"""Motions without a mesh, against exact solutions and against the march that has one."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from casahunt.hybrid import Event, Mode, System
from casahunt.hybrid.examples import belt
from casahunt.motion import MarchFailure, march
from casahunt.motion.extrapolated_steps import steps_of

RESTS = Mode("rests", lambda x, p: {"x": 0.0})


def followed(system: System, mode: str, x: list[float], many: int, **how):
    """The first phases without a mesh, or with one."""
    seen: list[object] = []

    def until(segment) -> bool:
        seen.append(segment)
        return len(seen) == many

    p, how = system.values(None), {"strict": True, "tol": 1e-8} | how
    return march(system.vector_form, mode, np.array(x, float), p, scale=np.ones(len(x)), until=until, **how)


def bouncing(g: float = 9.81, e: float = 0.7) -> System:
    """A ball that loses speed at the ground."""
    lands = Event("lands", lambda x, p: x.y, -1, to="flies", reset=lambda x, p: {"v": -e * x.v})
    return System("ball", ("y", "v"), {"g": g},
                  (Mode("flies", lambda x, p: {"y": x.v, "v": -p.g}, ends=(lands,)),))  # fmt: skip


def test_landings_of_a_ball():
    """From rest at 1 m: sqrt(2/g), then 2 e^k sqrt(2/g)."""
    phases = followed(bouncing(), "flies", [1.0, 0.0], 6, meshed=False)
    fall = np.sqrt(2 / 9.81)
    assert [p.duration for p in phases] == pytest.approx([fall, *(2 * 0.7**k * fall for k in range(1, 6))], rel=1e-9)
    assert all(p.w.shape[1] == 2 and p.event == "lands" for p in phases)  # no stages


def test_modes_that_differ_in_signs_share_what_is_compiled():
    """x' = s x to s x = e^s, s = 1 and -1 in turn: from 1/e to e and back, two seconds each."""
    field, ways = (lambda x, p: {"x": p.sign * x.x}), [("grows", 1, "decays"), ("decays", -1, "grows")]
    signed, plain = (lambda x, p: p.sign * (ca.log(x.x) - p.sign)), (lambda x, p: ca.log(x.x) - p.sign)
    for function, both_rise in ((signed, True), (plain, False)):
        modes = [
            Mode(name, field, sign=sign, ends=(Event("turns", function, 1 if both_rise else sign, to),))
            for name, sign, to in ways
        ]
        system = System("wave", ("x",), {"a": 1.0}, tuple(modes))
        phases, form = followed(system, "grows", [np.exp(-1.0)], 5, meshed=False), system.vector_form
        assert [phase.duration for phase in phases] == pytest.approx([2.0] * 5, rel=1e-9)
        compiled = [steps_of(form.modes[name], form.exits[name], 1, 1, False) for name, _, _ in ways]
        assert compiled[0] is compiled[1]


@pytest.mark.parametrize("short", [1e-2, 1e-5, 1e-8])
def test_an_event_that_is_passed_and_passed_back_within_a_step(short):
    """x = sin t comes to 1 - d at arcsin(1 - d), and leaves it again as soon after as it came before pi/2."""
    ends = (Event("high", lambda x, p: x.x - (1 - p.d), +1, to="above"),)
    field = lambda x, p: {"x": x.v, "v": -x.x}  # noqa: E731
    back = (Event("low", lambda x, p: x.x - (1 - p.d), -1, to="below"),)
    system = System("two zeros", ("x", "v"), {"d": short},
                    (Mode("below", field, ends=ends), Mode("above", field, ends=back)))  # fmt: skip
    below, above = followed(system, "below", [0.0, 1.0], 2, meshed=False)
    reached = np.arcsin(1 - short)
    assert below.duration == pytest.approx(reached, abs=1e-9 / np.sqrt(short) * 1e-1 + 1e-9)
    assert above.duration == pytest.approx(2 * (np.pi / 2 - reached), abs=1e-9 / np.sqrt(short) + 1e-9)


def test_slip_and_stick_agree_with_the_march_that_has_a_mesh():
    plain, other = (followed(belt, "slip", [0.0, 0.0], 8, meshed=meshed) for meshed in (False, True))
    assert [(p.mode, p.event) for p in plain] == [(p.mode, p.event) for p in other]
    assert [p.duration for p in plain] == pytest.approx([p.duration for p in other], rel=1e-8)


def test_a_slip_that_begins_on_its_own_event_is_left_to_its_side():
    """v = a (t - t^2): it begins at v = 0, on the event at which it ends, and ends at t = 1."""
    stops = Event("stops", lambda x, p: x.v, -1, to="stands")
    system = System("slip", ("v", "t"), {"a": 1e-3},
                    (Mode("slips", lambda x, p: {"v": p.a * (1 - 2 * x.t), "t": 1.0}, ends=(stops,)),
                     Mode("stands", lambda x, p: {"v": 0.0, "t": 1.0})))  # fmt: skip
    (slip,) = followed(system, "slips", [0.0, 0.0], 1, meshed=False)
    assert slip.duration == pytest.approx(1.0, rel=1e-9)


def slaved(stiff: bool) -> System:
    """x' = -1e5 (x - cos t) up to x = 1/2: next to t = pi/3."""
    ends = (Event("half", lambda x, p: x.x - 0.5, -1, to="rests"),)
    field = lambda x, p: {"x": -p.k * (x.x - ca.cos(x.t)), "t": 1.0}  # noqa: E731
    rests = Mode("rests", lambda x, p: {"x": 0.0, "t": 1.0})
    return System("stiff", ("x", "t"), {"k": 1e5}, (Mode("slaved", field, ends=ends, stiff=stiff), rests))


@pytest.mark.parametrize("stiff", [True, False])
def test_a_stiff_mode_takes_few_steps_whether_it_says_so_or_not(stiff):
    """x = cos t + sin(t)/k but for terms of k^-2: it is 1/2 at pi/3 + 1/k."""
    (phase,) = followed(slaved(stiff), "slaved", [1.0, 0.0], 1, meshed=False)
    assert phase.w.shape[1] == 2 and len(phase.w) < 100  # no stages
    assert phase.duration == pytest.approx(np.pi / 3 + 1e-5, abs=2e-10)


def test_implicit_steps_follow_a_fast_relaxation_exactly():
    """x' = -k (x - t), y' = x from x = y = 0: x = t - (1 - exp(-k t))/k, and y its integral, up to y = 1/4."""
    ends = (Event("quarter", lambda x, p: x.y - 0.25, +1, to="rests"),)
    system = System("relaxes", ("x", "t", "y"), {"k": 1e3},
                    (Mode("goes", lambda x, p: {"x": -p.k * (x.x - x.t), "t": 1.0, "y": x.x}, ends=ends, stiff=True),
                     Mode("rests", lambda x, p: {"x": 0.0, "t": 0.0, "y": 0.0})))  # fmt: skip
    (phase,) = followed(system, "goes", [0.0, 0.0, 0.0], 1, meshed=False, tol=1e-7)
    t = phase.breaks * phase.duration
    x = t - (1 - np.exp(-1e3 * t)) / 1e3
    y = t**2 / 2 - t / 1e3 + (1 - np.exp(-1e3 * t)) / 1e6
    assert phase.w.shape[1] == 3 and len(phase.w) < 60
    assert np.abs(phase.nodes - np.stack([x, t, y], axis=1)).max() < 1e-8
    assert phase.nodes[-1, 2] == pytest.approx(0.25, abs=1e-12)


def test_a_ringing_that_has_died_out_is_not_kept_alive():
    """x" = -w^2 x - 2 d w x' from x = 1, beside y' = -y/1000, up to y = 1e-3: behind that steps are as long as y lets
    them be, for their ends are exact."""
    w, d = 200.0, 0.2
    ends = (Event("low", lambda x, p: x.y - 1e-3, -1, to="rests"),)
    field = lambda x, p: {"x": w * x.v, "v": -w * x.x - 2 * d * w * x.v, "y": -x.y / 1e3}  # noqa: E731
    rests = Mode("rests", lambda x, p: {"x": 0.0, "v": 0.0, "y": 0.0})
    system = System("rings", ("x", "v", "y"), {}, (Mode("goes", field, ends=ends), rests))
    (phase,) = followed(system, "goes", [1.0, 0.0, 1.0], 1, meshed=False, tol=1e-7)
    t, damped = phase.breaks * phase.duration, w * np.sqrt(1 - d * d)
    x = np.exp(-d * w * t) * (np.cos(damped * t) + d * w / damped * np.sin(damped * t))
    assert phase.w.shape[1] == 3 and len(phase.w) < 600
    assert phase.duration == pytest.approx(1e3 * np.log(1e3), rel=1e-12)
    assert np.abs(phase.nodes[:, 0] - x).max() < 1e-8
    late = t > 10.0  # by then 1e-18 is left
    assert np.abs(phase.nodes[late, 0]).max() < 1e-12 and np.abs(phase.nodes[:, 2] - np.exp(-t / 1e3)).max() < 1e-10


def test_a_step_that_ends_at_no_number_is_not_taken_and_a_shorter_one_is():
    """x' = -sqrt(x) from x = 1/1000, by 1 s, after which it would be less than nothing: x = (sqrt(1/1000) - t/2)^2."""
    ends = (Event("late", lambda x, p: x.t - 1e3, +1, to="goes", reset=lambda x, p: {"t": 0.0}),)
    mode = Mode("goes", lambda x, p: {"x": -ca.sqrt(x.x), "t": 1.0}, ends=ends)
    form = System("drains", ("x", "t"), {}, (mode,)).vector_form
    many = steps_of(form.modes["goes"], form.exits["goes"], 2, 0, False)[0].buffers
    given = [1e-3, 0.0], (0.0, 1.0, 10.0, 1e-9, 0.0), 1, [], [1.0, 1.0], [1]
    for store, value in zip(many.inputs, given, strict=True):
        store[:] = value
    many.trigger()
    x, t = many.outputs[0][many.outputs[0][:, 4] > 0, :2].T
    assert t.size > 5 and x == pytest.approx((np.sqrt(1e-3) - t / 2) ** 2, abs=1e-8)


def test_what_rings_for_long_is_no_stiff_mode():
    """x = sin t beside t, up to t = 150: more steps than a slip has, and each of them needed."""
    ends = (Event("half", lambda x, p: x.t - 150, +1, to="rests"),)
    system = System("ring", ("x", "v", "t"), {},
                    (Mode("rings", lambda x, p: {"x": x.v, "v": -x.x, "t": 1.0}, ends=ends),
                     Mode("rests", lambda x, p: {"x": 0.0, "v": 0.0, "t": 1.0})))  # fmt: skip
    (phase,) = followed(system, "rings", [0.0, 1.0, 0.0], 1, meshed=False)
    assert phase.w.shape[1] == 3 and len(phase.w) > 160  # no stages
    assert phase.end == pytest.approx([np.sin(150), np.cos(150), 150], abs=1e-7)


def test_an_event_that_leads_back_into_its_mode_ends_no_phase():
    half = Event("half", lambda x, p: x.x - 0.5, +1, to=lambda x, p: "goes" if p.k > 0 else "rests")
    ends = half, Event("whole", lambda x, p: x.x - 1, +1, to="rests")
    system = System("grazed", ("x",), {"k": 1.0},
                    (Mode("goes", lambda x, p: {"x": p.k}, ends=ends), RESTS))  # fmt: skip
    (phase,) = followed(system, "goes", [0.0], 1, meshed=False)
    assert phase.event == "whole" and phase.duration == pytest.approx(1.0, rel=1e-12)


def test_an_event_that_is_no_number_on_the_way_to_its_zero_is_left_to_others():
    """(x - 3)^3 with a part that counts for nothing and has no value from 3.05 to 4.5: a step leads beyond."""
    nothing = lambda x, p: p.k * ca.sqrt((x.x - 3.05) * (x.x - 4.5))  # noqa: E731
    ends = (Event("three", lambda x, p: (x.x - 3) ** 3 + nothing(x, p), +1, to="rests"),)
    system = System("no number", ("x",), {"k": 0.0},
                    (Mode("goes", lambda x, p: {"x": 1.0}, ends=ends), RESTS))  # fmt: skip
    try:
        (phase,) = followed(system, "goes", [-5.0], 1, meshed=False)
    except MarchFailure:
        return
    assert phase.duration == pytest.approx(8.0, abs=1e-3)


def test_rounding_of_the_state_with_which_a_slip_begins_does_not_end_it():
    """v' = t - t^2 - 1e-13 from 1e-27: forwards by less than rounding, back by as much, and forwards for 3/2."""
    stops = Event("stops", lambda x, p: x.v, -1, to="stands")
    system = System("slip", ("v", "t"), {"less": 1e-13},
                    (Mode("slips", lambda x, p: {"v": x.t - x.t**2 - p.less, "t": 1.0}, ends=(stops,)),
                     Mode("stands", lambda x, p: {"v": 0.0, "t": 1.0})))  # fmt: skip
    (slip,) = followed(system, "slips", [1e-27, 0.0], 1, meshed=False, strict=False)
    assert slip.duration == pytest.approx(1.5, rel=1e-9)


def test_an_event_of_a_state_that_is_rounding_itself_is_located_in_its_own_units():
    """x = 1e-14 (exp t - e) passes zero at 1, and not wherever it is as small."""
    ends = (Event("passes", lambda x, p: x.x, +1, to="rests"),)
    system = System("small", ("x", "y"), {"k": 1e-14},
                    (Mode("goes", lambda x, p: {"x": p.k * x.y, "y": x.y}, ends=ends),
                     Mode("rests", lambda x, p: {"x": 0.0, "y": 0.0})))  # fmt: skip
    (phase,) = followed(system, "goes", [1e-14 * (1 - np.e), 1.0], 1, meshed=False, strict=False)
    assert phase.duration == pytest.approx(1.0, rel=1e-8)


def test_on_one_event_another_one_is_met_at_once():
    """v = -7e-7 + 300 t turns at 7e-7/300; x begins at zero, on an event of its own."""
    ends = Event("x", lambda x, p: x.x, +1, to="rests"), Event("v", lambda x, p: x.v, +1, to="rests")
    system = System("two", ("x", "v"), {"a": 300.0},
                    (Mode("goes", lambda x, p: {"x": x.v, "v": p.a}, ends=ends),
                     Mode("rests", lambda x, p: {"x": 0.0, "v": 0.0})))  # fmt: skip
    (phase,) = followed(system, "goes", [0.0, -7e-7], 1, meshed=False, strict=False)
    assert phase.event == "v" and phase.duration == pytest.approx(7e-7 / 300, rel=1e-9)


@pytest.mark.parametrize("drop, width, start", [(1, 3e-3, 1.0), (3, 3e-3, 0.5), (0.3, 1e-3, 1.0), (10, 1e-3, 0.5)])
def test_a_drop_of_friction_next_to_its_stop_is_not_stepped_over(drop, width, start):
    """v' = -1 - b exp(-(v/w)^2) from v0 to 0: the integral of 1/(1 + b exp(-(v/w)^2)), far from 0 that of 1."""
    near = lambda x, p: ca.exp(-((x.v / p.w) ** 2))  # noqa: E731
    ends = (Event("stops", lambda x, p: x.v, -1, to="rests"),)
    slips = Mode("slips", lambda x, p: {"v": -1 - p.b * near(x, p), "y": -x.y}, ends=ends, feature=near)
    rests = Mode("rests", lambda x, p: {"v": 0.0, "y": 0.0})
    system = System("drop", ("v", "y"), {"b": float(drop), "w": width}, (slips, rests))
    (slip,) = followed(system, "slips", [start, 1.0], 1, meshed=False, tol=1e-7)
    u, weights = np.polynomial.legendre.leggauss(200)
    u = 4 * (u + 1)  # v = w u, up to 8 w
    duration = start - 8 * width + width * 4 * np.sum(weights / (1 + drop * np.exp(-(u**2))))
    assert slip.duration == pytest.approx(duration, rel=1e-7)
