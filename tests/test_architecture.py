"""The house in order: rooms and modules import one way, the engine knows no servo, everything public is documented.

The order of the modules of a room is that of its `__init__` docstring.
"""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "casahunt"
ROOMS = ("hybrid", "collocation", "motion", "orbits", "continuation", "servo", "design", "views")
ENGINE = ROOMS[:5]
GROUND = (
    "lazy", "roots", "interrupts", "errors", "checks", "quantities", "axis_units", "effort", "compiled",
    "files", "export", "results",
)  # fmt: skip
TOP = ("__init__", "cli", "pictures", "__main__")
PATHS = {path.relative_to(PACKAGE).with_suffix("").as_posix().replace("/", "."): path for path in PACKAGE.rglob("*.py")}
MODULES = sorted(PATHS)
TERMINAL = {m for m in MODULES if m in ("cli", "__main__") or m.startswith("views.commands.")}
"""The modules that talk to a terminal."""
DRAWING = {m for m in MODULES if m.startswith("views.pictures.")}
SERVO_WORDS = re.compile(
    r"servo|friction|(?<![a-z])gains?(?![a-z])|(?<!casa)hunt|lugre|\bSwitch\b|\"switch\"", re.IGNORECASE
)
BRANCH_SWITCHING = re.compile(r"branch.switching", re.IGNORECASE)


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(parsed(path)))


def tree(module: str) -> ast.Module:
    return parsed(PATHS[module])


def nodes(module: str) -> tuple[ast.AST, ...]:
    return nodes_of(PATHS[module])


