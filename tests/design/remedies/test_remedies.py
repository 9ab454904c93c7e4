"""The smallest sizes that end hunting, against an independent stick map, and what the rows say."""

import math
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache

import pytest
from peer_support import needs
from stick_map_support import border, stick_map

from casahunt import (
    Friction,
    InputError,
    NoOrbit,
    Options,
    Pid,
    Servo,
    Uncertainty,
    find_fold,
    find_orbit,
    margins,
    remedies,
)
from casahunt.design.remedies import remedies as module
from casahunt.design.remedies.border import MOTIONS_KNOW
from casahunt.design.remedies.cures import Cure
from casahunt.design.remedies.price import task
from casahunt.servo.outcome import SETTLES
from casahunt.servo.parts.fate import Swing
from casahunt.servo.parts.loads import LOADS
from casahunt.servo.parts.plain_loop import loop_of
from casahunt.servo.parts.table import remedy_of, with_remedy
from casahunt.views.commands.remedies import Table, advice_of


@cache
def row(name, gain, **how):
    return remedies(Servo(), "switch", gain, only=[name], **how).remedies[0]


@pytest.mark.parametrize(("name", "gain", "low", "high"), [
    ("dead band", 0.3, 1.001, 1.8),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("dead band", 0.04, 1.001, 1.4), ("dead band", 0.1, 1.001, 1.8),
        ("shifted dead band", 0.04, 1.001, 1.5), ("shifted dead band", 0.1, 1.001, 1.8),
    )),
])  # fmt: skip
def test_bands(name, gain, low, high):
    """The stable and the unstable cycle, both wider than the band, merge."""
    found = row(name, gain)
    truth = border(gain, name, found.size, low * found.size, high * found.size)
    assert found.kind == "fold" and found.size == pytest.approx(truth, rel=1e-8)
    assert abs(found.size - truth) < 3 * found.size_error + 1e-10 * truth  # the map's own error
    assert found.rest_error == found.size and found.ends_hunting


@pytest.mark.parametrize(("name", "gain", "low", "high"), [
    ("leak", 0.1, 0.003, 0.02),
    ("reset", 0.64, 1.2e-3, 2.2e-3),  # 1 % below the fold of the servo, where very little ends it
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("leak", 0.64, 1.2e-3, 2.2e-3),
        ("leak", 0.04, 0.02, 0.04), ("leak", 0.3, 3.815e-3, 4.1e-3), ("reset", 0.04, 5e-4, 0.01),
        ("reset", 0.1, 1e-4, 5e-3),
    )),
])  # fmt: skip
def test_integrators_that_forget(name, gain, low, high):
    found = row(name, gain)
    truth = border(gain, name, found.size, low, high)
    assert found.kind == "fold" and found.size == pytest.approx(truth, rel=2e-10) and found.ends_hunting


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.04, 0.1])
def test_hysteresis_ends_where_the_cycle_stops_on_its_edge(gain):
    """P(delta) = delta: a stop within the band is not left any more."""
    found = row("hysteresis", gain)
    scipy_optimize = pytest.importorskip("scipy.optimize")
    truth = scipy_optimize.brentq(
        lambda size: stick_map(size, gain, "hysteresis", size) - size, 0.999 * found.size, 1.001 * found.size
    )
    assert found.size == pytest.approx(truth, rel=1e-8)


def test_the_published_figures_of_two_remedies():
    """By independent event maps: a dead band of 0.0433457242337 rad, a leak of 0.246844841 1/s."""
    assert row("dead band", 0.04).size == pytest.approx(0.0433457242337, rel=1e-9)
    assert row("leak", 0.04).size == pytest.approx(0.246844841, rel=2e-9)


def test_more_gain_is_the_fold_of_the_servo():
    found = row("gain", 0.04)
    assert found.size == pytest.approx(find_fold(Servo(), "switch", options=Options(tol=1e-9)).gain, rel=1e-9)
    assert found.rest_error == 0


@pytest.mark.slow
def test_freezing_must_come_before_the_servo_breaks_away():
    """The dwell is the time for which the plain cycle sticks."""
    orbit = find_orbit(Servo(), "switch", 0.04, options=Options(tol=1e-9))
    stuck = next(arc for arc in orbit.arcs if arc.mode == "stick")
    assert row("freeze", 0.04).size == pytest.approx(stuck.duration, rel=1e-6)


