"""Orbits against values from outside: the reference table, and the Taylor engine for everything else."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from casahunt import NoOrbit, Options, Orbit, Servo, Status, find_fold, find_orbit
from casahunt.cli import main
from casahunt.collocation import ipopt, newton
from casahunt.collocation import ipopt as solve
from casahunt.design.sensitivity import fold_sensitivities
from casahunt.orbits import adapt
from casahunt.orbits.orbit import unknowns_of
from casahunt.servo.event_map.half_cycle import half_cycle
from problems import table1, taylor

ROWS = [
    (model, branch, row)
    for model in ("switch", "lugre")
    for branch in ("stable", "unstable")
    for row in table1.REFERENCE[model][branch]
]
NAMES = [f"{model}-{branch}-{row['K']}" for model, branch, row in ROWS]

# Demanded of the program at tolerance 1e-9: amplitude and period to it; multipliers are computed on finer meshes.
SIZES, MULTIPLIER = 1e-9, 2e-9
FOLDS = {model: table1.REFERENCE[model]["fold"] for model in ("switch", "lugre")}


@pytest.mark.parametrize(("model", "branch", "row"), ROWS, ids=NAMES)
def test_reference_rows(orbit, model, branch, row):
    found = orbit(model, row["K"], branch)
    agrees(found, branch, row)


def agrees(found: Orbit, branch: str, row: dict[str, float]) -> None:
    assert found.amplitude == pytest.approx(row["amplitude"], rel=SIZES)
    assert found.period == pytest.approx(row["period"], rel=SIZES)
    assert found.half_multiplier == pytest.approx(row["mu"], rel=MULTIPLIER)
    assert found.stable == (branch == "stable")
    assert found.multipliers.trivial_error < 1e-8


def forbid(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Every call of these functions of the solvers, from whatever module has taken them, is an error."""

    def forbidden(*_arguments: object, **_options: object) -> None:
        raise AssertionError("another solver was called")

    meant = {id(vars(home)[name]) for home in (newton, ipopt, solve) for name in names if name in vars(home)}
    taken = [
        (module, name)
        for key, module in list(sys.modules.items()) if key.startswith("casahunt")
        for name, value in list(vars(module).items()) if id(value) in meant
    ]  # fmt: skip
    assert {name for _, name in taken} == set(names)
    for module, name in taken:
        monkeypatch.setattr(module, name, forbidden)


IPOPT = ("ipopt", "ipopt_then_newton", "maximise_parameter", "_run_ipopt")
QUICK = [row for row in zip(ROWS, NAMES, strict=True) if row[0][0] == "switch" or row[1] == "lugre-stable-0.6"]
LONG = [row for row in zip(ROWS, NAMES, strict=True) if row not in QUICK]


