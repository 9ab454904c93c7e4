"""The house in order: imports point one way, along CONTRIBUTING.md's list; everything public is documented."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "casahunt"
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py"))
# The modules that talk to a terminal:
USER_BORDER = {m for m in MODULES if m in ("cli", "console", "__main__") or m.startswith("command_")}
ORDER = re.findall(r"^ {4}(\w+)\.py +\S", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.MULTILINE)


@cache
def tree(module: str) -> ast.Module:
    return ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"), filename=f"casahunt/{module}.py")


def imports(module: str) -> tuple[set[str], set[str]]:
    """(modules of the package, top-level names of everything else) that a module imports, anywhere in it."""
    inner: set[str] = set()
    outer: set[str] = set()
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = "casahunt" if node.level else ""
            source = ".".join(part for part in (base, node.module) if part)
            # "from . import x": x is a module, or a name that __init__ defines.
            targets = [f"{source}.{alias.name}" for alias in node.names] if source == "casahunt" else [source]
        else:
            continue
        for target in targets:
            top, *rest = target.split(".")
            if top != "casahunt":
                outer.add(top)
            else:
                inner.add(rest[0] if rest and rest[0] in MODULES else "__init__")
    return inner, outer


def reachable(module: str) -> set[str]:
    """Every module of the package that importing `module` may load."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += imports(name)[0]
    return found


def test_the_list_is_complete():
    missing = [module for module in MODULES if module not in ORDER]
    assert not missing, f"give {missing} a line at their place in CONTRIBUTING.md"
    stale = [module for module in ORDER if module not in MODULES]
    assert not stale, f"CONTRIBUTING.md lists {stale}, which do not exist"
    assert len(ORDER) == len(set(ORDER))


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_one_way(module):
    allowed = ORDER[: ORDER.index(module)] if module in ORDER else []
    wrong = sorted(imports(module)[0] - set(allowed))
    assert not wrong, f"{module}.py imports {wrong}, which do not stand above it in CONTRIBUTING.md"


@pytest.mark.parametrize("module", MODULES)
def test_nothing_beyond_the_declared_dependencies(module):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[<>=!~ \[]", requirement)[0] for requirement in project["dependencies"]}
    outer = imports(module)[1] - set(sys.stdlib_module_names) - {"mpl_toolkits"}  # which is part of matplotlib
    assert outer <= declared, f"{module}.py imports {sorted(outer - declared)}"


def test_matplotlib_is_imported_by_plotting_alone():
    users = {module for module in MODULES if imports(module)[1] & {"matplotlib", "mpl_toolkits"}}
    assert users <= {"plotting"}


def test_computing_draws_nothing():
    """Neither in the source nor in a running interpreter does the public package reach matplotlib."""
    drawing = {m for m in MODULES if m == "plotting" or m.startswith("pictures_")}
    silent = [module for module in MODULES if module not in USER_BORDER | drawing]
    for module in silent:
        assert "plotting" not in reachable(module), f"{module}.py reaches plotting.py"
    names = ", ".join(["casahunt", *(f"casahunt.{module}" for module in silent if module != "__init__")])
    code = f"import sys\nimport {names}\nassert 'matplotlib' not in sys.modules"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_solvers_run_in_one_place():
    for module in MODULES:
        called = {node.attr for node in ast.walk(tree(module)) if isinstance(node, ast.Attribute)}
        assert module == "solve" or not called & {"nlpsol", "rootfinder", "qpsol"}, f"{module}.py runs a solver"


@pytest.mark.parametrize("module", sorted(set(MODULES) - USER_BORDER))
def test_nothing_is_printed(module):
    calls = [node.func for node in ast.walk(tree(module)) if isinstance(node, ast.Call)]
    assert not any(isinstance(func, ast.Name) and func.id == "print" for func in calls)


def undocumented(node: ast.Module | ast.ClassDef, prefix: str) -> list[str]:
    """Public functions, classes and methods below `node` that have no docstring."""
    found: list[str] = []
    for child in node.body:
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and child.name[0] != "_":
            if ast.get_docstring(child) is None:
                found.append(f"{prefix}{child.name}")
            if isinstance(child, ast.ClassDef):
                found += undocumented(child, f"{prefix}{child.name}.")
    return found


@pytest.mark.parametrize("module", MODULES)
def test_everything_public_is_documented(module):
    assert ast.get_docstring(tree(module)), f"{module}.py has no docstring"
    assert not undocumented(tree(module), "")
