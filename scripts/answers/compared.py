"""What differs between two sets of answers, `before` and `after`; and between answers and their truths.

A number differs where it moves by more than the sum of both errors and rounding; what is told by one set alone is
counted, and compared with nothing.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from problems.gallery import compared
from scripts.answers.kept import Answers
from scripts.processors import ROUNDING
from scripts.random_servos import HONEST

KINDS = (
    "refusals that became answers", "answers that became refusals", "given up or errors", "verdicts", "phases",
    "special points", "ends", "numbers", "sentences",
)  # fmt: skip
WORDS = {"phases": "phases", "points": "special points", "missed": "special points", "lost": "special points",
         "invented": "special points", "end": "ends", "sentence": "sentences"}  # fmt: skip
"""Kind of a difference in a word; in all others it is one of verdicts."""
NEAR = 1e-5
"""Special points of two sets are the same within this, in units of the larger of one and the value."""
SLOWER, LONGER = 2.0, 2.0
"""Times as long and seconds more, from which a question is named."""
Row = dict[str, Any]
Differences = dict[str, list[str]]


def state(row: Row) -> str:
    """Whether a question was answered or refused; else what became of it."""
    status: str = row["words"]["status"]
    failed = status in ("given up", "ran away") or status.startswith("error")
    return status if failed else "refused" if status.startswith("refused") else "answered"


def points(row: Row) -> list[tuple[str, float]]:
    """(kind, value) of its special points: the numbers "1, fold", ..."""
    named = [(name.partition(", "), value) for name, (value, _) in row["numbers"].items()]
    return [(kind, value) for (place, _, kind), value in named if place.isdecimal()]


def moved(a: Row, b: Row) -> list[str]:
    """Numbers that differ by more than their errors, or that one has alone."""
    told = []
    for name in dict.fromkeys([*a["numbers"], *b["numbers"]]):
        if name not in a["numbers"] or name not in b["numbers"]:
            told.append(f"{name} {'is new' if name in b['numbers'] else 'is gone'}")
            continue
        (x, dx), (y, dy) = a["numbers"][name], b["numbers"][name]
        if not abs(x - y) <= dx + dy + ROUNDING * max(abs(x), abs(y)):
            told.append(f"{name} {x!r} +- {dx:.1g} -> {y!r} +- {dy:.1g}")
    return told


def changes(a: Row, b: Row) -> dict[str, str]:
    """{kind of difference: in words} of one question."""
    was, now = state(a), state(b)
    if was != now:
        kind = {("refused", "answered"): KINDS[0], ("answered", "refused"): KINDS[1]}.get((was, now), KINDS[2])
        return {kind: f"{said(a)} -> {said(b)}"}
    found: dict[str, str] = {}
    for word in dict.fromkeys([*a["words"], *b["words"]]):
        x, y = a["words"].get(word), b["words"].get(word)
        if x != y:
            kind = WORDS.get(word, "verdicts")
            found[kind] = "; ".join([*filter(None, [found.get(kind)]), f"{word} {x} -> {y}"])
    lost, new = compared(points(b), points(a), NEAR)
    if "special points" in found or lost or new:
        ways = [("lost", *one) for one in lost] + [("new", *one) for one in new]
        named = ", ".join(f"{way} {kind} {value:.9g}" for way, kind, value in ways)
        found["special points"] = named or found["special points"]
    elif numbers := moved(a, b):
        found["numbers"] = "; ".join(numbers)
    return found


def said(row: Row) -> str:
    """A row in short."""
    words = row["words"]
    return str(words.get("sentence") or ", ".join(f"{name} {value}" for name, value in words.items()))


def differences(before: Answers, after: Answers) -> Differences:
    """{kind: lines} of the questions that both were asked."""
    found: Differences = {kind: [] for kind in KINDS}
    for name in before:
        if name in after:
            for kind, how in changes(before[name], after[name]).items():
                found[kind].append(f"{name}: {how}")
    return found


def untrue(answers: Answers) -> list[str]:
    """The answers whose truth is not within `HONEST` of their errors."""
    told = []
    for name, row in answers.items():
        for what, (value, error) in row.get("truth", {}).items():
            if what in row["numbers"]:
                x, dx = row["numbers"][what]
                if not abs(x - value) <= HONEST * dx + error + ROUNDING * abs(value):
                    told.append(f"{name}: {what} {x!r} +- {dx:.1g}, known {value!r}")
        told += [f"{name}: {way} {row['words'][way]}" for way in ("lost", "invented") if row["words"].get(way)]
    return told


def times(before: Answers, after: Answers) -> list[str]:
    """Processor times of each kind, and the questions that take longer."""
    common = [name for name in before if name in after]
    sums: dict[str, Counter[str]] = {}
    for name in common:
        for which, row in (("before", before[name]), ("after", after[name])):
            sums.setdefault(row["kind"], Counter())[which] += row["seconds"]
        sums[after[name]["kind"]]["asked"] += 1
    told = [f"{'':32s}{'asked':>7s}{'before':>10s}{'after':>10s}{'ratio':>8s}"]
    for kind, row in sums.items():
        a, b = row["before"], row["after"]
        told.append(f"{kind:32s}{row['asked']:7.0f}{a:8.1f} s{b:8.1f} s{b / a if a else 1.0:8.2f}")
    for name in common:
        a, b = before[name]["seconds"], after[name]["seconds"]
        if b > SLOWER * a and b > a + LONGER:
            told.append(f"slower: {name}: {a:.1f} s -> {b:.1f} s")
    return told