@pytest.mark.parametrize(
    ("model", "branch", "row"),
    [pytest.param(*row, id=name) for row, name in QUICK]
    + [pytest.param(*row, id=name, marks=pytest.mark.slow) for row, name in LONG],
)
def test_reference_rows_by_ipopt_alone(monkeypatch, model, branch, row):
    """First cycle, walk round the fold, changes of the mesh, multipliers: Newton is never called."""
    forbid(monkeypatch, "newton")
    options = Options(tol=1e-9, solver="ipopt")
    found = find_orbit(table1.servo(), model, row["K"], branch=branch, options=options)
    agrees(found, branch, row)
    assert found.solver == "ipopt"


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("solver", "others"), [("ipopt", ("newton",)), ("newton", IPOPT)])
def test_folds_by_one_solver_alone(monkeypatch, model, solver, others):
    """Gain, amplitude, period, and exact symmetries of the sensitivities, which come from the adjoint."""
    forbid(monkeypatch, *others)
    found = find_fold(table1.servo(), model, options=Options(tol=1e-9, solver=solver))
    assert found.gain == pytest.approx(FOLDS[model]["K"], rel=1e-10)
    assert found.confirmed_gain == pytest.approx(FOLDS[model]["K"], rel=1e-10)
    assert found.orbit.amplitude == pytest.approx(FOLDS[model]["amplitude"], rel=SIZES)
    assert found.orbit.period == pytest.approx(FOLDS[model]["period"], rel=SIZES)
    assert found.orbit.solver == solver
    elasticities = fold_sensitivities(found).elasticities
    assert elasticities["servo.motor_gain"] == pytest.approx(-1, abs=1e-7)
    # All torques times one factor: the gain times that factor.
    frictions = ("static", "coulomb", "viscous", "stiffness", "damping")
    torques = elasticities["servo.inertia"] + sum(elasticities[f"friction.{name}"] for name in frictions)
    assert torques == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_newton_alone(monkeypatch, branch):
    forbid(monkeypatch, *IPOPT)
    row = table1.REFERENCE["switch"][branch][1]
    options = Options(tol=1e-9, solver="newton")
    agrees(find_orbit(table1.servo(), "switch", row["K"], branch=branch, options=options), branch, row)


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
def test_a_named_solver_has_no_substitute(monkeypatch, model):
    """Where the solver that was asked for fails, no other one steps in unasked."""
    for solver, others in (("ipopt", ("newton",)), ("newton", IPOPT)):
        with monkeypatch.context() as patch:
            forbid(patch, *others)
            failed = newton.Solution(np.zeros(1), 0.0, Status.NOT_CONVERGED, 1, np.inf, None)
            for module in (solve, adapt):
                patch.setattr(module, solver, lambda *_, failed=failed, **__: failed, raising=False)
            with pytest.raises(NoOrbit, match=f"{solver} worked alone"):
                find_orbit(table1.servo(), model, 0.4, options=Options(solver=solver))


def test_ipopts_success_past_a_fold_is_not_an_answer():
    """Past the fold there is no root; where the residual is smaller than IPOPT asks for, it calls that one."""
    fold = find_fold(table1.servo(), "switch", options=Options(tol=1e-9))
    t, u, setting = unknowns_of(fold.orbit)
    content = []
    for beyond in (1e-6, 1e-9, 1e-10, 1e-11, 3e-12, 1e-12):  # at which of them it is content, rounding decides
        found = ipopt.ipopt(t, u, replace(setting, p=np.append(setting.p[:-1], setting.p[-1] * (1 + beyond))))
        assert not found.status.ok
        if ipopt._ipopt_solver(t, "root").stats()["success"]:
            content.append(found.residual)
    assert content and min(content) < 1e-9


def test_command_line_names_the_solver(capsys):
    row = table1.REFERENCE["switch"]["stable"][2]
    for solver in ("ipopt", "newton"):
        assert main(["orbit", "--gain", "0.2", "--solver", solver, "--json", "--quiet"]) == 0
        record = json.loads(capsys.readouterr().out)
        assert record["solver"] == solver and record["period"] == pytest.approx(row["period"], rel=1e-6)
        assert main(["fold", "--solver", solver, "--json", "--quiet"]) == 0
        record = json.loads(capsys.readouterr().out)
        assert record["solver"] == solver and record["gain"] == pytest.approx(FOLDS["switch"]["K"], rel=1e-6)
    assert main(["fold", "--solver", "newton", "--quiet", "--details"]) == 0
    text = capsys.readouterr().out
    assert "turning point" in text and "IPOPT" not in text
    assert main(["fold", "--solver", "ipop", "--quiet"]) == 2
    assert "ipopt" in capsys.readouterr().err


@pytest.mark.parametrize(("model", "branch", "row"), ROWS, ids=NAMES)
def test_reference_rows_at_the_default_tolerance(orbit, model, branch, row):
    found = orbit(model, row["K"], branch, 1e-6)
    assert found.amplitude == pytest.approx(row["amplitude"], rel=1e-6)
    assert found.period == pytest.approx(row["period"], rel=1e-6)
    assert found.half_multiplier == pytest.approx(row["mu"], rel=1e-6)


