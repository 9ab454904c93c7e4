"""Multipliers: two independent routes, the reference, and products that span many decades."""

from __future__ import annotations

import json
import math
import re
from copy import copy
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from casahunt import NoOrbit, Options, Servo, find_orbit
from casahunt.cli import main
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle, floquet, map_chain
from casahunt.orbits.graded import spectrum
from casahunt.orbits.orbit import unknowns_of
from problems import table1


@pytest.mark.parametrize("model", ["switch", "lugre"])
@pytest.mark.parametrize("gain", [0.04, 0.3, 0.6])
def test_collocation_blocks_and_casadi_integrators_agree(orbit, model, gain):
    """Condensed blocks against the forward sensitivities of erk and rosenbrock, phase by phase."""
    t, u, setting = unknowns_of(orbit(model, gain, tol=1e-12))
    own = floquet.chain_multipliers(map_chain.collocation_chain(t, u, setting), t.cycle.repeats)
    other = floquet.chain_multipliers(map_chain.integrator_chain(t, u, setting), t.cycle.repeats)
    assert own.leading.real == pytest.approx(other.leading.real, rel=1e-6, abs=1e-9)
    assert own.trivial_error < 1e-7
    assert other.trivial_error < 1e-6


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_structure_of_the_multipliers(orbit, model):
    """Switch {1, lambda, 0}, LuGre {1, lambda, ~0, ~0}: a stick projects (Filippov)."""
    found = orbit(model, 0.3).multipliers
    assert found.full[0] == pytest.approx(1, abs=1e-8)
    assert found.full[1] == pytest.approx(found.leading**2)
    assert np.abs(found.full[2:]).max() < 1e-10
    assert found.stable and found.trusted


def test_graded_products():
    """A product that spans 24 decades, built from factors with known eigenvalues."""
    rng = np.random.default_rng(0)
    n, count = 4, 60
    bases = [np.linalg.qr(rng.standard_normal((n, n)))[0] for _ in range(count)]
    rates = np.array([10 ** (12 / count), 1.0, -(10 ** (-3 / count)), 10 ** (-12 / count)])
    shear = np.triu(0.1 * rng.standard_normal((n, n)), 1)
    factors = []
    for k in range(count):
        after = bases[(k + 1) % count]
        factors.append(after @ (np.diag(rates) + shear) @ bases[k].T)
    found = spectrum(factors).values
    exact = rates**count
    assert np.abs(found) == pytest.approx(np.abs(exact), rel=1e-10)
    assert np.sign(found.real)[:2] == pytest.approx(np.sign(exact)[:2])


def test_sign_and_size_at_the_largest_multiplier(orbit):
    """Next to K = 0.4 on the unstable branch lambda is 1e10; shooting codes stick near -1e6 there."""
    for model in ("switch", "lugre"):
        row = next(r for r in table1.REFERENCE[model]["unstable"] if r["K"] == 0.4)
        found = orbit(model, 0.4, "unstable").multipliers
        assert found.leading.real > 0
        assert found.log10_leading == pytest.approx(np.log10(row["mu"]), abs=1e-6)
        assert found.trivial_error < 1e-8


@pytest.mark.parametrize(
    ("trivial", "fine", "coarse", "error", "floor"),
    [
        (1.0, 0.3, 0.3 + 1e-6, 1e-7, 0.0),  # a tenth of what two meshes differ by
        (1.0, 0.3, 0.3 + 1e-3, 1e-4, 0.0),
        (1.0, 20.0, 20.0 + 4e-3, 2e-5, 0.0),  # relative to a multiplier above one
        (1 + 1e-3, 0.3, 0.3, 1e-3, 0.0),  # the shift in time is off: no other is known better
        (1 + 1e-3, 0.3, 0.3 + 1e-6, 1e-3, 0.0),
        (1.0, 0.3, 0.6, 0.6, 0.6),  # nothing alike: a bound below one
        (1.0, 0.6, -0.3, 0.6, 0.6),
        (1.0, 0.3, 3.0, math.inf, 3.0),  # and nothing is known above it
        (1.0, 3.0, 0.3, math.inf, 3.0),
    ],
)
def test_what_two_meshes_say_of_a_multiplier(trivial, fine, coarse, error, floor):
    """The map diag(trivial, fine), whose flow is along the first state."""
    flow = np.array([[1.0, 0.0], [1.0, 0.0]])
    alone = floquet.chain_multipliers(map_chain.MapChain(np.diag([trivial, fine])[None], flow, np.zeros(1)), 1)
    assert alone.error == math.inf and not alone.trusted  # of one mesh
    found = floquet.compared(alone, np.array([coarse]))
    assert found.leading == pytest.approx(fine) and found.trivial_error == pytest.approx(trivial - 1, abs=1e-14)
    assert found.error == pytest.approx(error, rel=1e-6) and found.trusted == (error < floquet.TRUSTED)
    assert found.trivial_trusted == (abs(trivial - 1) < floquet.TRUSTED)
    assert found.floor[0] == 0 and found.leading_floor == pytest.approx(floor)


@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_integrators_against_the_reference(orbit, branch):
    """Both routes against a third program, up to mu = 1e5."""
    for row in table1.REFERENCE["switch"][branch]:
        found = orbit("switch", row["K"], branch)
        for route in (found.multipliers, found.integrator_multipliers):
            assert route.leading.real == pytest.approx(row["mu"], rel=2e-9)
            assert route.trivial_error < 1e-7


