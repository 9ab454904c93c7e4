"""The server of the page: it sends a handful of files, and answers each page by a worker of its own.

    GET /, /page.js, /page.css, /bokeh.js   what is in a table, by name: no path of an address becomes one of a file
    websocket /answers                      a conversation, in JSON

Who may connect: by default this machine alone, since the server listens at 127.0.0.1.  A page of another site, open in
the same browser, may not: its Origin is another one, and where it has made its own name point here, the Host is.  The
Host is looked at first, by every handler (`prepare`): of an Origin that agrees with it nothing is asked.  An address
in numbers is nobody's to give away: a server that listens at all of them (0.0.0.0) answers to these and to its own
name.  So many pages at once (`MOST_PAGES`), messages so long (`LONGEST_MESSAGE`), work so much for each stage
(answers.py).

Only this module imports tornado, when a page is asked for.

What one page asks and is told: messages of the page in, messages to it out, questions to its worker; no browser.

in    {n, ask, moved, choose | preset | file | page}     ask: the address of the state; the rest changes it
out   {kind: state | refused | stage | done | page}      n: to which of the page's messages it belongs
"""

from __future__ import annotations

import asyncio
import ipaddress
import json
import re
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

from ...checks import choice_of
from ...errors import InputError
from ...export import extra
from ...servo.servo import LARGEST_TOML
from .page import STATIC, frozen_page, page, state_message, static
from .state import State, presets, state_of_address, state_of_file
from .worker import DONE, Worker

THIS_MACHINE = "127.0.0.1"
HOST = re.compile(r"(\[[^@/\[\]]+\]|[^:@/\[\]]+)(?::[0-9]+)?")
"""A name, or an address, and perhaps a port, as a browser says them."""
LOCAL_NAMES = ("127.0.0.1", "localhost", "::1")
"""What this machine calls itself."""
EVERYWHERE = ("", "0.0.0.0", "::")
"""Hosts that are all addresses of the machine."""
FIRST_PORT, PORTS_TRIED = 8765, 20
"""Where no port is asked for: the first free one of these."""
MOST_PAGES = 6
"""Pages at once: each has a process of its own."""
LONGEST_MESSAGE = int(7 * LARGEST_TOML)
"""Bytes of a message: a servo file in JSON, where a character has six, and an address."""
SPARE, SPARE_AFTER = 1, 3.0
"""Workers that wait for a page, since a process takes a second to begin.  The next one begins when a page has been
answered, so that it does not compete with the first answer; or so many seconds after a page came that asks nothing."""
TENDED_EVERY = 1000
"""Milliseconds between two looks at the workers."""
FAREWELL = 0.1
"""Seconds for the pages to hear that the server ends."""
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; "
    "connect-src 'self' ws: wss:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*",
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store",
}  # fmt: skip
"""Nothing is loaded from elsewhere; a notebook of this machine may show the page inside of its own."""


