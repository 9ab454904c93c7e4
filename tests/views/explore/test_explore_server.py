"""The server of the page, without a browser: what is sent, who may ask, how many; what one page is told."""

from __future__ import annotations

import contextlib
import gc
import http.client
import json
import re
import socket
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from casahunt import InputError, Servo
from casahunt.servo.servo import LARGEST_TOML
from casahunt.views.explore.server import Conversation
from casahunt.views.explore.state import presets, state_of_address, state_of_servo
from casahunt.views.explore.worker import DONE

pytest.importorskip("bokeh", reason='the page is drawn by Bokeh: python -m pip install "casahunt[explore]"')
pytest.importorskip("tornado")

import asyncio

from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

import casahunt
from casahunt.views.explore import server as module
from casahunt.views.explore.server import HEADERS, LONGEST_MESSAGE, Server

FIRST = state_of_servo(Servo())
LONG = 60.0


class Asked:
    """A worker that computes nothing."""

    def __init__(self):
        self.questions = []

    def ask(self, number, address):
        self.questions.append((number, address))


@pytest.fixture
def talk():
    told = []
    made = Conversation(FIRST, Asked(), told.append)
    made.told = told
    return made


def hear(talk, **message):
    talk.told.clear()
    talk.hear(json.dumps({"n": 1, **message}))
    return talk.told


def test_a_move_is_told_its_state_and_asked(talk):
    (told,) = hear(talk, ask="gain=0.2")
    assert told["kind"] == "state" and told["n"] == 1
    assert state_of_address(told["address"]).values["gain"] == 0.2
    assert talk.worker.questions[-1][1] == told["address"]
    assert {"command", "python", "file"} == set(told["copies"])


def test_without_an_address_the_page_begins_with_the_servo(talk):
    (told,) = hear(talk, ask="")
    assert told["address"] == FIRST.address()


@pytest.mark.parametrize(
    ("message", "key", "said"),
    [
        ({"ask": "gain=-1", "moved": "gain"}, "gain", "greater than 0"),
        ({"ask": "friction.coulomb=0.6", "moved": "friction.coulomb"}, "friction.coulomb", "at least 0.6"),
        ({"ask": "friction.coulomb=0.6", "moved": "gain"}, "friction.static", "at least 0.6"),
        ({"ask": "gain=0.1", "choose": ["remedy", "hope"]}, "unknown remedy 'hope' (known", "unknown remedy"),
        ({"ask": "", "preset": "../../etc/passwd"}, "", "unknown preset"),
        ({"ask": "", "file": "[servo]\ninertia = -1"}, "the file", "greater than 0"),
    ],
)
def test_a_refusal_belongs_to_a_control_and_nothing_is_asked(talk, message, key, said):
    (told,) = hear(talk, **message)
    assert told["kind"] == "refused" and said in told["sentence"] and not talk.worker.questions
    assert told["key"].startswith(key[:10])


def test_what_else_changes_the_state(talk):
    (told,) = hear(talk, ask="gain=0.3", choose=["remedy", "leak"])
    assert "leak" in state_of_address(told["address"]).values
    (told,) = hear(talk, ask="", preset="canudas")
    assert state_of_address(told["address"]) == presets()["canudas"]
    (told,) = hear(talk, ask="", file="[friction]\nstatic = 0.5")
    assert state_of_address(told["address"]).values["friction.static"] == 0.5


@pytest.mark.parametrize("text", ["", "[", "[]", '{"ask": ""}', '{"n": "x"}', "[" * 50_000, b"\xff"])
def test_what_is_no_message_is_let_go(talk, text):
    talk.hear(text)
    assert not talk.told and not talk.worker.questions


def test_half_a_character_is_refused_as_any_other_text(talk):
    talk.hear('{"n": 1, "ask": "gain=0.2\\ud800", "moved": "gain"}')
    assert talk.told[0]["kind"] == "refused" and "must be a finite number" in talk.told[0]["sentence"]
    talk.hear('{"n": 2, "ask": "", "file": "# \\udc00\\n[friction]\\nstatic = 0.5"}')
    assert talk.told[1]["kind"] == "state" and "friction.static=0.5" in talk.worker.questions[0][1]


def test_a_file_leaves_the_gain_of_the_page(talk):
    (told,) = hear(talk, ask="gain=0.3&model=lugre", file="[friction]\nstatic = 0.5\n[drive]\nsample_time = 0.001")
    state = state_of_address(told["address"])
    assert (state.model, state.values["gain"], state.drive) == ("lugre", 0.3, {"sample_time": 0.001})
    assert "continuous loop" in told["note"]


