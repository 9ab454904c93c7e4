"""Other processors: what counts as a difference; a servo and a cycle of the gallery under two names."""

from __future__ import annotations

import os

import pytest

from scripts import processors


def said(*words: str, **numbers: tuple[float, float]) -> processors.Answer:
    return {"words": {"status": words[0]}, "numbers": {name: list(pair) for name, pair in numbers.items()}}


@pytest.mark.parametrize(("other", "how"), [
    (said("stable", gain=(1.0 + 3e-8, 2e-8)), ""),  # the sum of both errors
    (said("stable", gain=(1.0 + 4e-8, 2e-8)), "digits"), (said("stable", gain=(float("nan"), 2e-8)), "digits"),
    (said("unstable", gain=(1.0, 1e-8)), "words"), (None, "words"),
    (said("stable"), ""), (said("stable", period=(2.0, 0.0)), ""), (processors.GIVEN_UP, ""),  # known by one alone
])  # fmt: skip
def test_what_differs(other, how):
    first = said("stable", gain=(1.0, 1e-8 + 1e-13))
    runs = {"own": {"belt, one": first, "belt, two": first}, "Zen": {"belt, two": first}}
    if other is not None:
        runs["Zen"]["belt, one"] = other
    assert processors.differences(runs) == ({"belt, one": {"Zen": how}} if how else {})
    assert (f"Zen differs in {how}" in processors.table(runs)) is bool(how)


def test_digits_are_left_out_of_sentences():
    sentences = [f"its cycles end at gain = {gain}, after {n} points" for gain, n in (("1.25e-05", 3), ("-7", "1,200"))]
    assert len({processors.without_numbers(s) for s in sentences}) == 1
    assert processors.without_numbers("at rest") == "at rest"


def test_a_processor_is_an_environment(monkeypatch):
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Zen")
    own = processors.environment(processors.OWN)
    assert "OPENBLAS_CORETYPE" not in own and own["PATH"] == os.environ["PATH"]
    there = processors.environment("Haswell")
    assert there["OPENBLAS_CORETYPE"] == "Haswell" and there["NPY_DISABLE_CPU_FEATURES"]


def test_what_is_known_to_end_is_not_given_up():
    """The branch of canudas_gain.py takes more work than a servo is given: it was never compared."""
    task = {"servos": [[0, "switch"]], "gallery": ["belt"], "seed": 1, "tol": 1e-6, "limit": 1.0, "gains": None}
    said = processors.answers(task)["answers"]
    assert {question: answer == processors.GIVEN_UP for question, answer in said.items()} == {
        question: question.startswith("switch servo") for question in said
    }
    assert len(said) > 1


@pytest.mark.slow
def test_the_script(capsys, tmp_path):
    """A servo and some cycles, in processes whose arithmetic rounds differently; and it does."""
    out = tmp_path / "answers.json"
    chosen = ["--servos", "1", "--lugre", "0", "--gallery", "belt", "bouncing_ball", "--processors", "Prescott", "own"]
    assert processors.main([*chosen, "--out", str(out)]) == 0
    assert "switch fold" in capsys.readouterr().out and out.stat().st_size > 1000