@cache
def imports(module: str) -> tuple[frozenset[str], frozenset[str]]:
    """(modules of the package, top-level names of everything else) that a module imports, anywhere in it."""
    inner: set[str] = set()
    outer: set[str] = set()
    package = module.split(".")[:-1]
    for node in nodes(module):
        if isinstance(node, ast.Import):
            targets = [(alias.name.split("."), "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ["casahunt", *package[: len(package) - node.level + 1]] if node.level else []
            targets = [(base + (node.module or "").split("."), alias.name) for alias in node.names]
        else:
            continue
        for path, name in targets:
            top, *rest = [part for part in path if part]
            if top != "casahunt":
                outer.add(top)
                continue
            # "from .room import x": x is a module of the room, or a name that its __init__ defines.
            candidates = (".".join([*rest, name]), ".".join(rest), ".".join([*rest, "__init__"]))
            inner.add(next(c for c in candidates if c in PATHS))
    return frozenset(inner), frozenset(outer)


def room_of(module: str) -> str:
    return module.split(".")[0] if "." in module else ""


def floor_of(module: str) -> int:
    """Place of the room of a module, from the ground."""
    if room_of(module):
        return 1 + ROOMS.index(room_of(module))
    return 0 if module in GROUND else len(ROOMS) + 1


@cache
def listed(package: str) -> list[str]:
    """Modules and rooms that the docstring of a package lists, in order, without the package's own name."""
    docstring = ast.get_docstring(tree(f"{package}.__init__")) or ""
    return re.findall(r"(?:^|, )(\w+)(?:\.py|/)(?=[ ,]|$)", docstring, re.MULTILINE)


def test_every_module_has_its_room():
    assert {room_of(m) for m in MODULES} - {""} == set(ROOMS)
    assert {m for m in MODULES if not room_of(m)} == {*GROUND, *TOP}


def test_a_room_lists_its_modules():
    """A newcomer who reads the docstrings of the rooms knows the house."""
    for package in [m.removesuffix(".__init__") for m in MODULES if m.endswith(".__init__")]:
        folder = PATHS[f"{package}.__init__"].parent
        rooms = {p.name for p in folder.iterdir() if (p / "__init__.py").exists()}
        there = {p.stem for p in folder.glob("*.py")} | rooms
        assert sorted(listed(package)) == sorted(there - {"__init__"})


def test_imports_point_one_way():
    for module, target in ((m, t) for m in MODULES if m not in TOP for t in imports(m)[0]):
        assert target not in TOP, f"{module} imports {target}"
        here, there = floor_of(module), floor_of(target)
        assert there <= here, f"{module} imports {target}, a room above its own"
        if here == 0:
            assert GROUND.index(target) < GROUND.index(module), f"{module} imports {target}, which stands above it"
        elif there == here and not module.endswith("__init__"):
            # The first part of the two names in which they differ stands in the docstring of the room they share.
            a, b = module.split("."), target.split(".")
            k = next(i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y)
            order = listed(".".join(a[:k]))
            assert order.index(b[k]) < order.index(a[k]), f"{module} imports {target}, which its room lists below it"


def source_without_data(module: str) -> list[str]:
    return [BRANCH_SWITCHING.sub("", line) for line in PATHS[module].read_text(encoding="utf-8").splitlines()]


def test_the_engine_knows_no_servo():
    """Neither in its code nor in its messages and docstrings."""
    found = [
        (module, i, line)
        for module in MODULES
        if room_of(module) in ENGINE
        for i, line in enumerate(source_without_data(module), 1)
        if SERVO_WORDS.search(line)
    ]
    assert not found


def test_the_servo_is_written_as_a_user_writes_a_system():
    """Of the engine the product of its parts takes nothing but the public names of `casahunt.hybrid`."""
    module = "servo.parts.product"
    taken = {t for t in imports(module)[0] if room_of(t) in ENGINE}
    names = {
        alias.name
        for node in nodes(module)
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "hybrid"
        for alias in node.names
    }
    assert taken == {"hybrid.__init__"} and names == {"Event", "Mode", "System"}


def shown_homes(package: ast.Module) -> dict[str, tuple[str, str]]:
    """(module, name there) of each name that the type checker sees a package import."""
    froms = [node for node in ast.walk(package) if isinstance(node, ast.ImportFrom) and node.level == 1 and node.module]
    return {alias.asname or alias.name: (str(node.module), alias.name) for node in froms for alias in node.names}


@cache
def published() -> frozenset[tuple[str, str]]:
    """(module, name) of what stands in the `__all__` of the package or of a room of the engine, where it is defined."""
    homes = set()
    for room in ("casahunt", *(f"casahunt.{room}" for room in ENGINE)):
        package = importlib.import_module(room)
        for name in getattr(package, "__all__", ()):
            home = shown_homes(tree("__init__"))[name][0] if room == "casahunt" else None
            value = getattr(package, name)
            homes |= {(room, name), (getattr(value, "__module__", home), getattr(value, "__name__", name))}
            homes |= {(f"casahunt.{home}", name)} if home else set()
    return frozenset(homes)


def unpublished(module: str) -> set[str]:
    """What a module imports of the engine that is in no `__all__`, as "room.module.name"."""
    package, found = ["casahunt", *module.split(".")[:-1]], set()
    for node in nodes(module):
        if not isinstance(node, ast.ImportFrom):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            found |= {name for name in names if name.startswith("casahunt.") and room_of(name[9:] + ".") in ENGINE}
            continue
        base = package[: len(package) - node.level + 1] if node.level else []
        home = ".".join([*base, *(node.module or "").split(".")]).rstrip(".")
        for alias in node.names:
            whole = f"{home}.{alias.name}".removeprefix("casahunt.")
            if whole.split(".")[0] in ENGINE and (home, alias.name) not in published():
                found.add(whole)
    return found


@pytest.mark.parametrize("module", [m for m in MODULES if room_of(m) in ("servo", "design", "views")])
def test_of_the_engine_only_what_is_published_is_used(module):
    """Whatever the servo needs of the engine a user can have: it stands in an `__all__`, with an example."""
    assert not unpublished(module)


def test_nothing_beyond_the_declared_dependencies():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    always = {re.split(r"[<>=!~ \[]", requirement)[0] for requirement in project["dependencies"]}
    for module in MODULES:
        outer = imports(module)[1] - set(sys.stdlib_module_names) - {"mpl_toolkits"}  # which is part of matplotlib
        assert outer <= always, f"{module} imports {sorted(outer - always)}"


def test_matplotlib_is_imported_by_plotting_alone():
    users = {module for module in MODULES if imports(module)[1] & {"matplotlib", "mpl_toolkits"}}
    assert users <= {"views.pictures.plotting"}


def test_computing_draws_nothing():
    """Neither in the source nor in a running interpreter does anything below the views reach matplotlib."""
    silent = [module for module in MODULES if floor_of(module) < floor_of("views.evidence") and module not in TOP]
    names = ", ".join(f"casahunt.{module.removesuffix('.__init__')}" for module in silent)
    public = "for name in casahunt.__all__: getattr(casahunt, name)"
    code = f"import sys\nimport casahunt, {names}\n{public}\nassert 'matplotlib' not in sys.modules"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("room", ["casahunt", "casahunt.pictures", "casahunt.servo.parts",
                                  *(f"casahunt.{room}" for room in ENGINE)])  # fmt: skip
def test_public_names_are_looked_up_where_the_type_checker_sees_them(room):
    """What only the type checker imports is what `__getattr__` finds, and covers `__all__`."""
    module = importlib.import_module(room)
    homes = shown_homes(parsed(Path(module.__file__)))
    homes.pop("lazily", None)
    assert sorted(homes) == sorted(module.__all__)
    for name, (home, there) in homes.items():
        assert getattr(module, name) is getattr(importlib.import_module(f"{module.__package__}.{home}"), there)


def test_the_names_of_the_package_are_listed():
    import casahunt

    assert set(casahunt.__all__) <= set(dir(casahunt))


def test_solvers_run_in_one_place():
    for module in MODULES:
        called = {node.attr for node in nodes(module) if isinstance(node, ast.Attribute)}
        alone = module == "collocation.ipopt" or not called & {"nlpsol", "rootfinder", "qpsol"}
        assert alone, f"{module} runs a solver"


def test_nothing_is_printed():
    for module in sorted(set(MODULES) - TERMINAL):
        calls = [node.func for node in nodes(module) if isinstance(node, ast.Call)]
        assert not any(isinstance(func, ast.Name) and func.id == "print" for func in calls), module


def undocumented(node: ast.Module | ast.ClassDef, prefix: str) -> list[str]:
    """Public functions, classes and methods below `node` that have no docstring."""
    found: list[str] = []
    for child in node.body:
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and child.name[0] != "_":
            overloads = not isinstance(child, ast.ClassDef) and "overload" in map(ast.unparse, child.decorator_list)
            if ast.get_docstring(child) is None and not overloads:
                found.append(f"{prefix}{child.name}")
            if isinstance(child, ast.ClassDef):
                found += undocumented(child, f"{prefix}{child.name}.")
    return found


def test_everything_public_is_documented():
    for module in MODULES:
        assert ast.get_docstring(tree(module)), f"{module} has no docstring"
        assert not undocumented(tree(module), ""), module


# A file is one thing, and so is a function

MOST_LINES, MOST_LINES_OF_A_FUNCTION = 420, 65
SOURCES = sorted(path for folder in ("casahunt", "scripts") for path in (ROOT / folder).rglob("*.py"))
LONG = {
    "casahunt/continuation/following.py follow": "a docstring of fifty lines; the rest is checks and one call",
    "casahunt/design/remedies/remedies.py remedies": "a docstring of fifty lines; the rest is checks and one loop",
    "casahunt/continuation/walk.py walk": "a docstring of forty lines; the rest is one loop",
    "casahunt/motion/phases.py march": "a docstring of forty lines; the rest is one loop",
}
"""Files, and functions (behind the file), that may be longer, and why."""


def lines_of_examples(node: ast.AST) -> int:
    """Lines of the section Examples of a docstring, which is run (test_examples.py) and read by users."""
    documented = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
    doc = (ast.get_docstring(node) or "") if documented else ""
    return len(doc.partition("\n\nExamples\n--------\n")[2].splitlines()) + 3 if "\nExamples\n---" in doc else 0


def too_long(path: Path) -> list[str]:
    """The file and its functions that are longer than they may be; examples in docstrings do not count."""
    text, name = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
    functions = [n for n in nodes_of(path) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    found = [name] if len(text.splitlines()) - sum(map(lines_of_examples, nodes_of(path))) > MOST_LINES else []
    lines = {f: (f.end_lineno or f.lineno) - f.lineno + 1 - lines_of_examples(f) for f in functions}
    return found + [f"{name} {f.name}" for f in functions if lines[f] > MOST_LINES_OF_A_FUNCTION]


def test_files_and_functions_are_one_thing():
    found = {name for path in SOURCES for name in too_long(path)}
    assert not found - set(LONG), "longer than a file or a function should be"
    assert not set(LONG) - found, "no exceptions any more: take them out"


def constants(module: str) -> dict[str, ast.expr]:
    """Upper-case names that a module gives a value at its top level."""
    found: dict[str, ast.expr] = {}
    for node in tree(module).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            several = isinstance(target, ast.Tuple)
            values = node.value.elts if several and isinstance(node.value, ast.Tuple) else None
            for i, name in enumerate(target.elts if several else [target]):
                if isinstance(name, ast.Name) and name.id.isupper():
                    found[name.id] = values[i] if values else node.value
    return found


def is_numeric(value: ast.expr) -> bool:
    """A number, several, or a table of them, whatever its keys."""
    keys = {id(key) for node in ast.walk(value) if isinstance(node, ast.Dict) for key in node.keys}
    leaves = [n.value for n in ast.walk(value) if isinstance(n, ast.Constant) and id(n) not in keys]
    return bool(leaves) and all(isinstance(leaf, int | float) for leaf in leaves)


def test_a_numeric_constant_has_one_meaning():
    """No name of a number is given in two modules: the same limit has one home, another one another name."""
    homes: dict[str, list[str]] = {}
    for module in MODULES:
        for name in constants(module):
            homes.setdefault(name, []).append(module)
    numeric = {name for module in MODULES for name, value in constants(module).items() if is_numeric(value)}
    assert len(numeric) > 100  # they are found
    assert not {name: homes[name] for name in numeric if len(homes[name]) > 1}


def test_scripts_take_nothing_from_tests():
    """A script that imports from the tests is a sign of a missing room."""
    for path in (p for p in SOURCES if "scripts" in p.relative_to(ROOT).parts):
        for node in nodes_of(path):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            assert not any(name.split(".")[0] == "tests" for name in names), path


def test_no_class_of_problems_is_asked_for():
    """What the engine must know of a problem it asks the contract (hybrid/problem.py), whoever poses it."""
    classes = {"Problem", "Cycles", "Family", "Hunting", "Loose"}
    for module in MODULES:
        for node in nodes(module):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance":
                asked = {part.id for part in ast.walk(node.args[1]) if isinstance(part, ast.Name)}
                assert not asked & classes, f"{module}, line {node.lineno}"