@pytest.mark.parametrize("name", ["feedforward", "error dead band", "reset at a stop", "error filter"])
def test_what_does_not_end_hunting_says_why(name):
    found = row(name, 0.04)
    assert not found.ends_hunting and (found.why or "growing" in found.stays)
    assert ("goes on down to -0.9" in found.why) is (name == "reset at a stop")  # factors become smaller


@pytest.mark.slow
def test_demands_and_the_cheapest():
    table = remedies(Servo(), "switch", 0.04, only=["dead band", "leak", "gain"])
    assert table.best and [r.name for r in table.remedies][0] == table.best
    assert remedies(Servo(), "switch", 0.04, only=["dead band", "gain"], max_error=0.01).best == "gain"
    # 0.0433 rad just ends it, and 0.0477 would be chosen
    assert remedies(Servo(), "switch", 0.04, only=["dead band", "gain"], max_error=0.045).best == "gain"
    assert remedies(Servo(), "switch", 0.04, only=["dead band", "gain"], max_error=0.01, max_torque=5).best == ""


def test_a_remedy_at_whose_larger_sizes_the_servo_hunts_again_is_named_last():
    cheapest = module.cheapest
    again = Cure("leak", "1/s", "fold", 1.0, recommended_rest_error=0.0, peak_torque=1.0, stays=("at rest", "hunting"))
    kept = replace(again, name="gain", peak_torque=2.0, stays=("at rest", "decaying"))
    assert cheapest([again, kept], None, math.inf, of_a_set=False) == "gain"
    assert cheapest([again, kept], None, 1.5, of_a_set=False) == "leak"
    assert cheapest([again, kept], None, math.inf, of_a_set=True) == "gain"
    assert cheapest([replace(again, worst_size=1.2), kept], None, math.inf, of_a_set=True) == "leak"


@pytest.mark.slow
def test_the_worst_servo_of_a_set_needs_more():
    found = row("dead band", 0.04, uncertainty=Uncertainty({"friction.static": (0.52, 0.54)}))
    other = remedies(Servo().replace(**{"friction.static": 0.54}), "switch", 0.04, only=["dead band"]).remedies[0]
    assert found.worst_size == pytest.approx(other.size, rel=1e-8) and found.worst_size > found.size


def test_what_is_recommended_is_more_than_the_worst_servo_needs():
    found = row("dead band", 0.04, uncertainty=Uncertainty({"friction.static": (0.52, 0.54)}), margin=0.2)
    assert found.recommended == pytest.approx(1.2 * found.worst_size, rel=1e-12) and found.worst_size > found.size
    assert found.recommended_rest_error == found.recommended and found.keeps_it_ended


def test_demands_hold_where_a_servo_of_the_set_rests_farthest_away():
    """Stuck with a leak, friction holds (kp + ki/leak) |x1| <= Fs: more where Fs is more."""
    set_ = Uncertainty({"friction.static": (0.51, 0.54)})
    found, alone = row("leak", 0.04, uncertainty=set_), row("leak", 0.04)
    kp, _, ki = Servo().torque_gains(0.04)
    farthest = 0.54 / (kp + ki / found.recommended)
    assert found.recommended_rest_error == pytest.approx(farthest, rel=1e-12)
    assert max(x1 for x1, _ in found.rests) == pytest.approx(farthest, rel=1e-12)
    assert alone.recommended_rest_error == pytest.approx(0.53 / (kp + ki / alone.recommended), rel=1e-12)


@pytest.mark.slow
def test_the_servo_as_given_is_one_of_its_set():
    """Both ends of its Stribeck velocity need a smaller dead band, 0.01017 and 0.0103 rad, than it does, 0.01041."""
    friction = Friction(static=0.22, coulomb=0.16, stribeck_velocity=0.02, viscous=0.004)
    servo = Servo(inertia=0.004, motor_gain=1.8, controller=Pid(kp=2, ki=12, kd=0.06), friction=friction)
    ends = Uncertainty({"friction.stribeck_velocity": (0.005, 0.08)})
    found = remedies(servo, "switch", 1.0, only=["dead band"], uncertainty=ends).remedies[0]
    for end in (0.005, 0.08):
        other = servo.replace(**{"friction.stribeck_velocity": end})
        assert found.size > remedies(other, "switch", 1.0, only=["dead band"]).remedies[0].size
    assert found.worst_size == found.size and found.recommended == pytest.approx(1.1 * found.size, rel=1e-12)


