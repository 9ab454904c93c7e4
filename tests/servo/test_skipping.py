"""Nothing is built, differentiated or drawn that nobody asked for."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter

import casadi as ca
import pytest

from casahunt import Options, Servo, collect, diagram, find_orbit
from casahunt.collocation.node_system import node_system
from casahunt.collocation.transcription import Transcription, transcribe
from casahunt.continuation.special_points import FOLD
from casahunt.orbits import floquet, orbit


def test_a_period_needs_no_multiplier(monkeypatch):
    def refuse(*args):
        raise AssertionError("multipliers were computed")

    monkeypatch.setattr(floquet, "multipliers", refuse)
    monkeypatch.setattr(orbit, "refined_multipliers", refuse)
    assert find_orbit(Servo(), "switch", 0.1).period > 0
    assert find_orbit(Servo(), "lugre", 0.1).period > 0


def test_a_walk_to_the_fold_needs_no_multiplier(monkeypatch):
    def refuse(*args):
        raise AssertionError("multipliers were computed")

    monkeypatch.setattr(orbit, "refined_multipliers", refuse)
    servo = Servo()
    branch = collect(servo, "switch", diagram(servo, "switch", start=0.3, monitors=(FOLD,)))
    assert [point.kind for point in branch.special] == ["fold"]


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_each_problem_is_built_once_per_mesh_structure(monkeypatch, model):
    transcribe.cache_clear()
    node_system.cache_clear()
    built: Counter[object] = Counter()
    factorised: Counter[object] = Counter()
    init, solver = Transcription.__init__, ca.Linsol

    def counting(self, cycle, counts, degree, kind):
        built[id(cycle), counts, degree, kind] += 1
        init(self, cycle, counts, degree, kind)

    def counting_solver(name, plugin, sparsity):
        factorised[sparsity.serialize()] += 1
        return solver(name, plugin, sparsity)

    monkeypatch.setattr(Transcription, "__init__", counting)
    monkeypatch.setattr("casahunt.collocation.node_system.ca.Linsol", counting_solver)
    servo = Servo()
    branch = collect(servo, model, diagram(servo, model, start=0.3, monitors=(FOLD,)))
    assert len(branch.orbits) > 5
    assert max(built.values()) == 1
    assert max(factorised.values()) == 1
    assert 2 * len(factorised) <= len(built), "the halved mesh of each is built, and not factorised"


def test_an_error_estimate_factorises_no_second_system(monkeypatch):
    """The halved mesh is condensed to the nodes of the one at hand."""
    transcribe.cache_clear()
    node_system.cache_clear()
    find_orbit(Servo(), "switch", 0.1, options=Options(solver="newton"))
    transcriptions, systems = transcribe.cache_info().misses, node_system.cache_info().misses
    assert systems < transcriptions


def test_imports_are_little_more_than_casadi():
    """All public names take casadi, numpy and the standard library; matplotlib and scipy stay away."""
    read = "for name in casahunt.__all__: getattr(casahunt, name)"
    code = f"import sys, casahunt\n{read}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert {"casadi", "numpy"} <= loaded
    assert not loaded & {"matplotlib", "scipy", "pandas", "argparse"}