@pytest.mark.parametrize("tol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(("model", "branch", "row"), ROWS, ids=NAMES)
def test_error_estimate_is_honest(orbit, model, branch, row, tol):
    """True error at most 10 estimates; estimate at most 100 true errors, above what the table can tell."""
    found = orbit(model, row["K"], branch, tol)
    digits = 1e-13 if model == "switch" else 1e-10
    true = max(abs(found.amplitude / row["amplitude"] - 1), abs(found.period / row["period"] - 1))
    assert found.error_estimate <= tol
    assert true <= 10 * found.error_estimate + digits
    assert found.error_estimate <= 100 * (true + digits)


def test_below_the_reports_bound(orbit):
    """Hunting below K = 0.0321, where the report's linear bound says instability (design value, two programs)."""
    found = orbit("switch", 0.02)
    assert found.amplitude == pytest.approx(0.10586388, rel=1e-7)
    assert found.period == pytest.approx(10.060780, rel=1e-7)


OTHER_SERVOS = [
    ({}, 0.005),
    ({"friction.coulomb": 0.3}, 0.2),
    ({"friction.stribeck_velocity": 0.002}, 0.1),
    ({"servo.inertia": 0.001}, 0.01),
    ({"friction.viscous": 0.0}, 0.2),
    ({"controller.integral_time": 0.12, "controller.lead_time": 0.25}, 0.2),
]
MORE_SERVOS = [
    ({}, 0.3),
    ({"friction.static": 0.50}, 0.35),
    ({"friction.stribeck_velocity": 0.03}, 0.1),
    ({"servo.inertia": 0.05}, 0.5),
    ({"servo.motor_gain": 1.0}, 2.0),
    ({"friction.viscous": 0.2}, 0.3),
    ({"controller.integral_time": 1.5, "controller.lead_time": 0.05}, 0.1),
]


@pytest.mark.parametrize(
    ("changes", "gain"), [*OTHER_SERVOS, *(pytest.param(*more, marks=pytest.mark.slow) for more in MORE_SERVOS)]
)
def test_other_switch_servos_against_taylor_series(changes, gain):
    servo = Servo().replace(**changes)
    found = find_orbit(servo, "switch", gain, options=Options(tol=1e-9))
    amplitude, period = taylor.switch_cycle(servo, gain, found.amplitude)
    assert found.amplitude == pytest.approx(amplitude, rel=5e-9)
    assert found.period == pytest.approx(period, rel=5e-9)


@pytest.mark.parametrize("gain", [0.1, 0.61])
def test_unstable_switch_cycles_against_taylor_series(orbit, gain):
    """Where mu is a thousand at most: doubles know a period to about mu eps; at 0.4, mu = 1e5, the table has digits."""
    found = orbit("switch", gain, "unstable", 1e-10)
    amplitude, period = taylor.switch_cycle(table1.servo(), gain, found.amplitude)
    assert found.amplitude == pytest.approx(amplitude, rel=1e-9)
    assert found.period == pytest.approx(period, rel=3e-9)


@pytest.mark.parametrize(
    ("changes", "gain"),
    [
        ({}, 0.12),  # a pair of reversals is about to vanish
        pytest.param({}, 0.5, marks=pytest.mark.slow),
        pytest.param({"friction.static": 0.50}, 0.3, marks=pytest.mark.slow),
        pytest.param({"friction.stiffness": 1e5, "friction.damping": 16.16}, 0.2, marks=pytest.mark.slow),
        pytest.param({"friction.damping": 0.0}, 0.1, marks=pytest.mark.slow),  # a hundred reversals
        ({"servo.inertia": 0.05}, 0.3),
    ],
)
def test_lugre_orbits_close_in_taylor_series(changes, gain):
    """The orbit's first state, followed for half a period by the other engine, returns mirrored.

    In mid-slip the bristle follows the velocity within 1e-4 s and carries nothing on: the tolerance is one on period
    and amplitude, and z there is known to the square root of it only.
    """
    servo = Servo().replace(**changes)
    found = find_orbit(servo, "lugre", gain, options=Options(tol=1e-9))
    x0 = found.arcs[0].states[0, 0]
    x, half_period, largest = taylor.lugre_half_cycle(servo, gain, x0.copy())
    off = np.abs(x + x0) / found.scale
    assert np.max(off[:3]) < 2e-8 and off[3] < 1e-6
    assert 2 * half_period == pytest.approx(found.period, rel=2e-8)
    assert largest == pytest.approx(found.amplitude, rel=2e-8)


@pytest.mark.parametrize("model", ["switch", "lugre"])
@pytest.mark.parametrize("gain", [0.04, 0.2, 0.6])
def test_half_and_full_cycle_agree(orbit, model, gain):
    half = orbit(model, gain)
    full = find_orbit(table1.servo(), model, gain, options=Options(tol=1e-9, half=False))
    assert full.amplitude == pytest.approx(half.amplitude, rel=2e-9)
    assert full.period == pytest.approx(half.period, rel=2e-9)
    assert full.multipliers.leading.real == pytest.approx(half.half_multiplier**2, rel=1e-6)
    assert len(full.arcs) == 2 * len(half.arcs)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_schemes_and_solvers_agree(orbit, model):
    reference = orbit(model, 0.3, tol=1e-11)
    for options in (
        Options(tol=1e-10, solver="newton"),
        Options(tol=1e-10, degree=5, kind="gauss"),
        Options(tol=1e-10, degree=6, kind="radau"),
        Options(tol=1e-10, degree=9, kind="gauss"),
    ):
        found = find_orbit(table1.servo(), model, 0.3, options=options)
        assert found.amplitude == pytest.approx(reference.amplitude, rel=1e-9)
        assert found.period == pytest.approx(reference.period, rel=1e-9)


@pytest.mark.parametrize(
    ("model", "branch"),
    [("switch", "stable"), ("switch", "unstable"), ("lugre", "stable")]
    + [pytest.param("lugre", "unstable", marks=pytest.mark.slow)],
)
def test_every_solver_gives_the_same_orbit(model, branch):
    """Newton where it can, IPOPT alone, Newton alone: one orbit to 1e-10, and each says which solver it came from."""
    found = {
        solver: find_orbit(table1.servo(), model, 0.4, branch=branch, options=Options(tol=1e-12, solver=solver))
        for solver in ("auto", "ipopt", "newton")
    }
    solvers = {choice: o.solver for choice, o in found.items()}
    assert solvers == {"auto": "newton", "ipopt": "ipopt", "newton": "newton"}
    reference = next(row for row in table1.REFERENCE[model][branch] if row["K"] == 0.4)
    for other in found.values():
        assert other.period == pytest.approx(found["auto"].period, rel=1e-10)
        assert other.amplitude == pytest.approx(found["auto"].amplitude, rel=1e-10)
        assert other.period == pytest.approx(reference["period"], rel=1e-8)


@pytest.mark.slow
def test_unstable_lugre_cycle_of_seventeen_hours():
    """Fifty times below the report's lower bound, by two schemes; its longest interval lasts hours."""
    gain = 6.2e-4
    found = [
        find_orbit(table1.servo(), "lugre", gain, branch="unstable", options=Options(tol=1e-6, degree=d, kind=kind))
        for d, kind in ((7, "radau"), (6, "gauss"))
    ]
    one, two = found
    assert one.period == pytest.approx(two.period, rel=1e-5)
    assert one.amplitude == pytest.approx(two.amplitude, rel=1e-5)
    assert one.period > 5e4


def test_reversal_without_stick():
    """Far out and with little damping the slip ends with more torque than friction holds: it slips back at once."""
    servo = Servo().replace(**{"friction.viscous": 0.0, "controller.lead_time": 0.05})
    run = half_cycle("switch", servo, 0.1, 1.0, tol=1e-8)
    assert [s.mode for s in run.segments].count("slip-") > 0
    position, time, slips = taylor.switch_half_cycle(servo, 0.1, 1.0)
    assert len(slips) == len(run.segments) - 1 > 1
    assert run.position == pytest.approx(position, rel=1e-9)
    assert sum(s.duration for s in run.segments) == pytest.approx(time, rel=1e-9)
    assert [s.duration for s in run.segments[:-1]] == pytest.approx(slips, rel=1e-9)
