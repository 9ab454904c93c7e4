"""Nothing is built, differentiated or drawn that nobody asked for."""

from __future__ import annotations

import subprocess
import sys

import pytest

from casahunt import Options, Servo, diagram, find_orbit
from casahunt.collocation.node_system import node_system
from casahunt.collocation.transcription import transcribe
from casahunt.continuation.special_points import FOLD


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_period_needs_no_multiplier(model):
    assert "multipliers" not in vars(find_orbit(Servo(), model, 0.1))


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_walk_to_the_fold_builds_each_problem_once_and_computes_no_multiplier(model):
    transcribe.cache_clear()
    node_system.cache_clear()
    servo = Servo()
    branch = diagram(servo, model, start=0.3, monitors=(FOLD,))
    assert len(branch.orbits) > 5 and [point.kind for point in branch.special] == ["fold"]
    # The last ones are those after the fold, of which it may be asked where the branch goes.
    assert not any("multipliers" in vars(orbit) for orbit in branch.orbits)
    built, factorised = transcribe.cache_info(), node_system.cache_info()
    assert built.misses == built.currsize and factorised.misses == factorised.currsize
    assert 2 * factorised.misses <= built.misses, "the halved mesh of each is built, and not factorised"


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