class Server:
    """The server of one `casahunt explore`; made, it listens.

    first : the state that a page without an address begins with.

    Raises InputError: the port is taken, or what the page needs is not installed.
    """

    def __init__(self, first: State, *, host: str = THIS_MACHINE, port: int | None = None) -> None:
        self.first, self.host = first, host
        assert first.problem
        page()  # whatever is not installed is said before anything begins
        self._spare: list[Worker] = []
        self._pages: set[Any] = set()
        self._socket, self.port = _listening(host, port)
        self.loop: Any = None
        self._begun = threading.Event()

    @property
    def address(self) -> str:
        """Of the page."""
        name = self.host if self.host not in EVERYWHERE else THIS_MACHINE
        return f"http://{f'[{name}]' if ':' in name else name}:{self.port}/?{self.first.address()}"

    @property
    def names(self) -> tuple[str, ...]:
        """What it answers to, beside any address in numbers where it listens at all of them."""
        own = (socket.gethostname(),) if self.host in EVERYWHERE else (self.host,)
        return tuple(dict.fromkeys(name.lower() for name in (*LOCAL_NAMES, *own)))

    def opened(self) -> str:
        """What others than this machine are let in to, in a sentence; "" where nobody is."""
        at = self._socket.getsockname()[0]
        if ipaddress.ip_address(at.partition("%")[0]).is_loopback:
            return ""
        everywhere = self.host in EVERYWHERE
        return (
            f"whoever reaches {'any address of this machine' if everywhere else at} may open the page, compute here "
            f"and see this servo, without a password; it answers to {'addresses in numbers and ' if everywhere else ''}"
            f"the names {', '.join(self.names)}: for another one give that as --host"
        )

    def run(self) -> None:
        """Serve until `close`."""
        asyncio.run(self._serve())

    def start(self) -> None:
        """Serve in a thread of its own, as a notebook needs it."""
        threading.Thread(target=self.run, daemon=True).start()
        self._begun.wait()

    def close(self) -> None:
        """End it, from any thread."""
        if self.loop is not None:
            with suppress(RuntimeError):  # it has ended
                self.loop.call_soon_threadsafe(self._ended.set)

    async def _serve(self) -> None:
        httpserver, ioloop = (extra(f"tornado.{name}", "explore", "explore") for name in ("httpserver", "ioloop"))
        self.loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        served = httpserver.HTTPServer(self._application(), max_body_size=LONGEST_MESSAGE)
        served.add_socket(self._socket)
        self._spare.append(Worker(_to_nobody))
        tended = ioloop.PeriodicCallback(self._tend, TENDED_EVERY)
        tended.start()
        self._begun.set()
        try:
            await self._ended.wait()
        finally:
            tended.stop()
            served.stop()
            workers = [*self._spare, *(shown.worker for shown in self._pages if shown.worker)]
            for shown in list(self._pages):
                shown.close()
            await asyncio.sleep(FAREWELL)
            await served.close_all_connections()
            for worker in workers:
                worker.close()

    def _application(self) -> Any:
        web = extra("tornado.web", "explore", "explore")
        files = _files(self)
        named = [(f"/{name}", files, {"name": name}) for name in ("", *STATIC)]
        return web.Application(
            [*named, ("/answers", _answers(self))],
            websocket_max_message_size=LONGEST_MESSAGE, websocket_ping_interval=20,
        )  # fmt: skip

    def _tend(self) -> None:
        for shown in self._pages:
            if shown.worker is not None:
                shown.worker.tend()

    def may_ask(self, host: str) -> bool:
        """Whether somebody who calls this server so is meant to: not where another site has given it its own name."""
        told = HOST.fullmatch(host.lower())
        name = told[1].strip("[]") if told else ""
        if name not in self.names and self.host in EVERYWHERE:
            with suppress(ValueError):  # no address of the network itself
                return bool(ipaddress.ip_address(name))
        return name in self.names

    def enter(self, shown: Any) -> Worker | None:
        """A worker for a page; None where there are too many."""
        if len(self._pages) >= MOST_PAGES:
            return None
        self._pages.add(shown)
        worker = self._spare.pop() if self._spare else Worker(_to_nobody)
        worker.hears(shown.heard)
        self.loop.call_later(SPARE_AFTER, self.one_more)
        return worker

    def one_more(self) -> None:
        """A worker for the page that comes next."""
        if len(self._spare) < SPARE and len(self._pages) < MOST_PAGES and not self._ended.is_set():
            self._spare.append(Worker(_to_nobody))

    def leave(self, shown: Any) -> None:
        """A page is closed: its worker waits for the next one, or ends."""
        self._pages.discard(shown)
        worker, shown.worker = shown.worker, None
        if worker is None:
            return
        worker.hears(_to_nobody)
        worker.rest()
        if len(self._spare) < SPARE:
            self._spare.append(worker)
        else:
            threading.Thread(target=worker.close, daemon=True).start()


