"""Which mutants of a cosmic-ray session are tried, and what the tries say.  Called by .ci/mutate.

    mutation_sample.py choose SESSION [SAMPLE]    at most SAMPLE of every module, drawn with a fixed seed; or all
    mutation_sample.py again SESSION              forget that the survivors survived
    mutation_sample.py score SESSION              killed of tried, for every module and the whole

A larger SAMPLE contains the smaller one: a session is extended by asking again.

Not drawn, because they are no faults or cannot be missed:

    |, &, ^, <<, >> in place of an operator    a TypeError on the first float: killed by any test that comes there
    `is` in place of `==` and back             the same answer
    numbers in messages, annotations, decorators (sizes of caches)
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


def no_faults(source: str) -> list[tuple[Place, Place]]:
    """Stretches of a module where a mutant is no fault: (row, column) of begin and end."""
    nodes: list[ast.AST | None] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.JoinedStr):
            nodes.append(node)
        elif isinstance(node, ast.AnnAssign | ast.arg):
            nodes.append(node.annotation)
        elif isinstance(node, ast.keyword) and node.arg in GUARDS:
            nodes.append(node.value)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            nodes += [decorator for decorator in node.decorator_list if isinstance(decorator, ast.Call)]
            nodes += [d for d in node.decorator_list if isinstance(d, ast.Name) and d.id in CACHES]
            nodes.append(getattr(node, "returns", None))
    return [((n.lineno, n.col_offset - isinstance(n, ast.Call | ast.Name)), (n.end_lineno, n.end_col_offset))
            for n in nodes if n is not None]  # fmt: skip


def is_fault(mutant: MutationSpec, harmless: list[tuple[Place, Place]]) -> bool:
    """False where it would be no fault, or one that every test finds."""
    if TRIVIAL.match(mutant.operator_name):
        return False
    return not any(begin <= tuple(mutant.start_pos) < end for begin, end in harmless)


def choose(db: WorkDB, sample: int | None) -> None:
    """Mark all mutants but those drawn as not drawn."""
    modules: dict[str, list[tuple[MutationSpec, str]]] = defaultdict(list)
    for item in db.work_items:
        modules[str(item.mutations[0].module_path)].append((item.mutations[0], item.job_id))
    results = dict(db.results)
    for path, mutants in sorted(modules.items()):
        harmless = no_faults(Path(path).read_text())
        mutants.sort(key=lambda m: (m[0].operator_name, m[0].occurrence))
        faults = [job for mutant, job in mutants if is_fault(mutant, harmless)]
        random.Random(SEED).shuffle(faults)
        drawn = set(faults[:sample])
        left_out = [job for _, job in mutants if job not in drawn]
        db.set_multiple_results([job for job in left_out if job not in results], NOT_DRAWN)
        forget(db, [job for job in drawn if job in results and results[job].worker_outcome == WorkerOutcome.SKIPPED])


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
    faults: dict[str, int] = defaultdict(int)
    tried: dict[str, int] = defaultdict(int)
    killed: dict[str, int] = defaultdict(int)
    harmless: dict[str, list[tuple[Place, Place]]] = {}
    results = dict(db.results)
    for item in db.work_items:
        (mutant,) = item.mutations
        path = str(mutant.module_path)
        if path not in harmless:
            harmless[path] = no_faults(Path(path).read_text())
        faults[path] += is_fault(mutant, harmless[path])
        result = results.get(item.job_id)
        if result is not None and result.worker_outcome != WorkerOutcome.SKIPPED:
            tried[path] += 1
            killed[path] += result.test_outcome != TestOutcome.SURVIVED
    mean = variance = 0.0
    for path in sorted(tried):
        rate, weight = killed[path] / tried[path], faults[path] / sum(faults[p] for p in tried)
        error = (rate * (1 - rate) * (1 - tried[path] / max(faults[path], 1)) / tried[path]) ** 0.5
        mean, variance = mean + weight * rate, variance + (weight * error) ** 2
        print(f"{path:45} {killed[path]:4} of {tried[path]:4} tried of {faults[path]:5}  {rate:5.0%} +- {error:.0%}")
    print(f"{'all':45} {sum(killed.values()):4} of {sum(tried.values()):4} tried of {sum(faults[p] for p in tried):5}"
          f"  {mean:5.0%} +- {variance**0.5:.0%}")  # fmt: skip


if __name__ == "__main__":
    order, path, *rest = sys.argv[1:]
    with use_db(path, WorkDB.Mode.open) as db:
        if order == "choose":
            choose(db, int(rest[0]) if rest else None)
        else:
            {"again": again, "score": score}[order](db)
