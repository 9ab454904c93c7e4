"""The corpus of answers: what counts as a change, what is cut goes on, and answers beside independent programs."""

from __future__ import annotations

import json
from functools import partial

import pytest

from casahunt import InputError, effort
from scripts import corpus
from scripts.answers import compared, gallery, kept, questions, servos


def row(status="CONVERGED", truth=None, words=(), **numbers):
    said = {"words": {"status": status, **dict(words)}, "numbers": numbers, "kind": "fold", "seconds": 1.0}
    return said | ({"truth": truth} if truth else {})


FOLD = {"1, fold": [0.5, 1e-6]}
REFUSED = row("refused, there is none", words={"sentence": "no cycle"})


@pytest.mark.parametrize(("before", "after", "kind", "told"), [
    (row(gain=[1.0, 1e-8]), row(gain=[1 + 3e-8, 2.1e-8]), None, ""),
    (row(gain=[1.0, 1e-8]), row(gain=[1 + 3e-8, 1e-8]), "numbers", "gain"),
    (row(gain=[1.0, 1e-8]), row(), "numbers", "gain is gone"),
    (row(words={"phases": "slip stick"}), row(words={"phases": "slip"}), "phases", "slip stick -> slip"),
    (row(words={"stable": True}), row(words={"stable": None}), "verdicts", "stable True -> None"),
    (row(words={"end": "range"}), row(words={"end": "stuck"}), "ends", "stuck"),
    (row(**FOLD, **{"2, flip": [0.4, 1e-6]}), row(**FOLD), "special points", "lost flip 0.4"),
    (row(**FOLD), row(**{"1, fold": [0.51, 1e-6]}), "special points", "lost fold 0.5, new fold 0.51"),
    (row(**{"w = 1, c = 2: period": [0.5, 1e-6]}), row(**{"w = 1, c = 2: period": [0.51, 1e-6]}), "numbers", "period"),
    (REFUSED, row(), "refusals that became answers", "no cycle"), (row(), REFUSED, "answers that became refusals", ""),
    (REFUSED, row("refused, NOT_FOUND", words={"sentence": "no cycle"}), "verdicts", "NOT_FOUND"),
    (REFUSED, row("refused, there is none", words={"sentence": "no such cycle"}), "sentences", ""),
    (row(), row("given up"), "given up or errors", ""),
    (row("error, KeyError"), row("ran away"), "given up or errors", ""),
])  # fmt: skip
def test_what_has_changed(before, after, kind, told):
    found = compared.differences({"this": before, "gone": before}, {"this": after, "new": after})
    assert {name for name, lines in found.items() if lines} == ({kind} if kind else set())
    assert all(told in line for lines in found.values() for line in lines)
    same = compared.differences({"this": after}, {"this": json.loads(json.dumps(after))})
    assert not any(same.values())


def test_times_are_told():
    told = "\n".join(compared.times({"a": row()}, {"a": row() | {"seconds": 4.0}}))
    assert "4.00" in told and "slower: a: 1.0 s -> 4.0 s" in told


def test_a_missed_truth_is_told():
    known = {"gain": [2.0, 1e-12]}
    assert not compared.untrue({"a": row(truth=known, gain=[2 + 9e-9, 1e-9]), "b": REFUSED})
    assert "known 2.0" in compared.untrue({"a": row(truth=known, gain=[2 + 2e-8, 1e-9])})[0]
    assert "lost" in compared.untrue({"a": row(words={"lost": ["fold"]})})[0]


def test_what_fails_is_an_answer(monkeypatch):
    def work():
        for _ in range(10):
            effort.interval()

    def refused():
        raise InputError("no such gain")

    def slow():
        while True:
            pass

    monkeypatch.setattr(questions, "WORK", 1.0)
    monkeypatch.setattr(questions, "SECONDS", 0.05)
    asked = [questions.Question("q", "fold", ask, {}) for ask in (work, refused, slow)]
    said = [questions.answered(question)["words"]["status"] for question in asked]
    assert said == ["given up", "error, InputError", "ran away"]
    assert {compared.state({"words": {"status": status}}) for status in said} == set(said)


def test_what_was_cut_goes_on(tmp_path, monkeypatch, capsys):
    """A line that was cut is asked again, the others are not; two parts make one file; other trees are not mixed."""
    asked = []

    def ask(name):
        asked.append(name)
        return row(gain=[1.0, 1e-8])

    def groups(*_):
        for name in ("one", "two", "three"):
            yield name, lambda name=name: iter([questions.Question(name, "fold", partial(ask, name), {})])

    monkeypatch.setattr(corpus, "groups", groups)
    for part in ("1/2", "2/2"):
        assert corpus.main([str(tmp_path / "a"), "--part", part]) == 0
    assert asked == ["one", "three", "two"] and set(kept.read(tmp_path / "a")) == set(asked)
    file = tmp_path / "a" / "part-1-of-2.jsonl"
    file.write_text(file.read_text()[:-20])
    assert corpus.main([str(tmp_path / "a")]) == 0
    assert asked[3:] == ["three"]
    again = ["--against", str(tmp_path / "a" / kept.MERGED)]
    assert corpus.main([str(tmp_path / "b"), *again]) == 0
    monkeypatch.setattr(corpus, "groups", lambda *_: [*groups()][:1])
    monkeypatch.setattr(kept, "tree", lambda: "another")
    with pytest.raises(SystemExit, match="another tree"):
        corpus.main([str(tmp_path / "a")])
    (tmp_path / "old").mkdir()
    with pytest.raises(SystemExit, match="neither"):
        corpus.main([str(tmp_path / "c"), "--against", str(tmp_path / "old")])


def test_questions_have_names_of_their_own():
    names = [q.name for _, some in questions.groups(0, 1, 0) for q in some()]
    assert len(names) == len(set(names)) > 90
    assert servos.parameters(5) == servos.parameters(5) != servos.parameters(6)


def missed(asked):
    return compared.untrue({q.name: questions.answered(q) for q in asked if q.truth})


def test_answers_beside_independent_programs():
    """A random servo by its event map and Taylor series, and a cycle of the gallery; the sets know more than none."""
    asked = [q for q in questions.of_random("switch", 0) if q.truth]
    assert len(asked) == 3 and not missed(asked)
    belt = questions.answered(next(questions.Question(*q) for q in gallery.questions("belt", gallery_file("belt"))))
    assert belt["truth"] and not compared.untrue({"belt": belt})


def gallery_file(name):
    return dict(gallery.files())[name]


@pytest.mark.slow
@pytest.mark.parametrize("model", servos.MODELS)
def test_all_truths_of_servos(model):
    """Folds and cycles of Table 1, and of random servos whose truths are kept."""
    numbers = [n for n in range(servos.SERVOS) if len(servos.known().get(f"{model} {n}", {})) > 1]
    most = {"switch": 12, "lugre": 3}[model]
    assert len(numbers) > 3
    asked = [*questions.of_table1(model), *(q for n in numbers[:most] for q in questions.of_random(model, n))]
    assert not missed(asked)


@pytest.mark.slow
def test_truths_of_loops():
    """The cycle of a loop of every kind, by scipy."""
    kept = {name for name, truth in servos.known().items() if name.startswith("loop ") and truth}
    groups = [group for name, group in questions.groups(0, 0, 1) if f"loop {name}" in kept]
    asked = [q for group in groups for q in group() if q.kind == "loop cycle"]
    assert len(asked) > 2 and not missed(asked)
