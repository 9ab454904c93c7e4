"""Nothing is removed that nothing new replaces; one run at a time in a folder."""

from __future__ import annotations

import pytest
from file_support import cheap_tuning, contents, results, run

from casahunt import files
from casahunt.views.commands.console import folder


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["tune", "--bounds", "x=1,2"], 2),
        (["tune", "--bounds", "gain=2,1"], 2),
        (["tune", "--set", "controller.lead_time=0"], 2),
        (["tune", "--margin", "-1"], 2),
        (["diagram", "--from", "0.8", "--model", "switch"], 1),
        (["diagram", "--from", "100", "--resume"], 2),
        (["diagram", "--tol", "1"], 2),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_run_that_writes_nothing_touches_nothing(capsys, tmp_path, words, code):
    keep = tmp_path / "keep"
    keep.mkdir()
    for name, content in {**results("switch", "lugre"), "notes.txt": b"mine"}.items():
        (keep / name).write_bytes(content)
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in keep.iterdir()}
    assert run(capsys, *words, "--out", keep, "--quiet")[:2] == (code, "")
    assert {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in keep.iterdir()} == before


# One run at a time -------------------------------------------------------------------------------------------


@pytest.fixture(params=["flock", "lock file"])
def lock(request, monkeypatch):
    """Both ways to lock a folder."""
    if request.param == "lock file":
        monkeypatch.setattr(files, "_flock", lambda *_: False)
    return request.param


@pytest.mark.parametrize("words", [["tune"], ["diagram", "--model", "switch", "--from", 0.6]], ids=lambda w: w[0])
def test_a_second_run_is_refused(capsys, tmp_path, monkeypatch, words, lock):
    cheap_tuning(monkeypatch)
    out = tmp_path / "out"
    with folder(str(out), {}):
        (out / "switch.csv").write_text("of the first run")
        before = contents(out)
        code, text, err = run(capsys, *words, "--out", out, "--quiet")
        assert (code, text) == (2, "") and err.count("\n") == 1
        assert f"out = {str(out)!r}: another run is writing into this folder" in err
        assert contents(out) == before
    assert set(contents(out)) == {"switch.csv"}


@pytest.mark.parametrize("trouble", [None, KeyboardInterrupt(), ZeroDivisionError()], ids=repr)
def test_the_folder_is_free_again(tmp_path, trouble, lock):
    out = tmp_path / "new" / "out"
    for _ in range(2):
        try:
            with folder(str(out), {}):
                assert out.is_dir()
                if trouble:
                    raise trouble
        except type(trouble) as error:
            assert error is trouble
        assert not list(tmp_path.iterdir())  # made, not used, unmade
