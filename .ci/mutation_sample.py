"""Which mutants of a cosmic-ray session are tried, and what the tries say.  Called by .ci/mutate.

    mutation_sample.py choose SESSION [SAMPLE]    at most SAMPLE of every module, drawn with a fixed seed; or all
    mutation_sample.py again SESSION              forget that the survivors survived
    mutation_sample.py score SESSION              killed of tried, for every module and the whole

A larger SAMPLE contains the smaller one: a session is extended by asking again.

Not drawn, because they are no faults or cannot be missed:

    |, &, ^, <<, >> in place of an operator    a TypeError on the first float: killed by any test that comes there
    `is` in place of `==` and back             the same answer
    numbers in messages, annotations, decorators (sizes of caches)
    the star of `def f(*, a)` and of f(*a)     no operators
    the removal of a cache                     time
    strict=, frozen=, eq=, repr=               guards of Python against misuse, not part of an answer
"""

from __future__ import annotations

import ast
import random
import re
import sys
from collections import defaultdict
from pathlib import Path

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkerOutcome, WorkResult

SEED = 20
NOT_DRAWN = WorkResult(output="not drawn", worker_outcome=WorkerOutcome.SKIPPED)
TRIVIAL = re.compile(r".*_(BitOr|BitAnd|BitXor|LShift|RShift)$|.*_BitOr_.*|.*_(Eq_Is|Is_Eq|NotEq_IsNot|IsNot_NotEq)$")
CACHES = ("kept", "lru_cache", "cache")
GUARDS = ("strict", "frozen", "eq", "repr")

Place = tuple[int, int]


class Module:
    """Where in a module a mutant is a fault."""

    def __init__(self, path: str) -> None:
        harmless: list[ast.AST | None] = []
        self.operators: list[tuple[Place, Place]] = []
        for node in ast.walk(ast.parse(Path(path).read_text())):
            if isinstance(node, ast.JoinedStr):
                harmless.append(node)
            elif isinstance(node, ast.AnnAssign | ast.arg):
                harmless.append(node.annotation)
            elif isinstance(node, ast.keyword) and node.arg in GUARDS:
                harmless.append(node.value)
            elif isinstance(node, ast.FunctionDef | ast.ClassDef):
                harmless += [d for d in node.decorator_list if isinstance(d, ast.Call)]
                harmless += [d for d in node.decorator_list if isinstance(d, ast.Name) and d.id in CACHES]
                harmless.append(getattr(node, "returns", None))
            elif isinstance(node, ast.BinOp | ast.AugAssign):
                left, right = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.target, node.value)
                self.operators.append(((left.end_lineno, left.end_col_offset), (right.lineno, right.col_offset)))
        # A decorator begins with its @.
        self.harmless = [((n.lineno, n.col_offset - isinstance(n, ast.Call | ast.Name)),
                          (n.end_lineno, n.end_col_offset)) for n in harmless if n is not None]  # fmt: skip

    def has(self, mutant: MutationSpec) -> bool:
        """False where the mutant would be no fault, or one that every test finds."""
        at = tuple(mutant.start_pos)
        if TRIVIAL.match(mutant.operator_name) or any(begin <= at < end for begin, end in self.harmless):
            return False
        binary = "ReplaceBinaryOperator" in mutant.operator_name
        return not binary or any(begin <= at < end for begin, end in self.operators)


def order(mutant: MutationSpec) -> float:
    """Mutants are drawn in this order: at random, and the same whatever else is in the session."""
    return random.Random(f"{SEED} {mutant.module_path} {mutant.operator_name} {mutant.occurrence}").random()


def faults_of(db: WorkDB) -> dict[str, list[str]]:
    """The jobs that are faults, of every module, in the order in which they are drawn."""
    modules: dict[str, Module] = {}
    faults: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for item in db.work_items:
        (mutant,) = item.mutations
        path = str(mutant.module_path)
        if path not in modules:
            modules[path] = Module(path)
        if modules[path].has(mutant):
            faults[path].append((order(mutant), item.job_id))
    return {path: [job for _, job in sorted(found)] for path, found in sorted(faults.items())}


def choose(db: WorkDB, sample: int | None) -> None:
    """Mark all mutants but those drawn as not drawn; what has been tried stays drawn."""
    results = dict(db.results)
    tried = {job for job, result in results.items() if result.worker_outcome != WorkerOutcome.SKIPPED}
    drawn: set[str] = set(tried)
    for jobs in faults_of(db).values():
        ordered = sorted(jobs, key=lambda job: job not in tried)
        drawn |= set(ordered[:sample])
    everything = {item.job_id for item in db.work_items}
    db.set_multiple_results([job for job in everything - drawn if job not in results], NOT_DRAWN)
    forget(db, [job for job in drawn - tried if job in results])


def forget(db: WorkDB, jobs: list[str]) -> None:
    """The mutants are to be tried (again).  cosmic-ray has no word for it."""
    with db._session_maker.begin() as session:
        from cosmic_ray.work_db import WorkResultStorage

        session.query(WorkResultStorage).where(WorkResultStorage.job_id.in_(jobs)).delete()


def again(db: WorkDB) -> None:
    """Try the survivors again."""
    forget(db, [job for job, result in db.results if result.test_outcome == TestOutcome.SURVIVED])


def score(db: WorkDB) -> None:
    """Killed of tried in every module; the whole is weighted by the number of faults that each module has."""
    outcomes = {job: r.test_outcome for job, r in db.results if r.worker_outcome != WorkerOutcome.SKIPPED}
    faults = faults_of(db)
    tried = {path: [outcomes[job] for job in jobs if job in outcomes] for path, jobs in faults.items()}
    tried = {path: found for path, found in tried.items() if found}
    everything = sum(len(faults[path]) for path in tried)
    killed_of_all = mean = variance = 0.0
    for path, found in tried.items():
        n, N = len(found), len(faults[path])
        killed = sum(outcome != TestOutcome.SURVIVED for outcome in found)
        rate = killed / n
        error = (rate * (1 - rate) / n * (1 - n / N)) ** 0.5
        killed_of_all, mean, variance = killed_of_all + killed, mean + N * rate, variance + (N * error) ** 2
        print(f"{path:45} {killed:4} of {n:4} tried of {N:5}  {rate:5.0%} +- {error:.0%}")
    n = sum(map(len, tried.values()))
    print(f"{'all':45} {killed_of_all:4.0f} of {n:4} tried of {everything:5}  "
          f"{mean / everything:5.0%} +- {variance**0.5 / everything:.0%}")  # fmt: skip


if __name__ == "__main__":
    what, path, *rest = sys.argv[1:]
    with use_db(path, WorkDB.Mode.open) as db:
        if what == "choose":
            choose(db, int(rest[0]) if rest else None)
        else:
            {"again": again, "score": score}[what](db)