def _to_nobody(number: int, stage: str, shown: dict[str, Any]) -> None:
    """What nobody hears any more."""


def _listening(host: str, port: int | None) -> tuple[socket.socket, int]:
    """A socket, and its port: the one that was asked for, or the first free one.  Raises InputError: it is taken."""
    why = ""
    for one in range(FIRST_PORT, FIRST_PORT + PORTS_TRIED) if port is None else [port]:
        try:
            family, *_, at = socket.getaddrinfo(host, one, type=socket.SOCK_STREAM)[0]
            made = socket.create_server(at[:2], family=family)
        except OSError as error:
            why = error.strerror or str(error)
            continue
        made.setblocking(False)
        return made, made.getsockname()[1]
    asked = f"port = {port}" if port is not None else f"ports from {FIRST_PORT} on"
    raise InputError(f"{asked} at {host}: cannot be listened at ({why}); give another --port")


def _looked_at(server: Server) -> Any:
    """What every handler does first: whoever calls this server by a name that is not its own is sent away."""
    web = extra("tornado.web", "explore", "explore")

    def prepare(handler: Any) -> None:
        if server.may_ask(handler.request.host):
            return
        handler.set_status(403)
        handler.set_header("Content-Type", "text/plain; charset=utf-8")
        handler.finish(f"casahunt explore answers to {', '.join(server.names)}; start it with --host and the name that "
                       "it is to answer to.")  # fmt: skip
        raise web.Finish

    return prepare


def _files(server: Server) -> Any:
    """The class of tornado that serves files."""
    web = extra("tornado.web", "explore", "explore")

    class Files(web.RequestHandler):  # type: ignore[name-defined]
        """One file of the table."""

        prepare = _looked_at(server)

        def initialize(self, name: str) -> None:
            self.name = name

        def set_default_headers(self) -> None:
            for header, value in HEADERS.items():
                self.set_header(header, value)

        def get(self) -> None:
            self.set_header("Content-Type", f"{STATIC.get(self.name, 'text/html')}; charset=utf-8")
            self.finish(static(self.name) if self.name else page())

    return Files


def _answers(server: Server) -> Any:
    """The class of tornado that answers a page."""
    websocket = extra("tornado.websocket", "explore", "explore")

    class Answers(websocket.WebSocketHandler):  # type: ignore[name-defined]
        """One page."""

        prepare = _looked_at(server)
        worker: Worker | None = None
        talk: Conversation | None = None

        def open(self, *_: Any) -> None:
            self.worker = server.enter(self)
            if self.worker is None:
                sentence = f"{MOST_PAGES} pages are open already: close one of them, then load this one again."
                self.write_message(json.dumps({"kind": "full", "sentence": sentence}))
                self.close(1013)  # try again later
                return
            self.talk = Conversation(server.first, self.worker, self._tell)

        def on_message(self, message: str | bytes) -> None:
            if self.talk is not None:
                self.talk.hear(message)

        def on_close(self) -> None:
            server.leave(self)

        def heard(self, question: int, stage: str, shown: dict[str, Any]) -> None:
            """In the worker's thread."""
            if self.talk is not None:
                with suppress(RuntimeError):  # the server has ended
                    server.loop.call_soon_threadsafe(partial(self.talk.answered, question, stage, shown))
                    if stage == DONE:
                        server.loop.call_soon_threadsafe(server.one_more)

        def _tell(self, message: dict[str, Any]) -> None:
            with suppress(websocket.WebSocketClosedError):
                sent = self.write_message(json.dumps(message, allow_nan=False))
                sent.add_done_callback(lambda end: end.exception())  # of a page that closes meanwhile

    return Answers


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
            # Said at the control that was moved where it is named, or the first one named
            said, moved = str(why), str(message.get("moved", ""))
            key = moved if moved and moved in said else said.partition(" = ")[0].partition(":")[0]
            self.tell({"kind": "refused", "n": self.number, "key": key, "sentence": said})
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