def test_integrators_on_an_unstable_lugre_cycle(orbit):
    row = next(r for r in table1.REFERENCE["lugre"]["unstable"] if r["K"] == 0.4)
    found = orbit("lugre", 0.4, "unstable").integrator_multipliers
    assert found.leading.real == pytest.approx(row["mu"], rel=1e-7)


def test_integrators_where_one_start_per_phase_is_lost():
    """mu = 2.3249402192253e14 in 50-digit arithmetic: rounding at the start of the slip is as large as the orbit."""
    servo = Servo().replace(**{"friction.static": 0.7})
    found = find_orbit(servo, "switch", 1.0, branch="unstable", options=Options(tol=1e-9)).integrator_multipliers
    assert found.trusted and found.leading.real == pytest.approx(2.3249402192253e14, rel=1e-6)


@pytest.mark.parametrize(
    ("model", "what"),
    [("switch", "erk failed in the phase 'slip+'"), ("lugre", "rosenbrock failed in the phase 'slide+'")],
)
def test_an_integrator_that_fails_says_so(orbit, monkeypatch, model, what):
    """CasADi's own integrator, with a field that is no number from the start, which no cycle has: patched."""
    t, u, setting = unknowns_of(orbit(model, 0.3))
    true = map_chain._sensitivities

    def broken(mode, *others):
        return true(replace(mode, field=lambda x, p, sign: ca.sqrt(-1 - x * x)), *others)

    monkeypatch.setattr(map_chain, "_sensitivities", broken)
    with pytest.raises(NoOrbit, match=re.escape(what)):
        map_chain.integrator_chain(t, u, setting)


@pytest.mark.parametrize("wrong", [
    lambda x, p, sign: ca.SX.sym("never given", x.shape),  # RuntimeError while the graph is built
    lambda x, p, sign: ca.vertcat(x, object()),  # NotImplementedError, which is a RuntimeError
])  # fmt: skip
def test_a_mistake_is_not_taken_for_an_integrator_that_fails(orbit, monkeypatch, wrong):
    """Patched: a transcription of such a field fails by itself, and sooner."""
    t, u, setting = unknowns_of(orbit("switch", 0.3))
    true = map_chain._sensitivities
    monkeypatch.setattr(map_chain, "_sensitivities", lambda mode, *others: true(replace(mode, field=wrong), *others))
    with pytest.raises(RuntimeError) as caught:
        map_chain.integrator_chain(t, u, setting)
    assert not isinstance(caught.value, NoOrbit)


@pytest.mark.parametrize(("model", "branch"), [("switch", "stable"), ("switch", "unstable"), ("lugre", "stable")])
def test_command_line_prints_both_routes(capsys, model, branch):
    row = next(r for r in table1.REFERENCE[model][branch] if r["K"] == 0.1)
    command = ["orbit", "--model", model, "--gain", "0.1", "--branch", branch, "--multipliers", "integrator", "--quiet"]
    assert main([*command, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    second = record["integrator"]
    assert second["half_multiplier"] == pytest.approx(row["mu"], rel=1e-7)
    off = abs(second["half_multiplier"] - record["half_multiplier"]) / max(1.0, abs(row["mu"]))
    assert second["difference"] == pytest.approx(off, rel=1e-6) and off < 1e-7
    assert main([*command, "--details"]) == 0
    text = capsys.readouterr().out
    assert "by integrators" in text and f"difference       {second['difference']:.1e}" in text


def test_command_line_refuses_an_unknown_route(capsys):
    assert main(["orbit", "--gain", "0.1", "--multipliers", "integrater"]) == 2
    assert "did you mean 'integrator'" in capsys.readouterr().err


def test_saltation_matrix():
    """Fixed-time map through x = 1 with the velocity doubling there, worked out by hand."""
    f_before, f_after, h = np.array([1.0, 0.0]), np.array([2.0, 0.0]), np.array([1.0, 0.0])
    assert map_chain.saltation(f_before, f_after, h) == pytest.approx(np.diag([2.0, 1.0]))


def relay(name: str, sign: int, way: int, other: str) -> Mode:
    """x''' + 2 x'' + ... + k sign x = 0 on one side."""

    def field(x, p):
        return {"x": x.y, "y": x.z, "z": -x.x - 2 * x.y - 1.5 * x.z - p.k * sign}

    return Mode(name, field, ends=(Event("through 0", lambda x, p: x.x, way, to=other),))


def test_a_relay_that_is_stated_in_two_modes():
    """What the refusal of `sign` in a field asks for: multipliers by differences of motions, and stability as told."""
    system = System("relay", ("x", "y", "z"), {"k": 2.0}, (relay("up", 1, -1, "down"), relay("down", -1, 1, "up")))
    cycle = find_cycle(system, "up", x=0.5, y=1.0, z=0.0)
    assert np.sort(np.abs(cycle.multipliers.full)) == pytest.approx([0.0051967, 0.2396503, 1.0], abs=1e-6)
    assert cycle.stable and ", stable," in str(cycle)
    for error, stable in ((0.4, True), (math.inf, None)):
        unsure = copy(cycle)
        unsure.__dict__["multipliers"] = replace(cycle.multipliers, error=error)
        assert unsure.stable is stable and ("stability not known" in str(unsure)) is (stable is None)
