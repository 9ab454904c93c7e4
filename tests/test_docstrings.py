"""Public functions say what they take, return and raise: the rules of the house that numpydoc alone cannot say.

Public is what stands in the `__all__` of the package, of a room of the engine or of `casahunt.servo.parts`, and the
methods of such classes; of problems/ what all its files share (gallery.py). `numpydoc lint` (pyproject.toml), which
is run here, checks every Parameters section that is there: its names, their order, their meanings. Whether a section
must be there depends on the function: one that takes several things has all sections, one that takes one or none may
say in a sentence what it returns. All others say in a sentence what they do, and shapes in a line.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from numpydoc.hooks.validate_docstrings import AstValidator, run_hook

from casahunt.views.pictures.plotting import documented

ROOT = Path(__file__).resolve().parent.parent
SOURCES = sorted(path for folder in ("casahunt", "problems") for path in (ROOT / folder).rglob("*.py"))


ROOMS = ("hybrid", "collocation", "motion", "orbits", "continuation", "servo.parts")


def named_in_an_all() -> set[tuple[str, str]]:
    """(module, name) of what stands in an `__all__`, and of the classes that such ones inherit from."""
    found: set[tuple[str, str]] = set()
    for module in map(import_module, ("casahunt", "casahunt.pictures", *(f"casahunt.{room}" for room in ROOMS))):
        for name in module.__all__:
            one = getattr(module, name)
            found |= {(each.__module__, each.__qualname__) for each in (inspect.isclass(one) and one.__mro__) or (one,)
                      if hasattr(each, "__qualname__")}  # fmt: skip
    return found


PUBLIC = named_in_an_all()


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def functions(path: Path) -> Iterator[tuple[str, ast.FunctionDef, list[ast.AST], bool]]:
    """(name, function, what it stands in, whether it is public) of the functions of a module and its classes."""
    tree = ast.parse(path.read_text(encoding="utf-8"), filename=str(path))
    for outer in [tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))]:
        inside = outer.name if isinstance(outer, ast.ClassDef) else ""
        for node in outer.body:
            if isinstance(node, ast.FunctionDef) and not any(ast.unparse(d) == "overload" for d in node.decorator_list):
                name = f"{inside}.{node.name}" if inside else node.name
                public = path == ROOT / "problems" / "gallery.py" or (module_of(path), inside or name) in PUBLIC
                yield name, node, [tree] if outer is tree else [tree, outer], public and node.name[0] != "_"


def public_functions(path: Path) -> Iterator[tuple[str, ast.FunctionDef, list[ast.AST]]]:
    """(name, function, what it stands in) of the public functions of a module and the methods of its classes."""
    return ((name, node, outer) for name, node, outer, public in functions(path) if public)


def raised(node: ast.AST, caught: frozenset[str] = frozenset()) -> Iterator[str]:
    """Names of the exceptions that a function raises itself and does not catch; "" where a call makes them."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Raise) and child.exc is not None:
            called = child.exc.func if isinstance(child.exc, ast.Call) else child.exc
            name = called.id if isinstance(called, ast.Name) and called.id[0].isupper() else ""
            kind = getattr(builtins, name, None)
            if not caught & {name, *(base.__name__ for base in getattr(kind, "__mro__", ()))}:
                yield name
        elif isinstance(child, ast.Try):
            types = [handler.type for handler in child.handlers if handler.type is not None]
            inside = {name.id for t in types for name in ast.walk(t) if isinstance(name, ast.Name)}
            for part in child.body:
                yield from raised(ast.Module([part], []), caught | inside)
            yield from raised(ast.Module([*child.handlers, *child.orelse, *child.finalbody], []), caught)
        else:
            yield from raised(child, caught)


def as_read(node: ast.FunctionDef) -> ast.FunctionDef:
    """A function with the docstring that users read, to which `picture` adds what is the same in all pictures."""
    for call in node.decorator_list:
        if isinstance(call, ast.Call) and ast.unparse(call.func) == "picture":
            axes = [ast.literal_eval(argument) for argument in call.args] or ["axes"]
            said = ast.Constant(documented(node.body[0].value.value, *axes))
            return ast.fix_missing_locations(ast.copy_location(
                ast.FunctionDef(node.name, node.args, [ast.Expr(said), *node.body[1:]], [], node.returns), node
            ))  # fmt: skip
    return node


def faults(path: Path) -> Iterator[tuple[str, ast.FunctionDef, str]]:
    """(name, function, what is missing) of the public functions of a module."""
    for name, node, outer in public_functions(path):
        node = as_read(node)
        doc = AstValidator(ast_node=node, filename=path, obj_name=name, ancestry=outer)
        several = len(doc.signature_parameters) > 1
        said = []
        missing = [x for x in doc.signature_parameters if x not in doc.doc_all_parameters]
        if missing and (several or doc.doc_parameters):
            said.append(f"says nothing of its parameters {', '.join(missing)}")
        returns = ast.unparse(node.returns) if node.returns else "None"
        section = "Yields" if returns.startswith(("Iterator[", "Generator[")) else "Returns"
        if several and returns not in ("None", "NoReturn") and not doc.doc[section]:
            said.append(f"has no {section} section")
        documented = {word for entry in doc.doc["Raises"] for word in (entry.name or entry.type).split(", ")}
        unsaid = [x for x in dict.fromkeys(raised(node)) if (x not in documented if x else not documented)]
        if unsaid:
            said.append(f"has no Raises entry for {', '.join(x or 'what it raises' for x in unsaid)}")
        if said:
            yield name, node, "; ".join(said)


def test_public_functions_say_what_they_take_return_and_raise():
    assert not [f"{path.stem}.{name}: {said}" for path in SOURCES for name, _, said in faults(path)]


def test_sections_agree_with_signatures():
    assert run_hook([str(path) for path in SOURCES], config=ROOT) == 0  # what `numpydoc lint` prints


def test_other_functions_say_it_in_a_sentence():
    sections = re.compile(r"^\s*(Parameters|Returns|Yields|Raises)\s*\n\s*---", re.M)
    full = [
        f"{path.stem}.{name}"
        for path in SOURCES
        for name, node, _, public in functions(path)
        if not public and sections.search(ast.get_docstring(node) or "")
    ]
    assert not full


def test_no_signature_and_no_public_value_shows_where_it_lies_in_memory():
    """Neither in help() nor on a page of the reference: an address says nothing, and is another one in each run."""
    shown = {}
    for module in map(import_module, ("casahunt", "casahunt.pictures", *(f"casahunt.{room}" for room in ROOMS))):
        for name in module.__all__:
            one = getattr(module, name)
            if not callable(one) or inspect.isclass(one) and issubclass(one, Exception):
                shown[name] = repr(one)
                continue
            methods = [*vars(one).values()] if inspect.isclass(one) else []
            for what in (one, *(method for method in methods if inspect.isfunction(method))):
                shown[f"{name} {what.__name__}"] = str(inspect.signature(what))
    assert not {name: text for name, text in shown.items() if " at 0x" in text}
