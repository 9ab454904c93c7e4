"""A corpus of answers: what changed between two versions of the package.  It is no proof of what is right.

    python scripts/corpus.py FOLDER [--part K/N] [--servos N] [--tasks N] [--loops N] [--kind WORD ...]
                                    [--against FILE | FOLDER | CHECKOUT] [--sentences]

Asked are Table 1 at four gains, 300 random servos of both models, 30 tasks of scripts/tuning.py, 40 loops of parts and
the files of problems/ (answers/): fold, stable and unstable cycle, special points of the diagram, verdicts of motions,
basin, margins; of fewer the loop as built, sets, lopsided pairs and each remedy (VERBS in answers/verbs.py says of how
many).  Every answer is a status, words (sequence of phases, special points, verdicts) and numbers with their absolute
errors; where an independent program knows it, its truth.  Tolerances are the package's own defaults.

FOLDER gets a line per answer as it comes (part-K-of-N.jsonl); a run asks what the folder does not hold yet, and writes
all of it to FOLDER/answers.json.  A question is given up after counted work, at the same place on every machine.  All
take nearly two hours on two cores (--part 1/2 and 2/2 at once), extrapolated from the processor time of each kind over
8 servos; what is dear (remedies, lopsided pairs, the loop as built, corners) is asked of 15 to 38 servos each.  With
--servos 8 --tasks 3 --loops 1 it takes some twenty minutes of processor time.

--against: the answers of an earlier run, or another checkout, whose own scripts/corpus.py is run on the same choice
into FOLDER/against.  What stands there is `before`.  Exit code 1 if a verdict, phases, special points, an end, or a
number beyond the sum of both errors differs, or a refusal became an answer or the reverse; or if a truth is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from scripts.answers import kept, loops, servos  # noqa: E402
from scripts.answers.compared import differences, times, untrue  # noqa: E402
from scripts.answers.questions import TASKS, answered, groups  # noqa: E402


def ask(folder: Path, args: argparse.Namespace) -> kept.Answers:
    """Ask what is not there yet; all answers of the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    of = folder / "tree"
    if of.exists() and of.read_text(encoding="ascii") != kept.tree():
        raise SystemExit(f"{folder} holds answers of another tree; name another folder, or delete it")
    of.write_text(kept.tree(), encoding="ascii")
    k, n = map(int, args.part.split("/"))
    known = {row["question"] for row in kept.lines(folder)}
    with (folder / f"part-{k}-of-{n}.jsonl").open("a", encoding="ascii") as file:
        if file.tell():
            file.write("\n")  # behind a line that was cut
        for i, (subject, questions) in enumerate(groups(args.servos, args.tasks, args.loops)):
            for question in questions() if i % n == k - 1 else ():
                if question.name in known or not any(word in question.kind for word in args.kind):
                    continue
                began = time.process_time()
                row = {"question": question.name, "kind": question.kind, **answered(question)}
                row["seconds"] = round(time.process_time() - began, 3)
                file.write(json.dumps(row, allow_nan=False) + "\n")
                file.flush()
            print(subject, file=sys.stderr, flush=True)
    return kept.merged(folder)


def other(folder: Path, argv: Sequence[str], against: Path) -> kept.Answers:
    """The answers to compare with: a file, a folder, or those of another checkout."""
    if not against.is_dir() or (against / kept.MERGED).exists():
        return kept.read(against)
    script = against / "scripts" / "corpus.py"
    if not script.exists():
        raise SystemExit(f"{against} has neither {kept.MERGED} nor scripts/corpus.py: copy scripts/corpus.py, "
                         "scripts/answers and the scripts that they import into that checkout")  # fmt: skip
    there = folder / "against"
    subprocess.run([sys.executable, script, there.resolve(), *argv], cwd=against, check=True,
                   env=os.environ | {"PYTHONPATH": str(against)})  # fmt: skip
    return kept.read(there)


def main(arguments: Sequence[str] | None = None) -> int:
    """Ask, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--part", default="1/1")
    parser.add_argument("--servos", type=int, default=servos.SERVOS)
    parser.add_argument("--tasks", type=int, default=TASKS)
    parser.add_argument("--loops", type=int, default=loops.EACH, help="of each kind")
    parser.add_argument("--kind", nargs="+", default=[""], help="kinds that contain a word: fold, remedy, ...")
    parser.add_argument("--against", type=Path)
    parser.add_argument("--sentences", action="store_true", help="also sentences of refusals that changed")
    args = parser.parse_args(arguments)
    answers = ask(args.folder, args)
    wrong = untrue(answers)
    truths = sum(bool(row.get("truth")) for row in answers.values())
    print(f"{len(answers)} answers, {sum(row['seconds'] for row in answers.values()):.0f} s of processor time; "
          f"{truths} have a truth, missed:", len(wrong), *wrong, sep="\n  ")  # fmt: skip
    if args.against is None:
        return int(bool(wrong))
    choice = [f"--{name}={getattr(args, name)}" for name in ("part", "servos", "tasks", "loops")]
    before = other(args.folder, [*choice, "--kind", *args.kind], args.against)
    found = differences(before, answers)
    print(f"asked in both {len(before.keys() & answers.keys())}, before alone {len(before.keys() - answers.keys())}, "
          f"after alone {len(answers.keys() - before.keys())}")  # fmt: skip
    for kind, lines in found.items():
        print(f"{kind}: {len(lines)}", *(lines if kind != "sentences" or args.sentences else ()), sep="\n  ")
    print(*times(before, answers), sep="\n")
    return int(bool(wrong) or any(lines for kind, lines in found.items() if kind != "sentences"))


if __name__ == "__main__":
    raise SystemExit(main())
