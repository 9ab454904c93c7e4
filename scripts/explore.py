"""The page of `casahunt explore` under a person's hands: does its memory grow, and how soon is it answered?

    python scripts/explore.py moves                      5760 random moves: one every 5 s for 8 hours, sped up
    python scripts/explore.py moves --count 500 --seed 2 others
    python scripts/explore.py times                      first numbers and whole page, for moves of each kind

A server of its own is started, as the command does it, and asked as a page asks, through its websocket.

`moves`: most turn one number by a random factor within that of `TURN`, some choose another friction model, controller
or remedy, a servo to begin with, or go back.  The next one follows when the page is complete, or after `--wait`
seconds, as where a slider is dragged; one of `LOOKS` moves waits for the whole page.  Memory is what the kernel says is
resident of the server and of the largest of its workers, of which one that has grown is replaced (worker.py).

`times`: seconds from the message to the first numbers (stage "hunts") and to the last one, of moves one after the
other, so that what is kept from one to the next counts; and what the worker's processor has spent until then (`used`),
which is less where other programs run beside it.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
import re
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import Servo  # noqa: E402
from casahunt.errors import InputError  # noqa: E402
from casahunt.views.explore.page import controls_of  # noqa: E402
from casahunt.views.explore.state import (  # noqa: E402
    State,
    presets,
    remedies_for,
    state_of_address,
    state_of_servo,
)

EIGHT_HOURS = 8 * 3600 // 5
"""Moves of a person who makes one every 5 s."""
TURN = 1.5
"""A number is turned by at most this factor."""
CHANCES = {"turn": 0.80, "remedy": 0.06, "model": 0.04, "controller": 0.02, "preset": 0.03, "back": 0.05}
"""Of the kinds of moves."""
LOOKS = 100
TOLD = 20
"""Lines of memory that are told."""
LONGEST = 120.0
"""Seconds without a word of the server after which the script ends."""
KINDS = {
    "gain": "friction.viscous=0.1&gain=", "friction": "gain=0.2&friction.viscous=",
    "dead band, its size": "gain=0.04&remedy=dead+band&dead_band=",
    "dead band, gain": "remedy=dead+band&dead_band=0.01&gain=",
    "dead band, friction": "gain=0.04&remedy=dead+band&dead_band=0.01&friction.viscous=",
    "leak, its size": "gain=0.04&remedy=leak&leak=", "load": "gain=0.1&load_torque=",
}  # fmt: skip
"""Moves of `times`: what is held, and what is turned."""
VALUES = {"gain": (0.04, 0.05, 0.06), "friction.viscous": (0.09, 0.1, 0.11), "dead_band": (0.008, 0.009, 0.01),
          "leak": (0.08, 0.09, 0.1), "load_torque": (0.05, 0.1, 0.15)}  # fmt: skip


class Page:
    """A page without a browser: a websocket to a server of its own, and the process ids behind it."""

    def __init__(self, process: Any, socket: Any) -> None:
        self.process, self.socket, self.number = process, socket, 0

    async def move(self, message: dict[str, Any], wait: float = LONGEST) -> dict[str, float]:
        """Send a move and hear its answers for so long: {stage: seconds}, with "done" where the page is complete."""
        self.number += 1
        used, began, heard = processor_seconds(self.workers()), time.monotonic(), {}
        await self.socket.write_message(json.dumps({"n": self.number, **message}))
        while "done" not in heard and (left := began + wait - time.monotonic()) > 0:
            try:
                text = await asyncio.wait_for(asyncio.shield(self._next()), left)
            except TimeoutError:
                break
            if text is None:
                raise SystemExit("the server has closed the page")
            self._reading = None
            told = json.loads(text)
            if told.get("n") == self.number:
                if told["kind"] == "refused":
                    heard["refused"] = heard["done"] = time.monotonic() - began
                stage = told.get("stage", told["kind"])
                heard[stage] = time.monotonic() - began
                heard[f"{stage} used"] = processor_seconds(self.workers()) - used
        return heard

    _reading: Any = None

    def _next(self) -> Any:
        """The message that comes next, kept where nobody has waited for it to the end."""
        if self._reading is None:
            self._reading = asyncio.ensure_future(self.socket.read_message())
        return self._reading

    def workers(self) -> list[int]:
        """Process ids of the workers, that of the page and the one that waits for the next page."""
        tasks = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        children = sorted({int(pid) for task in tasks for pid in task.read_text().split()})
        return [pid for pid in children if b"spawn_main" in _command(pid)]

    def memory(self) -> tuple[float, float]:
        """Megabytes resident of the server, and of the largest of its workers."""
        return resident(self.process.pid), max((resident(pid) for pid in self.workers()), default=0.0)


def _command(pid: int) -> bytes:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def resident(pid: int) -> float:
    """Megabytes of a process that are in memory; 0 where it has ended."""
    try:
        text = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    found = re.search(r"VmRSS:\s+(\d+) kB", text)
    return int(found[1]) / 1e3 if found else 0.0


def processor_seconds(pids: list[int]) -> float:
    """What processes have used."""
    total = 0
    for pid in pids:
        with suppress(OSError):
            total += int(Path(f"/proc/{pid}/schedstat").read_text().split()[0])
    return total / 1e9


@asynccontextmanager
async def opened() -> AsyncIterator[Page]:
    """A server in a process of its own, and a page of it."""
    command = [sys.executable, "-m", "casahunt", "explore", "--no-browser"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        address = ""
        while not (found := re.search(r"http://([^/\s]+)/", address)):
            address = process.stdout.readline()
            if not address and process.poll() is not None:
                raise SystemExit("casahunt explore has not begun")
        host = found[1]
        request = HTTPRequest(f"ws://{host}/answers", headers={"Origin": f"http://{host}"})
        socket = await websocket_connect(request, max_message_size=2**24)
        yield Page(process, socket)
    finally:
        process.terminate()
        said = process.communicate()[0].splitlines()
        print(*(line for line in said if "takes its place" in line), sep="\n")  # why a worker was replaced


def next_move(state: State, past: list[State], r: random.Random) -> State:
    """The state after a random move, which may be none that a servo has."""
    kind = r.choices(list(CHANCES), list(CHANCES.values()))[0]
    if kind == "back" and past:
        return past.pop()
    if kind == "preset" or state.is_loop and r.random() < 0.1:
        return r.choice([state_of_servo(Servo()), *presets().values()])
    if kind in ("remedy", "model", "controller") and not state.is_loop:
        choices = {"remedy": ["", *remedies_for(state.model)], "model": ["switch", "lugre"],
                   "controller": ["times", "gains"]}  # fmt: skip
        return state.choose(kind, r.choice(choices[kind]))
    control = r.choice(controls_of(state))
    value = control.value or r.choice((control.low, -control.low, 0.0))
    if abs(value) < float("inf"):
        value = float(f"{value * TURN ** r.uniform(-1, 1):.4g}")
    return State({**state.values, control.key: value}, state.model, state.remedy, state.parts)


async def moves(count: int, seed: int, wait: float) -> int:
    """Random moves, and the memory on the way."""
    r, state, past = random.Random(seed), state_of_servo(Servo()), []
    complete = refused = 0
    seen: set[int] = set()
    began = time.monotonic()
    print("moves    minutes  server [MB]  worker [MB]  workers so far  complete")
    async with opened() as page:
        await page.move({"ask": state.address()})
        for k in range(count + 1):
            seen |= set(page.workers())
            if k % max(1, count // TOLD) == 0:
                server, worker = page.memory()
                minutes = (time.monotonic() - began) / 60
                print(f"{k:5d} {minutes:10.1f} {server:12.0f} {worker:12.0f} {len(seen):15d} {complete:9d}", flush=True)
            try:
                following = next_move(state, past, r)
                assert following.problem
            except InputError:
                following = None  # the page would say so at the control
            if following is None:
                refused += 1
                continue
            past = [*past[-20:], state]
            state = following
            heard = await page.move({"ask": state.address()}, wait if r.random() > 1 / LOOKS else LONGEST)
            complete += "done" in heard
    print(f"{count} moves, {complete} of them answered to the end, {refused} refused")
    return 0


async def times() -> int:
    """First numbers and the whole page, of moves of each kind."""
    print(f"{'model':8s}{'moved':22s}{'first':>8s}{'used':>8s}{'whole':>10s}{'used':>8s}   [ms, ms, s, s]")
    async with opened() as page:
        await page.move({"ask": "gain=0.1"})
        for model in ("switch", "lugre"):
            for kind, query in KINDS.items():
                key = query.rpartition("&")[2].rstrip("=")
                await page.move({"ask": f"model={model}&{query}{VALUES[key][0]!r}"})
                for value in VALUES[key][1:]:
                    address = f"model={model}&{query}{value!r}"
                    assert state_of_address(address).problem
                    heard = await page.move({"ask": address})
                    first, used = 1e3 * heard["hunts"], 1e3 * heard["hunts used"]
                    whole, all_used = heard["done"], heard["done used"]
                    print(f"{model:8s}{kind:22s}{first:8.0f}{used:8.0f}{whole:10.2f}{all_used:8.2f}", flush=True)
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("moves", "times"))
    parser.add_argument("--count", type=int, default=EIGHT_HOURS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--wait", type=float, default=0.25, help="[s] at most from one move to the next (default 0.25)")
    asked = parser.parse_args(arguments)
    return asyncio.run(moves(asked.count, asked.seed, asked.wait) if asked.what == "moves" else times())


if __name__ == "__main__":
    sys.exit(main())
