"""What the page shows of a state, in stages: the first numbers first, each stage as plain numbers and texts.

    hunts     does it hunt: sentence, amplitude, period; one period of angle, velocity and torque
    linear    friction curve, margins of the loop without dry friction
    border    the gain, or the size of the remedy, at which hunting ends, and how far off that is
    step      a step of the set point as simulated, with its largest torque
    diagram   amplitude against gain, stable and unstable

Each stage has so much work (effort.py), and is given up beyond it; what is not found is a sentence in its place
(numbers.py).  What does not depend on the gain, or on the size of the remedy, is kept for the next move, which as a
rule changes that alone; what is shown does not depend on the moves before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from ... import effort
from ...errors import InputError, NoOrbit
from .kinds import LoopAnswers, ServoAnswers
from .numbers import refused
from .state import SET_POINT, State

STAGES = ("hunts", "linear", "border", "step", "diagram")
MOST_WORK_OF_A_STAGE = 2e5
"""Work (effort.py): five seconds of a processor for a servo, up to forty for a loop with a bristle and a remedy; what a
stage shows does not hang on the seconds."""
GOES_ON = "the command line goes on longer"
MOST_KEPT = 16
"""Servos, at whatever gain or whatever size of a remedy, of which borders and diagrams are kept."""
MOST_FOUND = 12
"""Borders and diagrams that are kept of each: a person turns a gain for hours, and where there is no fold a diagram
begins below it, wherever it is."""


class Latest(dict[Any, Any]):
    """A dictionary of no more than so many entries: those that were set or read last."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self._most = most

    def __getitem__(self, key: Any) -> Any:
        value = self.pop(key)
        super().__setitem__(key, value)
        return value

    def __setitem__(self, key: Any, value: Any) -> None:
        self.pop(key, None)
        super().__setitem__(key, value)
        while len(self) > self._most:
            del self[next(iter(self))]


class Answers:
    """Answers one state after the other, and remembers what does not depend on the gain."""

    def __init__(self) -> None:
        self._kept = Latest(MOST_KEPT)

    def of(self, state: State, dropped: Callable[[], bool] | None = None) -> Iterator[tuple[str, dict[str, Any]]]:
        """(stage, what it shows) of a state, in order; "hunts" again where the border has led to a cycle.

        dropped: says whether nobody waits any more. Raises effort.Dropped: so it is.
        """
        problem = state.problem
        kind: Any = (LoopAnswers if problem.loop is not None else ServoAnswers)(problem, partial(self._memory, state))
        for stage in STAGES:
            if dropped is not None and dropped():
                raise effort.Dropped
            try:
                with effort.counting_work(None, limit=MOST_WORK_OF_A_STAGE, dropped=dropped):
                    found = getattr(kind, stage)()
            except (NoOrbit, InputError) as why:
                found = refused(why)
            except effort.GivenUp as why:
                found = {"why": f"given up, because it takes too long here; {GOES_ON}", "evidence": str(why)}
            except ArithmeticError as why:  # an extreme servo, beyond what was thought of
                found = {"why": f"could not be computed: {why}"}
            if stage == "diagram" and "why" in found and "stable" not in found:
                found = kind.so_far() | found
            if stage == "hunts" and "sentence" not in found:
                found |= {"verdict": "unknown", "sentence": "Whether it hunts is not known."}
            if stage == "border" and kind.later:
                yield "hunts", kind.later
            yield stage, found

    def _memory(self, state: State, *free: str) -> dict[Any, Any]:
        """What is known of the servo whatever the numbers `free` are."""
        values = tuple((key, value) for key, value in state.values.items() if key not in (*free, SET_POINT))
        key = (free, values, state.model, state.remedy, repr(state.parts))
        if key not in self._kept:
            self._kept[key] = Latest(MOST_FOUND)
        memory: dict[Any, Any] = self._kept[key]
        return memory
