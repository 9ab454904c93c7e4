"""Files appear whole or not at all, none is read beyond a limit, and one run at a time writes into a folder.

A file is written beside its place, under a name that nobody reads; it is brought to the disk, and takes its name at the
end: who opens the file finds the old one or the new one, whatever
ends the program and however full the disk is.

A folder is locked by the operating system (flock on the folder itself), which lets go when the process ends, however
it ends; only where there is no such lock (Windows, some network drives) a file stands for it.
"""

from __future__ import annotations

import errno
import io
import os
import secrets
import stat
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from .errors import InputError

_NO_PLACE = (
    errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG, errno.ELOOP,
)  # fmt: skip
"""Errors of a path that was wrong from the start; all others came on the way, as a full disk does."""
_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
_ANYBODY_WRITES = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH
"""Of these a file has none that its owner protects, which the system does not tell its administrator."""
LOCK = ".casahunt-lock"
"""The file that locks a folder where the system has no lock for it."""


def bounded(path: str | Path, what: str, most: float) -> bytes:
    """All of a file, or of a pipe, looked at before it is read: it may be a device without an end.

    what: the beginning of a refusal: what the file is; most: bytes that it may hold.
    Raises InputError: no such file, not readable, neither a file nor a pipe (nor a terminal), or too large.
    """
    try:
        with open(path, "rb") as stream:
            found = os.fstat(stream.fileno())
            device = stat.S_ISBLK(found.st_mode) or (stat.S_ISCHR(found.st_mode) and not stream.isatty())
            read = b"" if device or found.st_size > most else stream.read(found.st_size + 1)
            if len(read) > found.st_size:  # a pipe has no size
                read += stream.read(int(most) + 1 - len(read))
    except FileNotFoundError:
        raise InputError(f"{what}: no such file") from None
    except (OSError, ValueError) as error:  # a name with a NUL, the second
        raise InputError(f"{what}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if device:
        raise InputError(f"{what}: must be a file or a pipe, but is a device")
    if max(found.st_size, len(read)) > most:
        raise InputError(f"{what}: must not be larger than {most / 1e6:g} MB")
    return read


@contextmanager
def whole_file(path: str | Path) -> Iterator[IO[bytes]]:
    """A stream whose content stands at `path` when the block ends without an exception, and nowhere otherwise.

    What stood there before is replaced, with its permissions kept; where `path` is a link, what it points to.
    Nothing keeps another run from replacing it in turn: of two runs that write one file the last one wins, and what
    stands there is always all of one of them.

    Raises InputError: there can be no file at `path`: no folder, no permission, a folder of that name; OSError: the
    file could not be written, the disk being full for example; the message names the file.
    """
    try:
        target = Path(os.path.realpath(path))
        if target.exists() and not target.is_file():  # a device or a pipe (a folder refuses): nothing to be renamed
            with target.open("wb") as stream:
                yield stream
            return
        if protected(target):  # renaming would not ask
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        draft = _Draft(path, target)
        try:
            yield draft.stream
            draft.stream.flush()
            os.fsync(draft.stream.fileno())
            if _WAITING.drafts is not None:
                _WAITING.drafts.append(draft)
                return
            draft.publish()
        except BaseException:
            draft.drop()
            raise
    except OSError as error:
        raise _said(path, error) from None


@contextmanager
def together() -> Iterator[None]:
    """Files that are written whole inside take their places one right behind the other, when the block ends.

    Between two points of a run SIGKILL finds the same points in all of them, but for the moment between two renamings
    (microseconds, or as long as the file system takes).  Where one cannot be written, all stay as they were.

    Raises OSError: as `whole_file`.
    """
    drafts: list[_Draft] = []
    _WAITING.drafts = drafts
    try:
        try:
            yield
        finally:
            _WAITING.drafts = None
        for draft in drafts:
            try:
                draft.publish()
            except OSError as error:
                raise _said(draft.path, error) from None
    except BaseException:
        for draft in drafts:
            draft.drop()
        raise


class _Draft:
    """A file beside its place."""

    def __init__(self, path: str | Path, target: Path) -> None:
        self.path, self.target = path, target
        self.beside = target.with_name(f".casahunt-{os.getpid()}-{secrets.token_hex(4)}.partial")
        self.stream = self.beside.open("xb")

    def publish(self) -> None:
        self.stream.close()
        if self.target.exists():
            self.beside.chmod(self.target.stat().st_mode)
        os.replace(self.beside, self.target)

    def drop(self) -> None:
        with suppress(OSError):
            self.stream.close()
        with suppress(OSError):
            self.beside.unlink(missing_ok=True)


class _Waiting(threading.local):
    """The drafts of the `together` that this thread is in."""

    drafts: list[_Draft] | None = None


_WAITING = _Waiting()


@contextmanager
def whole_text(path: str | Path) -> Iterator[IO[str]]:
    """`whole_file` for text: UTF-8, line ends as they are written."""
    with whole_file(path) as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=True)
        try:
            yield text
        finally:
            text.detach()  # the stream is closed by `whole_file`


