"""The page in a real browser: moved, typed, refused, shared, undone, saved; by keyboard; on a phone; left alone.

Needs Bokeh, Playwright and Chromium: /usr/bin/chromium, or what CASAHUNT_CHROMIUM names.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest

pytest.importorskip("bokeh", reason='the page is drawn by Bokeh: python -m pip install "casahunt[explore]"')
playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright: python -m pip install playwright")

from casahunt import Servo, find_fold, find_orbit, margins  # noqa: E402
from casahunt.servo.parts import load_loop  # noqa: E402
from casahunt.servo.parts.file import load  # noqa: E402
from casahunt.views.explore.page import controls_of  # noqa: E402
from casahunt.views.explore.server import Server  # noqa: E402
from casahunt.views.explore.state import state_of_address, state_of_servo  # noqa: E402

CHROMIUM = os.environ.get("CASAHUNT_CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium, or CASAHUNT_CHROMIUM=path"),
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]  # of Playwright's own event loop
FLAGS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
FIRST = state_of_servo(Servo())
LONG = 120.0
"""Seconds that a page is waited for."""


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def served():
    made = Server(FIRST, port=0)
    made.start()
    yield made
    made.close()


class Page:
    """A page that is loaded, and its faults."""

    def __init__(self, browser, address, width=1200, height=900):
        self.context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
        self.faults = []
        self.at = self.context.new_page()
        self.at.on("pageerror", lambda error: self.faults.append(str(error)))
        self.at.on("console", lambda said: self.faults.append(said.text) if said.type == "error" else None)
        self.at.goto(address)
        self.settled(0)

    def asks(self, expression):
        return self.at.evaluate(expression)

    def until(self, expression):
        began = time.monotonic()
        while not self.asks(f"Boolean({expression})"):
            assert time.monotonic() - began < LONG, expression
            time.sleep(0.02)

    def settled(self, after):
        """Everything that was asked behind message `after` is answered."""
        self.until(f"casahunt.ready && casahunt.n > {after} && casahunt.times.at(-1).done")

    def moved(self, action):
        before = self.asks("casahunt.n")
        action()
        self.settled(before)

    def type(self, key, text):
        field = self.at.locator(f"[id='n-{key}']")
        field.fill(str(text))
        self.moved(lambda: field.press("Enter"))

    def text(self, selector):
        return self.at.locator(selector).inner_text()

    def number(self, key):
        return self.text(f"#number-{key} dd").split()[0]

    @property
    def state(self):
        return state_of_address(self.asks("location.search.slice(1)"))


@pytest.fixture
def page(browser, served):
    made = Page(browser, f"http://127.0.0.1:{served.port}/")
    yield made
    made.context.close()
    assert not made.faults


def test_a_slider_moved_shows_the_numbers_of_the_library(page):
    """To the digits shown: of the gain that the slider then says."""
    slider = page.at.locator("#s-gain")
    page.moved(lambda: slider.fill("650"))
    gain = page.state.values["gain"]
    assert gain != 0.1 and float(page.at.locator("#n-gain").input_value()) == gain
    orbit, fold = find_orbit(Servo(), "switch", gain), find_fold(Servo(), "switch")
    shown = page.asks("casahunt.shown")
    for key, value in {
        "amplitude": orbit.amplitude, "period": orbit.period, "gain": fold.gain, "ratio": fold.gain / gain,
        "phase_margin": margins(Servo(), gain).phase_margin,
    }.items():  # fmt: skip
        text = page.number(key)
        digits = len(text.replace(".", "").lstrip("0"))
        assert digits <= 4 and float(text) == float(f"{value:.{digits}g}"), key
        assert float(text) == pytest.approx(value, rel=5e-4 if key != "phase_margin" else 1e-2)
    assert shown["hunts"]["amplitude"]["value"] == orbit.amplitude
    assert page.text("#sentence").startswith("It hunts")


def test_the_figures_hold_what_was_computed(page):
    cycle = page.asks("casahunt.shown.hunts.cycle.angle")
    drawn = page.asks(
        "Bokeh.documents.flatMap((d) => d.get_model_by_name('cycle') ? [d.get_model_by_name('cycle').data.angle] : [])"
        ".filter((c) => c).map((c) => Array.from(c))"
    )
    assert drawn and all(column == pytest.approx(cycle) for column in drawn)
    assert page.at.locator("figure canvas").count() >= 8


def test_figures_are_described_as_they_are_drawn_and_the_sentence_greys_with_them(page):
    def described(name):
        return page.asks(f"document.getElementById('{name}-plot').getAttribute('aria-label')")

    ranges = re.findall(r"(stable|unstable) cycles, gain from ([0-9.]+) to ([0-9.]+)", described("diagram"))
    fold = find_fold(Servo(), "switch").gain
    assert [name for name, *_ in ranges] == ["stable", "unstable"]
    assert all(float(high) == pytest.approx(fold, rel=1e-2) for *_, high in ranges)
    amplitude = find_orbit(Servo(), "switch", 0.1).amplitude
    assert described("angle").endswith(f"angle from -{amplitude:.3g} to {amplitude:.3g}")
    page.type("gain", 1.0)
    assert described("angle").endswith("none: it does not hunt")  # not that of the last gain
    page.asks("void (window.greyed = [])")
    page.asks(
        "void new MutationObserver(() => greyed.push(document.getElementById('sentence').classList.contains('stale')))"
        ".observe(document.getElementById('sentence'), {attributes: true})"
    )
    page.type("gain", 0.2)
    assert page.asks("greyed")[0] is True and page.asks("greyed").pop() is False


def test_typed_and_refused_at_its_control(page):
    page.type("friction.viscous", 0.12)
    assert page.state.values["friction.viscous"] == 0.12
    field = page.at.locator("[id='n-friction.static']")
    field.fill("0.1")
    field.press("Enter")
    page.until("document.querySelector('[id=\"r-friction.static\"]').textContent")
    assert "must be at least 0.44" in page.text("[id='r-friction.static']")
    assert field.get_attribute("aria-invalid") == "true"
    assert page.state.values["friction.static"] == 0.53  # nothing was computed with it
    page.type("friction.static", 0.5)
    assert page.state.values["friction.static"] == 0.5 and field.get_attribute("aria-invalid") is None


def test_a_link_reproduces_the_page(page, browser, served):
    page.type("gain", 0.25)
    page.moved(lambda: page.at.locator("#c-remedy").select_option("leak"))
    page.type("leak", 0.05)
    other = Page(browser, page.asks("location.href"))
    assert other.state == page.state
    assert other.text("#sentence") == page.text("#sentence")
    assert other.number("amplitude") == page.number("amplitude")
    other.context.close()


def test_undo(page):
    page.type("gain", 0.2)
    page.type("friction.viscous", 0.2)
    page.moved(lambda: page.at.locator("#c-model").select_option("lugre"))
    for viscous, gain, model in ((0.2, 0.2, "switch"), (0.1, 0.2, "switch"), (0.1, 0.1, "switch")):
        page.moved(lambda: page.at.locator("#undo").click())
        values = page.state.values
        assert (values["friction.viscous"], values["gain"], page.state.model) == (viscous, gain, model)
    assert page.at.locator("#undo").is_disabled()
    assert float(page.at.locator("#n-gain").input_value()) == 0.1


def test_presets_and_choices(page):
    page.moved(lambda: page.at.locator("#preset").select_option("canudas"))
    assert page.state.values["controller.kp"] == 3.0 and page.at.locator("[id='n-controller.kp']").count() == 1
    page.until("document.querySelector('#c-controller')")
    page.at.locator("#c-controller").select_option("times")
    page.until("!document.querySelector('#alarm').hidden")
    assert "complex" in page.text("#alarm")


def test_the_gain_is_dragged_in_the_diagram(page):
    box = page.at.locator("#diagram-plot").bounding_box()
    y = box["y"] + box["height"] / 2

    def drag():
        page.at.mouse.move(box["x"] + 0.5 * box["width"], y)
        page.at.mouse.down()
        page.at.mouse.move(box["x"] + 0.6 * box["width"], y, steps=5)
        page.at.mouse.move(box["x"] + 0.7 * box["width"], y, steps=5)
        page.at.mouse.up()

    page.at.locator("#diagram-plot").scroll_into_view_if_needed()
    box = page.at.locator("#diagram-plot").bounding_box()
    y = box["y"] + box["height"] / 2
    page.moved(drag)
    dragged = page.state.values["gain"]
    assert 0.1 < dragged < find_fold(Servo(), "switch").gain
    marked = page.asks("Bokeh.documents.map((d) => d.get_model_by_name('present')).find((s) => s).location")
    assert marked == pytest.approx(dragged)
    assert page.asks("casahunt.shown.hunts.amplitude.value") == find_orbit(Servo(), "switch", dragged).amplitude


def test_by_keyboard_alone(page):
    """Every control is reached by Tab, and an arrow moves a slider."""
    seen = []
    page.at.keyboard.press("Tab")
    for _ in range(80):
        at = page.asks("document.activeElement.id || document.activeElement.textContent")
        if at in seen or at == "":
            break
        seen.append(at)
        page.at.keyboard.press("Tab")
    for control in controls_of(FIRST):
        assert {f"n-{control.key}", f"s-{control.key}"} <= set(seen)
    assert {"preset", "file", "c-model", "c-controller", "c-remedy", "save-png", "save-page", "copied"} <= set(seen)
    page.at.locator("#s-gain").focus()
    page.moved(lambda: page.at.keyboard.press("ArrowRight"))
    assert page.state.values["gain"] > 0.1 and page.asks("document.activeElement.id") == "s-gain"
    page.at.locator("#undo").focus()
    page.moved(lambda: page.at.keyboard.press("Enter"))
    assert page.state.values["gain"] == 0.1


def test_a_screen_reader_is_told_names_and_the_sentence(page):
    for control in controls_of(FIRST):
        unit = f" [{control.unit}]" if control.unit else ""
        assert page.at.get_by_role("textbox", name=f"{control.label}{unit}", exact=True).count() == 1, control.key
        slider = page.at.get_by_role("slider", name=f"{control.label} slider", exact=True)
        assert slider.count() == 1 and slider.get_attribute("aria-valuetext").endswith(control.unit)
    for name in ("friction model", "controller given by", "remedy", "begin with"):
        assert page.at.get_by_role("combobox", name=name, exact=True).count() == 1, name
    sentence = page.at.get_by_role("status").first
    assert sentence.get_attribute("aria-live") == "polite" and sentence.inner_text().startswith("It hunts")
    pictures = page.at.get_by_role("img").all()
    assert len(pictures) == 8 and all("from" in (picture.get_attribute("aria-label") or "") for picture in pictures)


def test_fifty_quick_moves(page):
    """The newest wins: the numbers are those of the last one."""
    slider = page.at.locator("#s-gain")
    slider.focus()
    before = page.asks("casahunt.n")
    for _ in range(50):
        page.at.keyboard.press("ArrowLeft")
    page.settled(before)
    gain = page.state.values["gain"]
    assert gain == float(page.at.locator("#n-gain").input_value()) < 0.08
    assert page.asks("casahunt.shown.hunts.amplitude.value") == find_orbit(Servo(), "switch", gain).amplitude


def test_what_is_not_found_is_said_in_its_place(page):
    page.type("gain", 1.0)
    assert page.text("#sentence").startswith("It does not hunt")
    assert page.text("#why").endswith("it can hunt up to gain 0.6473 V/rad, and not above")
    page.at.locator("#evidence summary").click()
    assert "in a fold" in page.text("#evidence")
    for place in ("#number-amplitude dd", "#number-period dd", "#angle-figure .missing", "#phase-figure .missing"):
        assert page.text(place) == "none: it does not hunt"
    times = 1.0 / find_fold(Servo(), "switch").gain
    assert page.text("#number-ratio dd").startswith(f"the present gain is {times:.4g} times that: it does not hunt")
    page.moved(lambda: page.at.locator("#c-remedy").select_option("leak"))
    page.type("gain", 0.1)
    page.type("leak", 0.5)
    assert page.text("#number-amplitude dd") == "not found" and "No hunting was found" in page.text("#sentence")


def test_one_sentence_in_the_place_of_several_numbers_is_said_once(page):
    page.moved(lambda: page.at.locator("#c-remedy").select_option("dead band"))
    assert page.text("#number-phase_margin dd") == "with this part the loop is not linear: it has no margins"
    assert page.at.locator("#number-crossover").count() == 0
    page.moved(lambda: page.at.locator("#c-remedy").select_option(""))
    assert float(page.number("crossover")) > 0


def test_copies(page, tmp_path):
    page.type("gain", 0.2)
    page.at.locator("[data-copy=command]").click()
    assert page.at.locator("#copied").input_value() == "casahunt orbit --model switch --gain 0.2"
    files = {}
    for button in ("save-file", "save-png", "save-page"):
        with page.at.expect_download(timeout=LONG * 1000) as download:
            page.at.locator(f"#{button}").click()
        files[button] = tmp_path / download.value.suggested_filename
        download.value.save_as(files[button])
    assert load(files["save-file"]) == Servo()
    assert files["save-png"].read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and files["save-png"].stat().st_size > 20_000
    assert files["save-page"].stat().st_size > 1e6


def test_the_page_without_a_server(page, browser, tmp_path):
    page.type("gain", 0.2)
    with page.at.expect_download(timeout=LONG * 1000) as download:
        page.at.locator("#save-page").click()
    path = tmp_path / "saved.html"
    download.value.save_as(path)
    alone = browser.new_page()
    asked, faults = [], []
    alone.on("request", lambda request: asked.append(request.url))
    alone.on("pageerror", lambda error: faults.append(str(error)))
    alone.goto(path.as_uri())
    began = time.monotonic()
    while not alone.evaluate("Boolean(casahunt.ready)") and time.monotonic() - began < LONG:
        time.sleep(0.05)
    assert alone.locator("#sentence").inner_text() == page.text("#sentence")
    assert alone.locator("#number-amplitude dd").inner_text() == page.text("#number-amplitude dd")
    assert alone.locator("figure canvas").count() >= 8 and alone.locator("#n-gain").is_disabled()
    assert not faults and not [url for url in asked if urlsplit(url).scheme not in ("file", "data", "blob")]
    alone.close()


def test_a_file_up_and_a_loop_down(page, tmp_path):
    path = tmp_path / "loop.toml"
    parts = '["one inertia", "Switch friction", "PID by times", "integrator", "leak"]'
    path.write_text(f"[loop]\nparts = {parts}\n[values]\ngain = 0.04\nleak = 0.1\n", encoding="utf-8")
    page.moved(lambda: page.at.locator("#file").set_input_files(path))
    assert page.state.is_loop and page.at.locator("#n-leak").count() == 1
    assert page.text("#sentence").startswith("It hunts")
    with page.at.expect_download() as download:
        page.at.locator("#save-file").click()
    download.value.save_as(tmp_path / "down.toml")
    assert load_loop(tmp_path / "down.toml").value("leak") == 0.1
    path.write_text("[servo]\ninertia = -1\n", encoding="utf-8")
    page.at.locator("#file").set_input_files(path)
    page.until("!document.querySelector('#alarm').hidden")
    assert "must be greater than 0" in page.text("#alarm")


@pytest.mark.parametrize("width, height", [(1200, 900), (800, 900), (400, 900), (640, 360)])
def test_it_fits(browser, served, width, height):
    """Nothing stands out to the side, no sentence is cut, and the header leaves room, at 200 % too (of 1280 x 720), in
    each state; PICTURES=folder keeps what it looks like."""
    made = Page(browser, f"http://127.0.0.1:{served.port}/", width, height)
    for gain in (0.2, 0.6, 1.0):
        made.type("gain", gain)
        for name in ("sentence", "why"):
            room = made.asks(f"(({{scrollHeight, clientHeight}}) => clientHeight - scrollHeight)({name})")
            assert room >= -1
        assert made.asks("document.querySelector('header').getBoundingClientRect().height / innerHeight") < 0.25
        assert made.asks("document.documentElement.scrollWidth") <= width
        wide = made.asks(
            "[...document.querySelectorAll('main *')].filter((e) => e.getBoundingClientRect().right > innerWidth + 1)"
            ".map((e) => e.id || e.className)"
        )
        assert not wide
        if os.environ.get("PICTURES"):
            made.at.screenshot(path=Path(os.environ["PICTURES"], f"explore-{width}-{gain:g}.png"), full_page=True)
    made.context.close()
    assert not made.faults


def test_the_server_stopped_in_between(browser):
    """A sentence says so; what is shown stays; with the server the page goes on."""
    first = Server(FIRST, port=0)
    first.start()
    made = Page(browser, f"http://127.0.0.1:{first.port}/")
    first.close()
    made.until("!document.querySelector('#alarm').hidden")
    assert "The server has stopped" in made.text("#alarm") and made.text("#sentence").startswith("It hunts")
    made.at.locator("#s-gain").focus()
    made.at.keyboard.press("ArrowRight")
    again = Server(FIRST, port=first.port)
    again.start()
    made.until("document.querySelector('#alarm').hidden")
    made.settled(1)
    made.context.close()
    again.close()


def test_two_tabs_do_not_disturb_each_other(page, browser, served):
    other = Page(browser, f"http://127.0.0.1:{served.port}/?gain=0.3")
    page.type("gain", 0.2)
    assert (page.state.values["gain"], other.state.values["gain"]) == (0.2, 0.3)
    assert json.dumps(other.asks("casahunt.shown.hunts.amplitude.value")) == json.dumps(
        find_orbit(Servo(), "switch", 0.3).amplitude
    )
    other.context.close()
