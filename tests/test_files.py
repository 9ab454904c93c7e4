"""Files appear whole or not at all; they are looked at before they are read: devices without an end, what is too large,
what unpacks to too much.
"""

from __future__ import annotations

import errno
import io
import json
import os
import struct
import subprocess
import sys
import threading
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import contents, run
from file_support import ROOT, posix

from casahunt import Servo, files, find_orbit, load, load_branch, load_orbit, load_uncertainty, save_orbit
from casahunt.design.record import file as record_file
from casahunt.design.record.file import read_record
from casahunt.errors import InputError
from casahunt.files import bounded
from casahunt.orbits import archive as npz_arrays
from casahunt.servo import servo as servo_file


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
    with monkeypatch.context() as others:  # its owner may write it, and is somebody else
        others.setattr(os, "access", lambda path, how: how != os.W_OK)
        with pytest.raises(InputError, match="mine.csv': Permission denied"), files.whole_text(path) as stream:
            stream.write("new")
    assert contents(tmp_path) == {"mine.csv": b"old"}
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
            with files.whole_file(path) as stream:
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
        "import sys\nfrom pathlib import Path\nfrom casahunt.files import alone_in, whole_file\n"
        "with alone_in(Path('.')):\n"
        "    for i in range(10**6):\n"
        "        with whole_file('a.bin') as stream:\n"
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


READERS: dict[str, tuple[Callable[[Any], object], float]] = {
    "servo": (load, servo_file.LARGEST_TOML),
    "uncertainty": (lambda path: load_uncertainty(path, Servo()), servo_file.LARGEST_TOML),
    "record": (read_record, record_file.LARGEST_RECORD),
    "orbit": (load_orbit, sum(npz_arrays.LARGEST_ARRAYS.values()) + npz_arrays.FRAME),
    "branch": (load_branch, sum(npz_arrays.LARGEST_ARRAYS.values()) + npz_arrays.FRAME),
}


