"""The site: what its pages show runs as it is written, and what they link to is there.

`sphinx-build -W docs docs/_build/html`, which .ci/run does, executes the gallery besides.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from peer_support import needs
from test_readme import PROMISED, TO_THE_LETTER

import casahunt
from casahunt import InputError, Servo, find_orbit
from casahunt.cli import main
from casahunt.servo.parts import DERIVATIVE_FILTER, HYSTERESIS, INERTIA, INTEGRATOR, LEAK, PID_BY_GAINS, SWITCH, Loop
from casahunt.servo.parts.verbs import fold_in, loop_cycle
from casahunt.views.commands.output import MEANINGS
from problems import taylor

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = [*sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts), ROOT / "README.md"]
TUTORIAL = (DOCS / "tutorial.md").read_text(encoding="utf-8")
EXAMPLES = sorted((DOCS / "examples").rglob("*.py"))
FEWEST_EXAMPLES = 15
SHOWN = 2e-3
"""Numbers of the tutorial have three digits or more; times of a computation are not shown."""
NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def blocks(text: str, languages: str) -> list[tuple[str, str]]:
    return re.findall(rf"^```({languages})\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def run(name: str) -> dict:
    scope: dict = {"__name__": "page"}
    for _, code in blocks((DOCS / "howto" / name).read_text(encoding="utf-8"), "python"):
        exec(compile(code, name, "exec"), scope)  # the code is our own
    return scope


def test_a_controller_in_two_forms(capsys):
    run("controller.md")
    one, other = map(float, capsys.readouterr().out.split())
    assert one == pytest.approx(other, rel=1e-5)


def test_tustins_law(capsys):
    """Where its curve is the Gaussian one, with the exponent 2, the page's servo is that of the package."""
    scope = run("friction.md")
    assert "period" in capsys.readouterr().out
    casadi, tustin = scope["casadi"], scope["tustin"]

    def gaussian(x, p):
        drop = casadi.exp(-((x.velocity / p.vs) ** 2))
        friction = p.sign * (p.coulomb + (p.static - p.coulomb) * drop) + p.viscous * x.velocity
        return {"position": x.velocity, "velocity": (scope["torque"](x, p) - friction) / p.inertia,
                "integral": x.position}  # fmt: skip

    modes = tuple(replace(m, field=gaussian) if m.name != "stick" else m for m in tustin.modes)
    servo, gain = Servo(), 0.1
    kp, kd, ki = servo.torque_gains(gain)
    found = scope["find_cycle"](replace(tustin, modes=modes), "stick", parameters={"kp": kp, "kd": kd, "ki": ki},
                                position=-0.02, velocity=0.0, integral=0.0, follow="kp", tol=1e-8)  # fmt: skip
    assert found.period == pytest.approx(find_orbit(servo, "switch", gain).period, rel=1e-6)
    assert scope["orbit"].stable


@pytest.mark.slow
def test_a_loop_from_parts(capsys):
    """Its dead band by an event map of its own; its own part by a stick map: a stop at the edge leads to it."""
    support, optimize = pytest.importorskip("stick_map_support"), pytest.importorskip("scipy.optimize")
    scope = run("parts.md")
    assert scope["fold"].value == pytest.approx(0.0433457242337, rel=1e-9)
    truth = optimize.brentq(
        lambda size: support.stick_map(size, 0.04, "hysteresis", size, leak=0.05) - size,
        0.999 * scope["edge"].value, 1.001 * scope["edge"].value, xtol=1e-12,
    )  # fmt: skip
    assert scope["edge"].value == pytest.approx(truth, rel=1e-8)
    assert scope["filtered"].stable and "0.0433457" in capsys.readouterr().out
    both = scope["loop"].with_parts(LEAK, leak=0.1)  # a dead band and a leak go together, two dead bands do not
    assert scope["cycle_of"](both, "dead_band", 1e-6).period > scope["cycle"].period
    with pytest.raises(InputError, match="dead band and hysteresis do not go together"):
        scope["loop"].with_parts(HYSTERESIS, hysteresis=0.01).system  # noqa: B018


