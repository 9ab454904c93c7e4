#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox"]
# ///
"""What is checked, a session each: `nox` runs tests, lint, docs and build, `nox -s slow` the rest.

    nox -s tests-3.13                 # the quick tests with one Python; -- -k simulate: pytest's own words
    nox -s build                      # wheel and sdist, looked at and installed

The same as .ci/run, on any system: no session needs a shell.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import nox

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
ROOT = Path(__file__).parent
nox.needs_version = ">=2024.4.15"
nox.options.default_venv_backend = "venv"


def _installed(session: nox.Session) -> None:
    """The package as a user has it, with the tools of the tests: not the checkout."""
    session.install(".[test]")
    session.install("--only-binary=heyoka,control", ".[bench]", success_codes=(0, 1))  # not everywhere are there wheels
    session.env.update({"MPLBACKEND": "Agg", "MPLCONFIGDIR": session.create_tmp()})
    with session.chdir(session.create_tmp()):
        session.run("casahunt", "--help", silent=True)


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """The quick tests."""
    _installed(session)
    session.run("python", "-m", "pytest", *session.posargs)


@nox.session(python=PYTHONS[0])  # the youngest Pythons have no numpy that old
def floors(session: nox.Session) -> None:
    """The README's first command, and the tests of commands and files, with the lowest versions, of extras too."""
    work = Path(session.create_tmp())
    lowest = work / "floors.txt"
    lowest.write_text(str(session.run("python", ".ci/floors.py", silent=True)), encoding="utf-8")
    session.install("-c", str(lowest), ".[explore,pandas]", "pytest", "pytest-xdist")
    session.env.update({"MPLBACKEND": "Agg", "MPLCONFIGDIR": str(work)})
    with session.chdir(work):
        session.run("casahunt", "diagram", "--quiet")
    files = ("tests/views", "tests/test_results.py", "tests/test_cli.py", "tests/test_files.py")
    computing = ("remedy", "remedies_command", "sampled_command", "loop_commands", "explore_model")
    ignored = [f"--ignore-glob=*_{name}.py" for name in computing]  # as .ci/run
    session.run("python", "-m", "pytest", "-W", "ignore::DeprecationWarning", *ignored, *files)


@nox.session
def processor(session: nox.Session) -> None:
    """The quick tests with the rounding of another processor (x86-64; the features' names are those of numpy 2.4)."""
    _installed(session)
    session.env.update({"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4"})
    session.run("python", "-m", "pytest", *session.posargs)


@nox.session(default=False)
def slow(session: nox.Session) -> None:
    """The tests that take longer."""
    _installed(session)
    session.run("python", "-m", "pytest", "-m", "slow", *session.posargs)


@nox.session(python=PYTHONS[0])  # numpy's types are those of the oldest Python, which mypy is told to check for
def lint(session: nox.Session) -> None:
    """Style, types, docstrings against signatures, and what a repository should have."""
    session.install(".[test]", "sp-repo-review[cli]", "zizmor")
    session.run("ruff", "check", ".")
    session.run("mypy")
    modules = sorted(str(path) for folder in ("casahunt", "problems") for path in (ROOT / folder).rglob("*.py"))
    for start in range(0, len(modules), 100):  # a command line has an end, on Windows sooner
        session.run("numpydoc", "lint", *modules[start : start + 100])
    session.run("repo-review", ".")
    session.run("zizmor", "--offline", "--quiet", ".github")


@nox.session
def docs(session: nox.Session) -> None:
    """The documentation; a warning is an error."""
    session.install(".[docs]")
    session.run("sphinx-build", "-W", "docs", "docs/_build/html")


@nox.session
def build(session: nox.Session) -> None:
    """Wheel and sdist: their descriptions, and the installed wheel."""
    out = Path(session.create_tmp()) / "dist"
    shutil.rmtree(out, ignore_errors=True)
    session.install("build", "twine")
    session.run("python", "-m", "build", "--outdir", str(out))
    files = sorted(str(path) for path in out.iterdir())
    session.run("python", "-m", "twine", "check", "--strict", *files)
    session.install(*(file for file in files if file.endswith(".whl")))
    with session.chdir(session.create_tmp()):
        session.run("casahunt", "fold", "--quiet", env={"OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "1")})


if __name__ == "__main__":
    nox.main()
