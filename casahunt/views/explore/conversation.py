"""What one page asks and is told: messages of the page in, messages to it out, questions to its worker; no browser.

    in    {n, ask, moved, choose | preset | file | page}     ask: the address of the state; the rest changes it
    out   {kind: state | refused | stage | done | page}      n: to which of the page's messages it belongs
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from ...checks import choice_of
from ...errors import InputError
from .page import frozen_page, state_message
from .state import State, presets, state_of_address, state_of_file
from .worker import DONE, Worker


class Conversation:
    """What one page has asked and been told, without a browser: questions in, messages out.

    worker, tell : who answers, and what takes a message.  Numbers of the worker's questions are its own: it serves one
    page after the other.
    """

    asked = 0

    def __init__(self, first: State, worker: Worker, tell: Callable[[dict[str, Any]], None]) -> None:
        self.first, self.worker, self.tell = first, worker, tell
        self.number, self.question = 0, 0
        self.said: list[dict[str, Any]] = []

    def hear(self, text: str | bytes) -> None:
        """A message of the page."""
        try:
            message = json.loads(text)
            # Half of a pair of surrogates, which no address and no pipe can carry, becomes a question mark.
            message = json.loads(json.dumps(message, ensure_ascii=False).encode("utf-8", "replace"))
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, dict) or not isinstance(message.get("n"), int):
            return
        if message.get("page"):
            self.tell({"kind": "page", "html": frozen_page(self.said)})
            return
        self.number = message["n"]
        try:
            state = self._state(message)
            begun = state_message(state)
        except InputError as why:
            key = _key_in(str(why), str(message.get("moved", "")))
            self.tell({"kind": "refused", "n": self.number, "key": key, "sentence": str(why)})
            return
        self.said = []
        self._say({**begun, "n": self.number})
        Conversation.asked += 1
        self.question = Conversation.asked
        self.worker.ask(self.question, state.address())

    def answered(self, question: int, stage: str, shown: dict[str, Any]) -> None:
        """An answer of the worker."""
        if question == self.question:
            kind = {"kind": "done"} if stage == DONE else {"kind": "stage", "stage": stage}
            self._say({**kind, "n": self.number, "shown": shown})

    def _say(self, message: dict[str, Any]) -> None:
        self.said.append(message)
        self.tell(message)

    def _asked(self, message: Mapping[str, Any]) -> State:
        """The state of the address of a message.  Raises InputError."""
        query = str(message.get("ask", ""))
        return state_of_address(query) if query else self.first

    def _state(self, message: Mapping[str, Any]) -> State:
        """The state that is asked for.  Raises InputError."""
        if "preset" in message:
            return presets()[choice_of("preset", str(message["preset"]), presets())]
        if "file" in message:
            return state_of_file(str(message["file"]), beside=self._asked(message))
        state = self._asked(message)
        choose = message.get("choose")
        if isinstance(choose, list) and len(choose) == 2:
            state = state.choose(str(choose[0]), str(choose[1]))
        return state


def _key_in(sentence: str, moved: str) -> str:
    """The control at which a refusal is said: the one that was moved where it is named, or the first one named."""
    return moved if moved and moved in sentence else sentence.partition(" = ")[0].partition(":")[0]