def test_friction_from_a_record(capsys):
    """The record of the page is a computed cycle of Table 1: what it was made with is found."""
    found = run("identify.md")["found"]
    assert found.values == pytest.approx({"friction.static": 0.53, "friction.coulomb": 0.44}, rel=1e-3)
    assert "friction.static" in capsys.readouterr().out


def test_results_as_they_are_shown(capsys):
    scope = run("python.md")
    printed = capsys.readouterr().out
    assert "0.05004697" in printed and "amplitude" in printed and len(scope["axes"]) == 3


@pytest.mark.slow
def test_many_servos(capsys):
    scope = run("uncertainty.md")
    folds = scope["folds"]
    assert not folds.failures and callable(scope["on_all_cores"])
    least, largest = int(folds.gains.argmin()), int(folds.gains.argmax())
    for i in (least, largest):
        servo = Servo().replace(**dict(zip(folds.names, map(float, folds.parameters[i]), strict=True)))
        gain, amplitude = taylor.switch_fold(servo, float(folds.gains[i]), float(folds.amplitudes[i]))
        assert abs(folds.gains[i] / gain - 1) <= folds.gain_errors[i] + 1e-12
        assert abs(folds.amplitudes[i] / amplitude - 1) <= folds.amplitude_errors[i] + 1e-11


@pytest.mark.slow
def test_the_table_of_remedies_to_the_letter(capsys):
    """As the command prints it, its numbers to three digits; and those that the README promises."""
    ((_, shown),) = blocks((DOCS / "howto" / "remedies.md").read_text(encoding="utf-8"), "text")
    assert main([*TO_THE_LETTER.split()[1:], "--quiet"]) == 0
    printed = capsys.readouterr().out.partition(MEANINGS)[0]
    assert len(PROMISED[TO_THE_LETTER]) == 3 and all(promised in printed for promised in PROMISED[TO_THE_LETTER])
    lines = [[line for line in text.splitlines() if line.strip()] for text in (shown, printed)]
    assert len(lines[0]) == len(lines[1]) and len(lines[0]) > 20
    for line, other in zip(*lines, strict=True):
        assert same(line, other), (line, other)


@pytest.mark.slow
def test_the_rows_of_the_guide(capsys):
    """The quick ones of the table that it shows: sizes by independent event maps, prices by the controller's gain."""
    run("remedies.md")
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert {" ".join(words[:-4]): float(words[-4]) for words in printed} == pytest.approx(
        {"dead band": 0.0433457242337, "leak": 0.246844841}, rel=1e-8
    )
    ((_, shown),) = blocks((DOCS / "howto" / "remedies.md").read_text(encoding="utf-8"), "text")
    rows = {line[2:19].strip(): line[19:].replace("up to", "to").split() for line in shown.splitlines()}
    for words in printed:
        assert float(rows[" ".join(words[:-4])][1]) == pytest.approx(float(words[-4]), rel=SHOWN)
    gain = rows["gain"]  # from size unit choose rest torque settles
    assert float(gain[1]) == pytest.approx(0.64733908, rel=SHOWN) and float(gain[4]) == 0
    assert float(gain[5]) == pytest.approx(2 * 16 * float(gain[3]), rel=SHOWN)