def _said(path: str | Path, error: OSError) -> Exception:
    if error.errno in _NO_PLACE:
        return InputError(f"cannot write {str(path)!r}: {error.strerror}")
    what = "the disk is full" if error.errno in _FULL else error.strerror or str(error)
    return OSError(error.errno or errno.EIO, f"{str(path)!r}: {what}")


def protected(path: Path) -> bool:
    """Whether what stands at a path may not be written: not by us, or, as its owner has said, by nobody."""
    return path.exists() and not (os.access(path, os.W_OK) and path.stat().st_mode & _ANYBODY_WRITES)


def set_aside(paths: Iterable[Path]) -> dict[Path, Path]:
    """Rename the files that exist to NAME.old (.old2, ... where that is taken); returns where each has gone.

    Raises InputError: one of them is protected; none has gone then.
    """
    found, moved = list(paths), {}
    for path in found:
        if protected(path):
            raise _said(path, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
    for path in found:
        if path.is_file():
            number = 1
            while os.path.lexists(aside := path.with_name(f"{path.name}.old{number if number > 1 else ''}")):
                number += 1
            os.replace(path, aside)
            moved[path] = aside
    return moved


def drop_replaced(moved: dict[Path, Path]) -> list[Path]:
    """Remove what `set_aside` moved and what has been written anew since; returns what stays aside."""
    for path, aside in moved.items():
        if path.exists():
            aside.unlink(missing_ok=True)
    return [aside for aside in moved.values() if aside.exists()]


@contextmanager
def alone_in(folder: Path, made: Sequence[Path] = ()) -> Iterator[None]:
    """Keep every other run out of an existing folder until the block ends.

    folder: where the run writes; made: folders that this run has made for it, innermost first: removed at the end where
    they are still empty. Raises InputError: another run is writing into it.
    """
    with ExitStack() as held:
        if not _flock(folder, made, held):
            path = folder / LOCK
            try:
                handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
            except FileExistsError:
                raise InputError(f"{_taken(folder)}; if there is none, remove {str(path)!r}") from None
            except OSError as error:
                raise _said(path, error) from None
            held.callback(unmake, made)  # called last, when the file is gone
            held.callback(path.unlink, missing_ok=True)
            with os.fdopen(handle, "w") as stream:
                stream.write(f"{os.getpid()}\n")
        yield


def unmake(made: Iterable[Path]) -> None:
    """Remove the folders, innermost first, that hold nothing."""
    for folder in made:
        with suppress(OSError):  # it holds something, or was not made
            folder.rmdir()


def _flock(folder: Path, made: Sequence[Path], held: ExitStack) -> bool:
    """Lock the folder itself; False where the system cannot."""
    try:
        import fcntl
    except ImportError:
        return False
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        held.callback(os.close, handle)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # A run that wrote nothing may have removed its folder between the two lines above.
            if not os.path.samestat(os.fstat(handle), os.stat(folder)):
                raise BlockingIOError
        except (BlockingIOError, FileNotFoundError):
            raise InputError(_taken(folder)) from None
        held.callback(fcntl.flock, handle, fcntl.LOCK_UN)  # a child that has inherited the handle keeps no lock
        held.callback(unmake, made)  # still locked: nobody else loses the folder
        return True
    return False


def _taken(folder: Path) -> str:
    return f"out = {str(folder)!r}: another run is writing into this folder; wait for it, or give another folder"