@pytest.mark.slow
def test_without_slopes_motions_of_all_corners_tell_what_the_worst_servo_needs():
    """A dwell must be shorter than the shortest stick, which is that of the servo that hunts up to the largest gain."""
    box = {"friction.static": (0.53, 0.54), "friction.coulomb": (0.43, 0.44), "friction.viscous": (0.09, 0.11)}
    found = row("freeze", 0.04, uncertainty=Uncertainty(box))
    worst = {"friction.static": 0.54, "friction.coulomb": 0.43, "friction.viscous": 0.09}
    orbit = find_orbit(Servo().replace(**worst), "switch", 0.04, options=Options(tol=1e-9))
    stuck = next(arc.duration for arc in orbit.arcs if arc.mode == "stick")
    assert found.worst_size == pytest.approx(stuck, rel=2 * MOTIONS_KNOW) and found.worst_size < 0.95 * found.size


def test_what_the_worst_servo_needs_comes_before_what_is_cheaper(monkeypatch):
    """A remedy of which only the size for the values found is known is named where there is no other."""

    def made(asked, remedy):
        worst = math.nan if remedy.name == "dead band" else 1.0
        known = {"recommended_rest_error": 0.0, "peak_torque": 1.0, "settling": 1.0 if math.isnan(worst) else 2.0}
        return Cure(remedy.name, "", "fold", 1.0, 0.0, 1.1, stays=("at rest",) * 4, worst_size=worst, **known)

    monkeypatch.setattr(module, "_row", made)
    allowed = Uncertainty({"friction.static": (0.53, 0.54)})
    both = remedies(Servo(), "switch", 0.04, only=["dead band", "leak"], uncertainty=allowed)
    assert [r.name for r in both.remedies] == ["dead band", "leak"] and both.best == "leak"
    assert remedies(Servo(), "switch", 0.04, only=["dead band", "leak"]).best == "dead band"
    alone = remedies(Servo(), "switch", 0.04, only=["dead band"], uncertainty=allowed)
    assert alone.best == "dead band"
    assert "worst servo of the set needs was not found" in advice_of(Table(alone, of_a_set=True))
    assert "worst" not in advice_of(Table(both, of_a_set=True))


@pytest.mark.slow
def test_the_worst_servo_is_that_of_all_corners():
    """More static and less Coulomb friction, to which the slopes point; of a dwell, which has no slopes, both ends."""
    box = {"friction.static": (0.52, 0.54), "friction.coulomb": (0.43, 0.45)}
    found = row("dead band", 0.04, uncertainty=Uncertainty(box))
    corners = [
        remedies(Servo().replace(**{"friction.static": Fs, "friction.coulomb": Fc}), "switch", 0.04, only=["dead band"])
        .remedies[0].size
        for Fs in (0.52, 0.54) for Fc in (0.43, 0.45)
    ]  # fmt: skip
    assert found.worst_size == pytest.approx(max(corners), rel=1e-8)
    found = row("freeze", 0.04, uncertainty=Uncertainty({"friction.static": (0.52, 0.54)}))
    stuck = []
    for Fs in (0.52, 0.54):
        orbit = find_orbit(Servo().replace(**{"friction.static": Fs}), "switch", 0.04, options=Options(tol=1e-9))
        stuck.append(next(arc.duration for arc in orbit.arcs if arc.mode == "stick"))
    assert found.worst_size == pytest.approx(min(stuck), rel=2 * MOTIONS_KNOW) and found.worst_size < found.size


@pytest.mark.slow
def test_rows_have_the_margins_of_their_linear_loop():
    table = {name: row(name, 0.04) for name in ("gain", "integral", "dead band")}
    found, truth = table["gain"], margins(Servo(), table["gain"].recommended)
    assert found.phase_margin == pytest.approx(truth.phase_margin, rel=1e-9)
    assert (found.lowest_factor, found.highest_factor) == (truth.lowest_factor, truth.highest_factor)
    less = replace(Servo(), controller=Pid(kp=2.0, ki=table["integral"].recommended, kd=1 / (2 * math.pi)))
    assert table["integral"].phase_margin == pytest.approx(margins(less, 0.04).phase_margin, rel=1e-9)
    assert math.isnan(table["dead band"].phase_margin)


def test_larger_sizes_are_looked_at():
    """A dead band ends it for good."""
    band = row("dead band", 0.04)
    assert band.keeps_it_ended and len(band.beyond) == len(band.stays) >= 4
    assert band.beyond[0] == band.recommended and band.beyond[-1] == pytest.approx(3 * band.size)
    assert not replace(band, stays=("at rest", "at rest", "at rest", "growing")).keeps_it_ended