@pytest.mark.slow
def test_the_loop_that_you_know(capsys):
    """The tutorial's first minutes: margins from |L| by hand; cycle and fold of the same loop, by other parts."""
    needs("control")
    scope: dict = {}
    for _, code in blocks(TUTORIAL, "python"):
        exec(compile(code, "tutorial.md", "exec"), scope)  # the code is our own
    J, c, cm, kp, ki, kd, Tf = 0.026, 0.1, 16.0, 2.0, 6.2832, 0.159155, 0.001

    def loop(w):
        s = 1j * w
        return 0.04 * cm * (kp + ki / s + kd * s / (Tf * s + 1)) / (J * s**2 + c * s)

    w = scope["crossover"]
    assert abs(loop(w)) == pytest.approx(1, rel=1e-9)
    assert scope["phase_margin"] == pytest.approx(180 + np.degrees(np.angle(loop(w))), rel=1e-9)
    parts = (INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR, DERIVATIVE_FILTER)
    by_gains = Loop(parts, {"gain": 0.04, "kp": kp, "ki": ki, "kd": kd, "derivative_filter": Tf})
    cycle = loop_cycle(by_gains)
    assert scope["cycle"].period == pytest.approx(cycle.period, rel=1e-8)
    said = re.findall(r"[\d.]+", capsys.readouterr().out)
    shown = re.findall(r"[\d.]+", "".join(text for _, text in blocks(TUTORIAL, "text")[:2]))
    assert said == shown
    assert float(said[-2]) == pytest.approx(fold_in(cycle, "gain").value, rel=1e-4)


