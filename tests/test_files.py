"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from file_support import ROOT, contents, posix, run

from casahunt import files
from casahunt.errors import InputError


@pytest.mark.parametrize("trouble", [KeyboardInterrupt(), ZeroDivisionError(), OSError(errno.EIO, "broken")], ids=repr)
def test_trouble_leaves_the_old_file(tmp_path, trouble):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(type(trouble)), files.whole_text(path) as stream:
        stream.write("half")
        raise trouble
    assert contents(tmp_path) == {"a.txt": b"old"}
    with files.whole_text(path) as stream:
        stream.write("θ\n")
    assert contents(tmp_path) == {"a.txt": "θ\n".encode()}


@pytest.mark.parametrize("missing", ["O_TMPFILE", "link"])
def test_other_file_systems(tmp_path, monkeypatch, missing):
    """Without files that have no name, and where such a file cannot be given one."""
    if missing == "link":
        monkeypatch.setattr(os, "link", lambda *a, **k: os.open("/nowhere/at/all", os.O_RDONLY))
    else:
        monkeypatch.delattr(os, missing, raising=False)
    path = tmp_path / "a.txt"
    for text in ("one", "another"):
        with files.whole_text(path) as stream:
            stream.write(text)
        assert contents(tmp_path) == {"a.txt": text.encode()}
    with pytest.raises(ZeroDivisionError), files.whole_text(path) as stream:
        raise ZeroDivisionError
    assert contents(tmp_path) == {"a.txt": b"another"}


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="files without a name")
def test_what_is_being_written_has_no_name(tmp_path):
    try:
        os.close(os.open(tmp_path, os.O_TMPFILE | os.O_RDWR))
    except OSError:
        pytest.skip("not on this file system")
    with files.whole(tmp_path / "a.bin") as stream:
        stream.write(b"half")
        stream.flush()
        assert not list(tmp_path.iterdir())
    assert contents(tmp_path) == {"a.bin": b"half"}


@posix
def test_what_is_replaced_keeps_its_permissions_and_its_links(tmp_path):
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    with files.whole_text(link) as stream:
        stream.write("new")
    assert link.is_symlink() and path.read_text() == "new" and path.stat().st_mode & 0o777 == 0o640


@posix
def test_a_file_that_may_not_be_written_is_not_replaced(tmp_path, monkeypatch):
    """Renaming would not ask: it needs no permission but the folder's."""
    path = tmp_path / "mine.csv"
    path.write_text("old")
    path.chmod(0o444)
    if os.access(path, os.W_OK):  # to root everything is allowed
        monkeypatch.setattr(os, "access", lambda path, how: bool(Path(path).stat().st_mode & 0o222))
    with pytest.raises(InputError, match="mine.csv': Permission denied"), files.whole_text(path) as stream:
        stream.write("new")
    assert contents(tmp_path) == {"mine.csv": b"old"}
    path.chmod(0o644)
    with files.whole_text(path) as stream:
        stream.write("new")
    assert contents(tmp_path) == {"mine.csv": b"new"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full")
def test_a_device_is_written_and_not_replaced(tmp_path, capsys):
    path = tmp_path / "a.csv"
    path.symlink_to("/dev/full")
    code, out, err = run(capsys, "simulate", "--gain", 0.1, "--time", 1, "--csv", path)
    assert code == 1 and out.startswith("switch servo at gain 0.1 V/rad, ")
    assert err == f"casahunt simulate: the output could not be written: {str(path)!r}: the disk is full\n"
    assert Path("/dev/full").is_char_device() and path.is_symlink()


def test_a_reader_sees_the_old_or_the_new(tmp_path):
    """Two writers and a reader at the same time."""
    path, seen, ended = tmp_path / "a.bin", set(), threading.Event()
    path.write_bytes(b"0" * 300_000)

    def write(letter: bytes) -> None:
        for _ in range(20):
            with files.whole(path) as stream:
                for _ in range(300):
                    stream.write(letter * 1000)

    def read() -> None:
        while not ended.is_set():
            content = path.read_bytes()
            seen.add((len(content), len(set(content))))

    writers = [threading.Thread(target=write, args=(letter,)) for letter in (b"a", b"b")]
    reader = threading.Thread(target=read)
    for thread in (reader, *writers):
        thread.start()
    for thread in writers:
        thread.join()
    ended.set()
    reader.join()
    assert seen == {(300_000, 1)} and [p.name for p in tmp_path.iterdir()] == ["a.bin"]


@posix
def test_a_kill_leaves_no_torn_file_and_no_lock(tmp_path):
    code = (
        "import sys\nfrom pathlib import Path\nfrom casahunt.files import alone_in, whole\n"
        "with alone_in(Path('.')):\n"
        "    for i in range(10**6):\n"
        "        with whole('a.bin') as stream:\n"
        "            for _ in range(500): stream.write(bytes([i % 256]) * 1000)\n"
        "        print(i, flush=True)\n"
    )
    for wait in (1, 4):
        where = {**os.environ, "PYTHONPATH": str(ROOT)}
        child = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, env=where)
        try:
            for _ in range(wait):
                assert child.stdout is not None and child.stdout.readline()
            with pytest.raises(InputError, match="another run is writing into this folder"), files.alone_in(tmp_path):
                pass
        finally:
            child.kill()
            child.communicate()
        content = (tmp_path / "a.bin").read_bytes()
        assert len(content) == 500_000 and len(set(content)) == 1
        with files.alone_in(tmp_path):
            pass