@contextmanager
def unread(most: float = 4e4) -> Iterator[None]:
    """No more memory is taken than so many bytes; by default less than any reader may read."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()


def assert_unread(read: Callable[[Any], object], path: Any, sentence: str) -> None:
    """A reader refuses a file unread: at the second time, when whatever that loads or compiles is there."""
    for watched in (nullcontext, unread):
        with watched(), pytest.raises(InputError, match=sentence):
            read(path)


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null", "/dev/full"])
@pytest.mark.parametrize("what", READERS)
def test_a_device_is_refused(what, device):
    if not Path(device).is_char_device():
        pytest.skip("no such device")
    assert_unread(READERS[what][0], device, rf"{device}': must be a file or a pipe, but is a device$")


@pytest.mark.parametrize("what", READERS)
def test_what_is_too_large_is_not_read(tmp_path, what):
    """A sparse file, a byte beyond the limit."""
    read, most = READERS[what]
    path = tmp_path / "large"
    with path.open("wb") as stream:
        stream.truncate(int(most) + 1)
    assert_unread(read, path, rf"large': must not be larger than {most / 1e6:g} MB$")


def test_the_limit_is_no_byte_less(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"123")
    assert bounded(path, "it", 3) == b"123"
    with pytest.raises(InputError):
        bounded(path, "it", 2)


@pytest.fixture
def piped():
    """The other end of a pipe into which something is written, as a path."""
    ends: list[int] = []

    def led(text: bytes, times: int = 1) -> str:
        reader, writer = os.pipe()
        ends.append(reader)

        def write() -> None:
            with open(writer, "wb", buffering=0) as stream:
                try:
                    for _ in range(times):
                        stream.write(text)
                except BrokenPipeError:
                    pass

        threading.Thread(target=write, daemon=True).start()
        return f"/dev/fd/{reader}"

    yield led
    for reader in ends:
        os.close(reader)


@posix
@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="no names for handles")
def test_a_pipe_is_read_as_the_file(tmp_path, piped, capsys):
    """All of it, where a second look at a pipe would find what the first has left."""
    rows = "".join(f"{0.01 * i:.2f},{np.sin(0.3 * i):.6f}\n" for i in range(5000))
    (tmp_path / "a.csv").write_text(f"time_s,position_rad\n{rows}")
    (tmp_path / "a.toml").write_text("[friction]\nstatic = 0.55\n")
    save_orbit(find_orbit(Servo(), "switch", 0.1), tmp_path / "a.npz")
    content = {path.suffix: path.read_bytes() for path in tmp_path.iterdir()}
    file, pipe = read_record(tmp_path / "a.csv"), read_record(piped(content[".csv"]))
    assert len(file.times) == 5000
    assert pipe.times.tolist() == file.times.tolist() and pipe.position.tolist() == file.position.tolist()
    assert load(piped(content[".toml"])) == load(tmp_path / "a.toml")
    assert load_orbit(piped(content[".npz"])).period == load_orbit(tmp_path / "a.npz").period
    code, out, err = run(capsys, "loop", piped(content[".toml"]), "--gain", 0.1, "--json", "--quiet")
    assert code == 0 and json.loads(out) and not err


@posix
@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="no names for handles")
def test_a_pipe_without_an_end_ends(piped):
    with pytest.raises(InputError, match="must not be larger than 0.05 MB"):
        load(piped(b"#" * 60_000, times=10**9))


# Archives ----------------------------------------------------------------------------------------------------

MOST = 100_000  # of the numbers; of the metadata it is what it is


def pack(path: Path, count: int, method: int, says: int | None = None) -> None:
    """An archive of zeros; `says`: the bytes of the numbers that its directory states."""
    metadata, numbers = io.BytesIO(), io.BytesIO()
    text = json.dumps({"schema": "casahunt", "version": 1, "kind": "orbit"}).encode()
    np.save(metadata, np.frombuffer(text, dtype=np.uint8))
    np.save(numbers, np.zeros(count))
    with zipfile.ZipFile(path, "w", method) as file:
        file.writestr("metadata.npy", metadata.getvalue())
        file.writestr("numbers.npy", numbers.getvalue())
    if says is not None:
        true, stated = (struct.pack("<I", size) for size in (numbers.tell() or len(numbers.getvalue()), says))
        content = path.read_bytes()
        assert content.count(true) == 2  # before the data, and in the directory
        path.write_bytes(content.replace(true, stated))


@pytest.mark.parametrize(
    ("method", "says", "said"),
    [
        (zipfile.ZIP_DEFLATED, None, "numbers would take 40 MB, and may take 0$"),
        (zipfile.ZIP_DEFLATED, 8 * 100 + 128, "is damaged"),
        (zipfile.ZIP_LZMA, None, "is packed as numpy packs nothing$"),
        (zipfile.ZIP_LZMA, 8 * 100 + 128, "is packed as numpy packs nothing$"),
        (zipfile.ZIP_BZIP2, None, "is packed as numpy packs nothing$"),
    ],
    ids=["says so", "says less", "lzma", "lzma says less", "bzip2"],
)
def test_an_archive_is_not_unpacked_to_its_size(tmp_path, monkeypatch, method, says, said):
    """40 MB from a file of 40 kB; the memory that is taken is that of the limit."""
    monkeypatch.setitem(npz_arrays.LARGEST_ARRAYS, "numbers", MOST)
    path = tmp_path / "a.npz"
    pack(path, 5_000_000, method, says)
    assert path.stat().st_size < MOST
    with unread(20 * MOST), pytest.raises(InputError, match=said):
        load_orbit(path)


def test_numpys_own_way_to_pack_is_read(tmp_path):
    save_orbit(find_orbit(Servo(), "switch", 0.1), tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        np.savez_compressed(tmp_path / "b.npz", **file)
    assert load_orbit(tmp_path / "b.npz").period == load_orbit(tmp_path / "a.npz").period


@pytest.mark.parametrize("what", ["metadata", "numbers"])
def test_nothing_is_written_that_could_not_be_read(tmp_path, monkeypatch, what):
    monkeypatch.setitem(npz_arrays.LARGEST_ARRAYS, what, 100)
    with pytest.raises(InputError, match=f"a.npz': its {what} take more than 0 MB"):
        save_orbit(find_orbit(Servo(), "switch", 0.1), tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())