def test_answers_to_an_older_question_are_not_told(talk):
    hear(talk, ask="gain=0.2")
    old = talk.question
    hear(talk, ask="gain=0.3")
    talk.answered(old, "hunts", {})
    assert [told["kind"] for told in talk.told] == ["state"]
    talk.answered(talk.question, "hunts", {"sentence": "x"})
    talk.answered(talk.question, DONE, {})
    assert [told["kind"] for told in talk.told] == ["state", "stage", "done"]


def test_the_page_without_a_server_holds_what_was_said(talk):
    hear(talk, ask="gain=0.2")
    talk.answered(talk.question, "hunts", {"sentence": "It </script> hunts."})
    (told,) = hear(talk, page=True)
    html = told["html"]
    assert told["kind"] == "page" and "It <\\/script> hunts." in html and "Bokeh" in html
    assert "src=" not in html.split("<body>")[1].split("<script>")[0]  # nothing is loaded


@pytest.fixture(scope="module")
def served():
    made = Server(FIRST, port=0)
    made.start()
    yield made
    made.close()


def get(served, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", served.port, timeout=LONG)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    reply = connection.getresponse()
    try:
        return reply.status, dict(reply.getheaders()), reply.read()
    finally:
        connection.close()


def test_the_files_are_those_of_a_table(served):
    for path in ("/", "/page.js", "/page.css", "/bokeh.js", "/?gain=1"):
        status, headers, body = get(served, path)
        assert status == 200 and body and {**headers, **HEADERS} == headers
    for path in ("/server.py", "/page.html", "/../page.py", "/%2e%2e/etc/passwd", "//etc/passwd", "/presets/a.toml"):
        assert get(served, path)[0] == 404, path


def test_another_name_for_this_machine_is_refused(served):
    """A site that points its own name here would else read the page (DNS rebinding)."""
    assert get(served, "/", Host=f"evil.example:{served.port}")[0] == 403
    assert get(served, "/", Host=f"localhost:{served.port}")[0] == 200


def test_another_name_is_refused_where_the_origin_agrees_with_it(served):
    """A site that points its own name here and asks from its own page: Origin and Host are one, and not ours."""
    for evil in ("evil.example", f"evil.example:{served.port}"):
        with pytest.raises(HTTPClientError, match="403"):
            asyncio.run(begun(served, Origin=f"http://{evil}", Host=evil))
    asyncio.run(begun(served, Origin=f"http://localhost:{served.port}", Host=f"localhost:{served.port}"))


def test_every_handler_looks_at_the_host_before_anything_else(served):
    application = served._application()
    paths = [rule.matcher.regex.pattern.rstrip("$") for rule in application.wildcard_router.rules]
    assert {"/", "/answers", "/page.js"} <= {path.replace("\\", "") for path in paths}
    for path in paths:
        status, _, said = get(served, path.replace("\\", ""), Host=f"evil.example:{served.port}")
        assert status == 403 and b"answers to 127.0.0.1, localhost" in said and b"--host" in said


@pytest.mark.parametrize(
    ("host", "asked", "may"),
    [
        ("127.0.0.1", "127.0.0.1:1", True), ("127.0.0.1", "LocalHost:1", True), ("127.0.0.1", "[::1]:1", True),
        ("127.0.0.1", "192.168.0.7:1", False), ("127.0.0.1", "evil.example@127.0.0.1", False),
        ("127.0.0.1", "127.0.0.1/evil.example", False), ("127.0.0.1", "", False), ("127.0.0.1", "[::1", False),
        ("0.0.0.0", "192.168.0.7:1", True), ("0.0.0.0", "[fe80::1]:1", True), ("0.0.0.0", "evil.example:1", False),
        ("0.0.0.0", f"{socket.gethostname()}:1", True), ("Bench.lan", "bench.lan:1", True), ("::1", "[::1]:1", True),
    ],
)  # fmt: skip
def test_the_names_that_it_answers_to(host, asked, may):
    """Open to the network it answers to addresses in numbers, which no site can give to itself, and its own name."""
    made = object.__new__(Server)
    made.host = host
    assert made.may_ask(asked) is may


def test_what_a_host_opens_is_said(served):
    assert served.opened() == ""
    made = Server(FIRST, host="0.0.0.0", port=0)
    try:
        said = made.opened()
    finally:
        made._socket.close()
    assert "without a password" in said and socket.gethostname().lower() in said and "--host" in said


def test_it_listens_at_this_machine_alone(served):
    assert served._socket.getsockname()[0] == "127.0.0.1"
    assert urlsplit(served.address).hostname == "127.0.0.1"


def test_a_port_that_is_taken_is_said(served):
    with pytest.raises(InputError, match=f"port = {served.port} at 127.0.0.1: cannot be listened at"):
        Server(FIRST, port=served.port)


@contextlib.asynccontextmanager
async def connected(served, **headers):
    """A page's websocket, closed behind the block."""
    address = f"ws://127.0.0.1:{served.port}/answers"
    headers = {"Origin": f"http://127.0.0.1:{served.port}", **headers}
    socket = await asyncio.wait_for(websocket_connect(HTTPRequest(address, headers=headers)), LONG)
    try:
        yield socket
    finally:
        socket.close()
        while socket.close_code is None and await asyncio.wait_for(socket.read_message(), LONG) is not None:
            pass


async def asked(socket, n, **message):
    """All that is said of a message."""
    await socket.write_message(json.dumps({"n": n, **message}))
    said = []
    while not said or said[-1]["kind"] not in ("done", "refused"):
        said.append(json.loads(await asyncio.wait_for(socket.read_message(), LONG)))
    return said


async def begun(served, **headers):
    async with connected(served, **headers):
        pass


def test_another_site_may_not_ask(served):
    for origin in ("http://evil.example", f"http://evil.example:{served.port}", "null"):
        with pytest.raises(HTTPClientError, match="403"):
            asyncio.run(begun(served, Origin=origin))


@pytest.mark.slow
def test_two_pages_do_not_disturb_each_other(served):
    async def both():
        async with connected(served) as one, connected(served) as other:
            return await asyncio.gather(asked(one, 1, ask="gain=0.2"), asked(other, 7, ask="gain=0.3"))

    for said, gain, n in zip(asyncio.run(both()), (0.2, 0.3), (1, 7), strict=True):
        assert {message["n"] for message in said} == {n}
        told = {message["stage"]: message["shown"] for message in said if message["kind"] == "stage"}
        assert told["hunts"]["amplitude"]["value"] == casahunt.find_orbit(Servo(), "switch", gain).amplitude


def test_behind_an_answer_a_worker_begins_for_the_next_page(monkeypatch):
    """At once, not seconds later: a second page opened beside the first has one that is warm."""
    monkeypatch.setattr(module, "SPARE_AFTER", 10 * LONG)
    made = Server(FIRST, port=0)
    made.start()

    async def one():
        async with connected(made) as socket:
            while made._spare:  # the page has taken it
                await asyncio.sleep(0.01)
            await asked(socket, 1, ask="gain=0.2")
            began = time.monotonic()
            while not made._spare and time.monotonic() - began < LONG:
                await asyncio.sleep(0.01)
            return len(made._spare)

    try:
        assert asyncio.run(one()) == 1
    finally:
        made.close()


def test_too_many_pages_are_told_so(served, monkeypatch):
    monkeypatch.setattr(module, "MOST_PAGES", 1)

    async def crowd():
        async with connected(served) as _, connected(served) as other:
            said = json.loads(await asyncio.wait_for(other.read_message(), LONG))
            return said, await asyncio.wait_for(other.read_message(), LONG)

    said, last = asyncio.run(crowd())
    assert said["kind"] == "full" and "1 pages are open already" in said["sentence"] and last is None


def test_a_message_that_is_too_long_ends_the_page(served):
    async def flood():
        async with connected(served) as socket:
            await socket.write_message("x" * (LONGEST_MESSAGE + 1))
            return await asyncio.wait_for(socket.read_message(), LONG)

    assert asyncio.run(flood()) is None


def test_the_largest_file_passes_and_a_page_that_closes_leaves_no_traceback(served, caplog):
    """Of control characters, each six in JSON; closed while it is being answered."""
    text = "# " + "\x7f\t" * int((LARGEST_TOML - 30) / 2) + "\n[friction]\nstatic = 0.5"

    async def hasty():
        socket = await websocket_connect(HTTPRequest(
            f"ws://127.0.0.1:{served.port}/answers", headers={"Origin": f"http://127.0.0.1:{served.port}"}
        ))  # fmt: skip
        await socket.write_message(json.dumps({"n": 1, "ask": "", "file": text}))
        told = json.loads(await asyncio.wait_for(socket.read_message(), LONG))
        await socket.write_message(json.dumps({"n": 2, "ask": "gain=0.21"}))
        socket.protocol.stream.close()
        socket.close()
        return told

    told = asyncio.run(hasty())
    assert told["kind"] in ("state", "refused") and told["n"] == 1
    began = time.monotonic()
    while served._pages and time.monotonic() - began < LONG:
        time.sleep(0.05)
    gc.collect()
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


def test_from_python():
    page = casahunt.explore(Servo(inertia=0.03), "lugre", 0.2, port=0)
    try:
        state = state_of_address(urlsplit(page.address).query)
        assert (state.model, state.values["gain"], state.values["servo.inertia"]) == ("lugre", 0.2, 0.03)
        assert "<iframe" in page._repr_html_() and "&amp;" in page._repr_html_()
    finally:
        page.close()


def test_the_page_of_the_docs_runs():
    """Its block of Python; what it shows is a page."""
    text = (Path(__file__).parents[3] / "docs" / "howto" / "explore.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    scope: dict = {}
    exec(code, scope)  # the code is our own
    scope["page"].close()
