"""What a command may write: nothing that it reads, nothing twice, and in its folder only over casahunt's own files.

    input, output     one file if the system says so: by another name, a link, other letters (device and inode)
    --out             what has the name of a result there must be a result: known by its sign, bytes that every file of
                      its kind holds, whoever copied it, and however its run ended

Both are looked at before anything is computed, for every command (cli.py); the folder once more before it is written.
"""

from __future__ import annotations

import argparse
import os
import stat
from collections.abc import Mapping
from pathlib import Path

from ...errors import InputError
from ...files import protected, together, whole_text

READ = {"servo_file": "the servo file", "uncertainty": "the uncertainty file"} | dict.fromkeys(
    ("file", "records"), "the record"
)
"""By the names of arguments: what is read."""
WRITTEN = {"csv": (".csv",), "save": (".npz",), "plot": (".png", ".pdf", ".svg")}
"""Arguments that name a file to be written, and how its name may end; `out` names a folder, in which `options.results`
says what is written."""
SIGNED = 1_000_000
"""Bytes of a file in which its sign stands; the largest of those with a sign at their end, tune.json, has 6 kB."""

Signs = Mapping[str, bytes]
"""Files of a folder by their names: what stands in each that casahunt has written."""


def keep_inputs(options: argparse.Namespace) -> None:
    """Refuse a command line that would write what it reads, or two things into one file, or where nothing can be.

    options: of its files to be written, names become paths. Raises InputError: it would.
    """
    taken: dict[tuple[int, int] | str, str] = {}
    for name, what in READ.items():
        given = getattr(options, name, None)
        for path in given if isinstance(given, list) else [] if given is None else [given]:
            if not (found := _file(path)):
                continue
            taken[found] = f"{what} {path!r}, which is read"
    # Names and places of all that it writes: paths, and the handle that the shell may have led into a file
    written: list[tuple[str, str | int]] = [("standard output", 1)]
    written += [(name, path) for name in WRITTEN if (path := getattr(options, name, None))]
    if getattr(options, "out", None):
        written += [("out", os.path.join(options.out, name)) for name in options.results(options)]
    for name, place in written:
        found = _file(place)
        if found in taken:
            said = f"{name} = {place!r}" if isinstance(place, str) else name
            raise InputError(f"{said}: must be another file than {taken[found]}")
        if found:
            taken[found] = f"that of {name}"
    for name, suffixes in WRITTEN.items():
        setattr(options, name, writable(name, getattr(options, name, None), suffixes))


def _file(place: str | int) -> tuple[int, int] | str | None:
    """What the system knows a file by; its path where there is none yet, None for what can be read and written."""
    try:
        found = os.stat(place)
    except (OSError, ValueError):
        return None if isinstance(place, int) else os.path.normcase(os.path.realpath(place))
    return (found.st_dev, found.st_ino) if stat.S_ISREG(found.st_mode) else None


def writable(key: str, path: str | None, suffixes: tuple[str, ...]) -> Path | None:
    """A file that can be written.

    key, path: what the user calls it, and what was given; None: no file is wanted; suffixes: of which the name must
    have one, in small letters. Returns the file; None where none is wanted. Raises InputError: another suffix, no such
    folder, no permission.
    """
    if path is None:
        return None
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise InputError(f"{key} = {path!r}: the name must end in {' or '.join(suffixes)}")
    try:
        if not target.parent.is_dir():
            raise InputError(f"{key} = {path!r}: there is no folder {str(target.parent)!r}")
        if target.is_dir():
            raise InputError(f"{key} = {path!r}: must be a file, but is a folder")
    except OSError as error:
        raise InputError(f"{key} = {path!r}: cannot be written ({error.strerror})") from None
    renamed = target.is_file() or not target.exists()  # a device or a pipe is written straight
    if protected(target) or (renamed and not os.access(target.parent, os.W_OK)):
        raise InputError(f"{key} = {path!r}: cannot be written (no permission)")
    return target


def write_results(folder: str | Path, results: Signs, texts: Mapping[str, str]) -> None:
    """Write results of one run, all of them or none.

    folder, results, texts: the folder, what may be written into it, and what is, by name.
    Raises InputError: as `keep_others`; computing has taken its time.
    """
    keep_others(folder, results)
    with together():
        for name, text in texts.items():
            with whole_text(Path(folder, name)) as stream:
                stream.write(text)


def keep_others(folder: str | Path, results: Signs) -> None:
    """Refuse a folder in which something that casahunt has not written has the name of a result.

    folder, results: the folder, and what is to be written into it.
    Raises InputError: it holds such a file, or one that is protected from being written.
    """
    for name, sign in results.items():
        path = Path(folder, name)
        try:
            if not path.exists():
                continue
            if path.is_dir():
                raise InputError(f"out = {str(folder)!r}: the folder cannot be written into ({name} is a folder)")
            ours = path.is_file()
            if ours:
                with path.open("rb") as stream:
                    ours = sign in stream.read(SIGNED)
        except OSError:
            ours = False
        if not ours:
            raise InputError(
                f"out = {str(folder)!r}: the folder holds a {name} that this version of casahunt did not write; move "
                "it away, or give another folder"
            )
        if protected(path):
            raise InputError(
                f"out = {str(folder)!r}: {name} in the folder is protected from being written; move it away, or give "
                "another folder"
            )