@pytest.mark.slow
def test_the_tutorial_to_the_letter(tmp_path):
    """Every block in order, in a shell; every line that is shown is printed, its numbers to three digits.

    Its Python is run by `test_the_loop_that_you_know`.
    """
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("the tutorial is written for a POSIX shell")
    here = tmp_path / "bin"
    here.mkdir()
    command = here / "casahunt"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m casahunt "$@"\n')
    command.chmod(0o755)
    place = {"PATH": f"{here}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    printed, shown = "", 0
    for language, text in blocks(TUTORIAL[TUTORIAL.index("## The servo\n") :], "sh|text"):
        if language == "sh" and "pip install" not in text:
            done = subprocess.run([bash, "-e", "-c", text], cwd=tmp_path, env=os.environ | place, capture_output=True,
                                  text=True, check=False)  # fmt: skip
            assert done.returncode == 0, done.stderr
            printed = done.stdout
        for line in text.splitlines() if language == "text" else []:
            assert any(same(line, other) for other in printed.splitlines()), line
            shown += 1
    assert shown >= 8 and (tmp_path / "tuned" / "tune.html").stat().st_size > 10_000


def same(line: str, other: str) -> bool:
    """The words that are shown, and numbers that agree to three digits."""
    words = [part.split() for part in (NUMBER.sub("#", line), NUMBER.sub("#", other))]
    if words[0] != words[1][: len(words[0])] and not (len(words[0]) == 1 and words[0][0] in words[1]):
        return False
    pairs = zip(NUMBER.findall(line), NUMBER.findall(other), strict=False)
    return all(math.isclose(float(a), float(b), rel_tol=SHOWN) for a, b in pairs)


def test_lines_that_differ_are_told_apart():
    assert same("  period   10.2814 s", "  period           10.281414 s") and not same("period 10.3 s", "period 10.2 s")
    assert not same("period 10.3 s", "amplitude 10.3 s") and same("verified", "checked: verified")


def test_the_gallery_is_complete():
    """Every example has its place, a heading, and ends by asserting something."""
    names = (DOCS / "examples" / "order.txt").read_text(encoding="utf-8").split()
    assert sorted(names) == sorted(path.name for path in EXAMPLES) and len(names) >= FEWEST_EXAMPLES
    for path in EXAMPLES:
        text = path.read_text(encoding="utf-8")
        assert re.match(r'"""\n.+\n=+\n', text) and re.search(r"^\s*assert ", text, re.MULTILINE), path.name
        compile(text, path.name, "exec")


def test_the_story_of_the_front_page_runs_to_its_end(monkeypatch, capsys):
    """All that it asserts holds; the others are run by the build of the site."""
    name = "plot_cured.py"
    monkeypatch.setenv("MPLBACKEND", "Agg")
    path = next(path for path in EXAMPLES if path.name == name)
    try:
        exec(compile(path.read_text(encoding="utf-8"), name, "exec"), {"__name__": "page"})  # the code is our own
    finally:
        pyplot = sys.modules["matplotlib.pyplot"]
        pyplot.close("all")


def test_servos_come_first():
    """Sections in their order, each with a heading; the order of the examples is theirs."""
    names = (DOCS / "examples" / "order.txt").read_text(encoding="utf-8").split()
    sections = [next(path.parent for path in EXAMPLES if path.name == name) for name in names]
    assert sections == sorted(sections) and all((section / "README.txt").is_file() for section in sections)
    servos = [path.parent for path in EXAMPLES if "Servo(" in path.read_text(encoding="utf-8")]
    assert len(servos) > 10 and sections[-1] not in servos


def test_every_public_name_has_a_topic(monkeypatch):
    """The reference lists each once; a name without a topic, or one that is gone, stops the build."""
    monkeypatch.syspath_prepend(DOCS)
    import api_pages

    listed = [(module, name) for _, module, names in api_pages.names_by_topic() for name in names]
    assert len(set(listed)) == len(listed) > 150
    assert {name for module, name in listed if module == "casahunt"} == set(casahunt.__all__)
    less, more = (replace(topic, names={"casahunt": names}) for topic, names in zip(
        api_pages.TOPICS[:2], ("Servo", "find_orbit no_such_name"), strict=True))  # fmt: skip
    for topics, message in (((less, *api_pages.TOPICS[1:]), "without a topic"),
                            ((api_pages.TOPICS[0], more), "has no no_such_name"),
                            ((*api_pages.TOPICS, api_pages.TOPICS[0]), "another topic has it")):  # fmt: skip
        monkeypatch.setattr(api_pages, "TOPICS", topics)
        with pytest.raises(ValueError, match=message):
            api_pages.names_by_topic()


def test_formulas_are_drawn_by_the_browser(monkeypatch):
    """All of them are MathML, so that the site is read without a network; an accent keeps its subscript beside it."""
    pytest.importorskip("docutils")
    monkeypatch.syspath_prepend(DOCS)
    from mathml import mathml

    formulas = 0
    for page in PAGES:
        text = re.sub(r"^```.*?^```|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for block, line in re.findall(r"\$\$(.+?)\$\$|\$([^$]+?)\$", text, flags=re.DOTALL):
            said = mathml(block or line, block=bool(block))
            assert said.startswith("<math") and "munderover" not in said, (page.name, block or line)
            formulas += 1
    assert formulas > 100
    for wrong in (r"\dot x_1", r"\dot{x}_1", r"\bar v _2"):
        with pytest.raises(ValueError, match=r"\{\}_"):
            mathml(wrong)
    assert re.search(r"<mover.*<msub>", mathml(r"\dot x{}_1"), re.DOTALL)


def test_the_front_page_leads_on():
    """A hunting servo beside the cured one, and four cards; each picture is drawn by an example of the gallery."""
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    assert text.count(":::{container} card\n") == 4
    assert len(re.findall(r"^\*\*\[[^]]+\]\([^)]+\.md\)\*\*$", text, re.MULTILINE)) == 4
    pictures = re.findall(r"auto_examples/(\S+)/images/sphx_glr_(plot_\w+)_00\d\.png", text)
    assert len(pictures) == 2 and all((DOCS / "examples" / place / f"{name}.py").is_file() for place, name in pictures)
    for place in re.findall(r"\(auto_examples/(\w+/plot_\w+)\.rst\)", text):
        assert (DOCS / "examples" / f"{place}.py").is_file(), place


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not re.search("^http|^#|auto_examples|^commands/", target):  # the last two are made by the build
            path = page.parent / target.partition("#")[0]
            assert path.exists() or path.name == "index.rst", f"{page.name}: {target}"