def test_the_price_of_gain_is_its_torque():
    """On a step of 1 rad from rest the torque is largest at once: kp of the recommended gain."""
    found = row("gain", 0.04)
    assert found.peak_torque == pytest.approx(2 * 16 * found.recommended, rel=1e-9)
    assert found.peak_voltage == pytest.approx(found.peak_torque / 16)


def test_one_name_is_a_list_of_one():
    assert [row.name for row in remedies(Servo(), "switch", 0.04, only="gain").remedies] == ["gain"]
    with pytest.raises(InputError, match="unknown remedy 'gain,leak'"):
        remedies(Servo(), "switch", 0.04, only="gain,leak")


@pytest.mark.parametrize(("how", "sentence"), [
    ({"only": ["brake"]}, "unknown remedy 'brake'"), ({"max_error": -1.0}, "max_error"),
    ({"max_torque": math.nan}, "max_torque"), ({"margin": 0.0}, "margin"), ({"margin": math.nan}, "margin"),
])  # fmt: skip
def test_what_is_refused(how, sentence):
    with pytest.raises(InputError, match=sentence):
        remedies(Servo(), "switch", 0.04, **how)


def test_a_servo_that_does_not_hunt_needs_none():
    with pytest.raises(NoOrbit, match="gain"):
        remedies(Servo(), "switch", 1.0)


@pytest.mark.slow
def test_the_verdicts_are_those_of_motions_by_another_integrator():
    """Sizes beside the border hunt and do not, as motions by heyoka from a scan of starts do, to 1e-6 of the size."""
    needs("heyoka")
    from scripts.remedies import check

    found = check(Servo(), 0.04, ["dead band", "leak", "reset", "hysteresis", "freeze"])
    assert {outcome for _, outcome, _ in found} == {"agrees", "border agrees"}, found


def test_a_motion_that_grows_has_no_price():
    """What the torque was when it was left is no peak."""
    lagging = with_remedy(loop_of(Servo(), "switch", 0.04), remedy_of("error filter", "switch"), 0.2)
    step = task(lagging, Swing.of(find_orbit(Servo(), "switch", 0.04)), 0.0, 1.0)
    assert math.isnan(step.peak_torque) and math.isnan(step.settling)


def test_motions_that_come_to_rest_are_followed_with_the_sizes_that_they_had():
    """Beyond its border an integrator that is reset leaves motions of ever smaller swings, whose rate is rounding."""
    assert set(row("reset", 0.1).stays) <= {"at rest", "decaying"}


def test_a_servo_that_hunts_has_not_settled():
    """With 0.0177 rad, which is less than 2 % of the step; nor has one whose error is as large."""
    orbit, loop = find_orbit(Servo(), "switch", 0.1), loop_of(Servo(), "switch", 0.1)
    step = task(loop, Swing.of(orbit), 0.0, 1.0)
    assert step.kind == "hunting" and math.isnan(step.settling) and orbit.amplitude < 0.02
    calm = task(loop.replace(gain=0.8), Swing.of(orbit), 0.0, 1.0)
    assert calm.kind in SETTLES and calm.settling > 0


@pytest.mark.parametrize("parts", [{"load_torque": 0.3}, {"load_torque": -0.3}])
def test_with_a_load_the_price_is_that_of_the_worse_way(parts):
    """kp step + load at once, on a step in its direction, of which the load's mirror image has the same price."""
    orbit, loop = find_orbit(Servo(), "switch", 0.1), loop_of(Servo(), "switch", 0.8)
    loaded = task(loop.with_parts(LOADS, **parts), Swing.of(orbit), 0.0, 1.0)
    assert loaded.peak_torque == pytest.approx(16 * 0.8 * 2.0 + 0.3, rel=1e-9)
    assert task(loop, Swing.of(orbit), 0.0, 1.0).peak_torque == pytest.approx(16 * 0.8 * 2.0, rel=1e-9)


@pytest.mark.slow
def test_rows_are_those_of_other_processes():
    """To the last bit, told in the same order; and a row that does not fit is one wherever it is asked."""
    told, found = [[], []], []
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        for names, how in zip(told, (executor, None), strict=True):
            asked = {"only": ["leak", "gain", "dither"], "progress": lambda row, to=names: to.append(row.name)}
            found.append(remedies(Servo(), "lugre", 0.3, executor=how, **asked))
    there, here = found
    assert there.to_dict() == here.to_dict() and told[0] == told[1] == ["leak", "dither", "gain"]
    assert [row.kind for row in here.remedies].count("does not fit") == 1
