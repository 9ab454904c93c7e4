"""Ways to one end, tried in turn: a table of named strategies in place of a ladder of attempts.

A strategy knows when it is worth a try, what it costs and how it goes.  `first_of` goes through a table and gives what
the first one finds.  A denial, NoOrbit without a status, ends the search: what is shown to be absent is not sought any
further.  Where all of them have failed, the refusal is the sentence of the one that came farthest (a cycle met and not
computed tells more than "not found"), and it names the others that were tried, each with how it ended.  Where one alone
was tried, it is that one's sentence and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from ..errors import NoOrbit, Status

Q = TypeVar("Q")
R = TypeVar("R")


def always(_: object) -> bool:
    """The condition of a strategy that is always worth a try."""
    return True


@dataclass(frozen=True)
class Strategy(Generic[Q, R]):
    """One way to answer a question.

    Attributes
    ----------
    name : in words that a refusal can use, such as "down from the fold".
    when : the condition under which it is tried, in words.
    cost : order of magnitude of the time it takes, measured on one core for the servo of problems/table1.py.
    run : from the question to the answer, to a sentence that says how it ended without one, or to None where it turns
        out that there was nothing to try; NoOrbit ends it too.
    applies : the condition itself.
    """

    name: str
    when: str
    cost: str
    run: Callable[[Q], R | str | None]
    applies: Callable[[Q], bool] = always


@dataclass(frozen=True)
class Ended:
    """How a strategy ended without an answer: its name, in words, and the status where it has refused; its evidence."""

    name: str
    how: str
    status: Status | None
    evidence: str = ""


def first_of(strategies: Sequence[Strategy[Q, R]], question: Q, what: str) -> R:
    """The answer of the first strategy that has one.

    strategies, question: the table, and what every row of it is asked; what: the beginning of the refusal where no
    strategy has a sentence of its own; how they ended follows it.
    Raises NoOrbit: a strategy denied that there is one (status None), or all that apply have failed.
    """
    ended: list[Ended] = []
    for strategy in strategies:
        if not strategy.applies(question):
            continue
        try:
            answer = strategy.run(question)
        except NoOrbit as refusal:
            if refusal.status is None:
                raise
            ended.append(Ended(strategy.name, refusal.plain, refusal.status, refusal.evidence))
            continue
        if isinstance(answer, str):
            ended.append(Ended(strategy.name, answer, None))
        elif answer is not None:
            return answer
    raise refused(ended, what)


def refused(ended: Sequence[Ended], what: str) -> NoOrbit:
    """The refusal of a table of which every row ended without an answer.

    ended: how the rows ended, in the order of the table; what: the beginning of the sentence where no row has one of
    its own. Returns NoOrbit, to be raised; its status is that of the row that leads the sentence.
    """
    met = [e for e in ended if e.status is not None]
    lead = next((e for e in reversed(met) if e.status is not Status.NOT_FOUND), met[-1] if met else None)
    others = [e for e in ended if e is not lead]
    if lead is None:
        named = others[0].how if len(others) == 1 else "; ".join(f"{e.name} {e.how}" for e in others)
        return NoOrbit(f"{what} {named}", Status.NOT_FOUND)
    also = "tried besides: " + "; ".join(f"{e.name}: {e.how}" for e in others) if others else ""
    return NoOrbit(lead.how, lead.status, evidence="; ".join(filter(None, (lead.evidence, also))))
