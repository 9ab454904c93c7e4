"""Orbits on disk: npz with JSON metadata, no pickle.

A file holds two arrays: `metadata`, UTF-8 bytes of one JSON object, and `numbers`, all states, breaks and
scales one after the other.  The metadata carry a schema name and version, the problem as it describes itself, the
method and, for every arc, where its numbers stand and their shapes.  Loading checks all of it and says what is wrong
with a damaged or foreign file.  Who knows the problem poses it again from its description (`Pose`).

The arrays of an npz file, unpacked within limits: what a file holds is not what it takes on the disk.

    npz = zip of NAME.npy, each with its size, its checksum and the way it is packed

The sizes that are stated are looked at first, no more than these is unpacked, whatever follows, and only what numpy
writes: stored or deflated, since what is packed otherwise cannot be unpacked bit by bit.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import casadi as ca
import numpy as np

from ..collocation.scheme import scheme
from ..errors import InputError, Status
from ..files import bounded, whole_file
from ..hybrid.problem import Problem
from ..hybrid.system import Cycle
from .orbit import Arc, Orbit

LARGEST_ARRAYS = {"metadata": 3e7, "numbers": 2e8}
"""Bytes of an array by its name: those of 6000 cycles of four states at the least tolerance, six times the longest
curve that the command line computes.  Reading takes three times as much memory, metadata made for that 25 times."""
FRAME = 1e4
"""Bytes around an array at most: names, checksums, its type and shape."""


def unpacked(content: bytes, name: str, dtypes: Mapping[str, type]) -> dict[str, Array] | None:
    """The arrays of a file, each of one dimension.

    Returns arrays by name; None where the file has others.
    Raises InputError: it is no npz file, is damaged, or would take more memory than `LARGEST_ARRAYS`.
    """
    if not content.startswith(b"PK"):  # every npz file is a zip file, and every zip file begins so
        raise InputError(f"{name} is no npz file")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if not {f"{key}.npy" for key in dtypes} <= set(archive.namelist()):
                return None
            return {key: _array(archive, key, dtype) for key, dtype in dtypes.items()}
    except Exception as error:  # whatever zipfile, zlib and numpy make of bytes that are not as they were written
        raise InputError(f"{name} is damaged: {str(error) or 'it ends too early'}") from None


def _array(archive: zipfile.ZipFile, key: str, dtype: type) -> Array:
    """One array of the file, its size looked at before it is unpacked, its checksum verified before numpy sees it."""
    entry, most = archive.getinfo(f"{key}.npy"), LARGEST_ARRAYS[key]
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{key} is packed as numpy packs nothing")
    if entry.file_size > most + FRAME:
        raise ValueError(f"{key} would take {entry.file_size / 1e6:.0f} MB, and may take {most / 1e6:.0f}")
    with archive.open(entry) as stream:
        unpacked = stream.read(entry.file_size + 1)
    array = np.lib.format.read_array(io.BytesIO(unpacked), allow_pickle=False)
    if array.ndim != 1 or array.dtype != dtype:
        raise ValueError(f"{key} is an array of {array.dtype} with {array.ndim} dimensions")
    return array


Array = np.ndarray
T = TypeVar("T")
Pose = Callable[[Mapping[str, Any]], Problem]
"""From what `Problem.record` gave, and more, to the problem; raises KeyError or ValueError where it is none."""

SCHEMA = "casahunt"
VERSION = 1  # of the format: a file of another one is refused
SIGN = f'{{"schema": "{SCHEMA}"'.encode()
"""How the metadata begin: near the beginning of the file, which is not packed."""


class _Writer:
    """Puts content into words, and its arrays one after the other.

    Attributes
    ----------
    parts, used : the arrays, and how many numbers they are.
    finite : nothing held NaN or infinity.
    """

    def __init__(self) -> None:
        self.parts: list[Array] = []
        self.used = 0
        self.finite = True

    def put(self, array: Array) -> dict[str, Any]:
        """Takes an array; where it stands, as JSON can say it."""
        self.parts.append(np.ascontiguousarray(array, float).ravel())
        place = {"at": self.used, "shape": list(array.shape)}
        self.used += array.size
        return place

    def numbers(self) -> Array:
        """All of them, one after the other."""
        return np.concatenate(self.parts) if self.parts else np.zeros(0)

    def text(self, content: Any) -> str:
        """Content as JSON text, in which orbits may stand; `finite` says whether there is one."""
        if isinstance(content, Orbit):
            return self._plain(orbit_record(content, self))
        if isinstance(content, Mapping):
            return "{" + ", ".join(f"{json.dumps(name)}: {self.text(value)}" for name, value in content.items()) + "}"
        if isinstance(content, list | tuple):
            return f"[{', '.join(map(self.text, content))}]"
        return self._plain(content)

    def _plain(self, content: Any) -> str:
        try:
            return json.dumps(content, allow_nan=False)
        except ValueError:
            self.finite = False
            return "null"


def orbit_record(orbit: Orbit, writer: _Writer) -> dict[str, Any]:
    """One orbit as JSON can say it.

    Returns numbers, texts, lists and tables; of each array its shape and its place among the numbers of the writer.
    """
    return {
        **orbit.problem.record(),
        "half": orbit.half,
        "degree": orbit.degree,
        "scheme": orbit.kind,
        "period": orbit.period,
        "amplitude": orbit.amplitude,
        "period_error": orbit.period_error,
        "amplitude_error": orbit.amplitude_error,
        "parameter_error": orbit.parameter_error,
        "status": orbit.status.name,
        "solver": orbit.solver,
        "iterations": orbit.iterations,
        "unknowns": orbit.unknowns,
        "residual": orbit.residual,
        "wall_s": orbit.wall_s,
        "scale": writer.put(orbit.scale),
        "arcs": [
            {
                "mode": arc.mode,
                "event": arc.event,
                "duration": arc.duration,
                "breaks": writer.put(arc.breaks),
                "states": writer.put(arc.states),
                "end": writer.put(arc.end),
            }
            for arc in orbit.arcs
        ],
    }


def save_orbit(orbit: Orbit, path: str | Path) -> None:
    """Write an orbit (npz).

    Parameters
    ----------
    orbit
        the orbit.
    path
        the file.

    Raises
    ------
    InputError : there can be no file at `path`, or the orbit holds NaN or infinity.
    OSError : the disk is full.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle, load_orbit
    >>> from casahunt.orbits.archive import save_orbit
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_orbit(find_cycle(belt, "slip", x=0.0, v=0.0), Path(folder, "orbit.npz"))
    ...     print(round(load_orbit(Path(folder, "orbit.npz"), belt).period, 6))
    12.001031
    """
    write_archive(path, "orbit", {"orbit": orbit})


def write_archive(path: str | Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write an archive (npz): orbits, and what belongs to them.

    Parameters
    ----------
    path
        the file.
    kind
        what it holds, in a word: its reader asks for that.
    content
        what JSON can say, by names; orbits may stand in it anywhere.

    Raises
    ------
    InputError : there can be no file at `path`, NaN or infinity is to be written, or more than can be read.
    OSError : the disk is full.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import Archive, find_cycle, write_archive
    >>> orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_archive(Path(folder, "pair.npz"), "pair", {"why": "an example", "orbits": [orbit, orbit]})
    ...     Archive(Path(folder, "pair.npz"), "pair").metadata["why"]
    'an example'
    """
    path, writer = Path(path), _Writer()
    metadata = {
        "schema": SCHEMA,
        "version": VERSION,
        "kind": kind,
        "numpy": np.__version__,
        "casadi": ca.__version__,
        **content,
    }
    text = np.frombuffer(writer.text(metadata).encode(), dtype=np.uint8)
    numbers = writer.numbers()
    if not writer.finite or not np.isfinite(numbers).all():
        raise InputError(f"cannot write {str(path)!r}: what it is to hold is NaN or infinite in places")
    for what, array in (("metadata", text), ("numbers", numbers)):
        if array.nbytes > LARGEST_ARRAYS[what]:  # nobody could read them
            most = LARGEST_ARRAYS[what] / 1e6
            raise InputError(f"cannot write {str(path)!r}: its {what} take more than {most:.0f} MB")
    if not path.parent.is_dir():
        raise InputError(f"cannot write {str(path)!r}: there is no folder {str(path.parent)!r}")
    with whole_file(path) as stream:
        np.savez(stream, metadata=text, numbers=numbers)


class Archive:
    """A file that `write_archive` has written.

    Parameters
    ----------
    path, kind
        the file (npz), and what it must hold.

    Attributes
    ----------
    path : the file.
    metadata : its content, orbits as records (`orbit`).
    numbers : (m,) the numbers of all arrays, finite.
    SIGN : how the metadata begin, near the beginning of the file.

    Raises
    ------
    InputError : no such file, none of this schema, version and kind, or damaged.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import Archive, find_cycle, write_archive
    >>> orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_archive(Path(folder, "cycle.npz"), "cycle", {"cycle": orbit})
    ...     archive = Archive(Path(folder, "cycle.npz"), "cycle")
    >>> again = archive.checked(lambda: archive.orbit(archive.metadata["cycle"], lambda record: orbit.problem))
    >>> again.period == orbit.period
    True
    """

    SIGN: ClassVar[bytes] = SIGN

    def __init__(self, path: str | Path, kind: str) -> None:
        self.path = path
        name = repr(str(path))
        found = bounded(path, name, sum(LARGEST_ARRAYS.values()) + FRAME)
        arrays = unpacked(found, name, {"metadata": np.uint8, "numbers": np.float64})
        if arrays is None:
            raise InputError(f"{name} is an npz file, but not one of {SCHEMA}: it has no metadata")
        text, numbers = arrays["metadata"].tobytes(), arrays["numbers"]
        try:
            metadata = json.loads(text, parse_constant=_not_a_number)
        except (ValueError, RecursionError):
            raise InputError(f"{name} is damaged: its metadata are not JSON") from None
        if not isinstance(metadata, dict) or metadata.get("schema") != SCHEMA:
            raise InputError(f"{name} is an npz file, but not one of {SCHEMA}: its metadata have another schema")
        if metadata.get("version") != VERSION:
            version = metadata.get("version")
            raise InputError(f"{name} has the schema version {version!r}; this program reads version {VERSION}")
        if metadata.get("kind") != kind:
            raise InputError(f"{name} holds {_article(metadata.get('kind'))}, not {_article(kind)}")
        if not np.isfinite(numbers).all():
            raise InputError(f"{name} is damaged: it holds NaN or infinity")
        self.metadata, self.numbers = metadata, numbers

    def orbit(self, record: Mapping[str, Any], pose: Pose) -> Any:
        """The orbit of a record.

        Parameters
        ----------
        record
            where an orbit stood in the content.
        pose
            from what `Problem.record` gave, with "half", whether half a cycle was computed, to the problem.

        Returns
        -------
        Orbit, of the class that its problem names.

        Raises
        ------
        KeyError, TypeError, ValueError : the record is none, or does not fit its numbers; see `checked`.
        """
        take = partial(_taken, self.numbers)
        problem, repeats = pose(record), 2 if record["half"] else 1
        cycle = problem.cycle(tuple((a["mode"], a["event"]) for a in record["arcs"]), repeats)
        n, degree, kind = len(cycle.states), int(record["degree"]), record["scheme"]
        scheme(degree, kind)  # refuses what does not exist

        def arc(a: dict[str, Any]) -> Arc:
            breaks = take(a["breaks"], -1)
            if breaks[0] != 0 or breaks[-1] != 1 or not (np.diff(breaks) > 0).all():
                raise ValueError("the breaks of an arc do not run from 0 to 1")
            closed_form = a["states"]["shape"][1:2] == [1]
            states = take(a["states"], breaks.size - 1, 1 if closed_form else degree + 1, n)
            return Arc(a["mode"], a["event"], float(a["duration"]), breaks, states, take(a["end"], n))

        orbit = (problem.orbit_type or Orbit)(
            problem=problem,
            repeats=repeats,
            degree=degree,
            kind=kind,
            arcs=tuple(arc(a) for a in record["arcs"]),
            period=float(record["period"]),
            amplitude=float(record["amplitude"]),
            period_error=float(record["period_error"]),
            amplitude_error=float(record["amplitude_error"]),
            parameter_error=float(record["parameter_error"]),
            status=Status[record["status"]],
            solver=record["solver"],
            iterations=int(record["iterations"]),
            unknowns=int(record["unknowns"]),
            residual=float(record["residual"]),
            wall_s=float(record["wall_s"]),
            scale=take(record["scale"], n),
        )
        _check(orbit, cycle)
        return orbit

    def checked(self, build: Callable[[], T]) -> T:
        """What a function makes of the content.

        Raises
        ------
        InputError : the content does not fit: the function has raised what wrong content makes it raise.
        """
        try:
            return build()
        except KeyError as error:
            what = f"{error} is missing or unknown"
        except (TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
            what = str(error)
        raise InputError(f"{str(self.path)!r} is damaged: its metadata and its numbers do not fit ({what})")


def _not_a_number(text: str) -> float:
    raise ValueError(f"{text} is no number")


def _article(kind: object) -> str:
    return f"{'an' if str(kind)[:1] in 'aeiou' else 'a'} {kind}"


def _taken(numbers: Array, place: dict[str, Any], *shape: int) -> Array:
    """The array at a place among the numbers; -1 in `shape` stands for any length."""
    at, found = place["at"], place["shape"]
    if len(found) != len(shape) or any(n < 1 or m not in (-1, n) for n, m in zip(found, shape, strict=True)):
        raise ValueError(f"an array has the shape {found}")
    size = int(np.prod(found))
    if not 0 <= at <= numbers.size - size:
        raise ValueError(f"{numbers.size} numbers are not enough")
    return numbers[at : at + size].reshape(found).copy()


def _check(orbit: Orbit, cycle: Cycle) -> None:
    """Whether an orbit that was read is one of its cycle."""
    if orbit.solver not in ("ipopt", "newton"):
        raise ValueError(f"the solver {orbit.solver!r} is unknown")
    if cycle.signature != orbit.signature:
        raise ValueError("the arcs are not the phases of a cycle")
    for a, phase in zip(orbit.arcs, cycle.phases, strict=True):
        if (phase.mode.flow is not None) != (a.states.shape[1] == 1):
            raise ValueError(f"the arc {a.mode!r} has {a.states.shape[1]} states in an interval")
    period = cycle.repeats * sum(a.duration for a in orbit.arcs)
    if not abs(period - orbit.period) <= 1e-9 * period:
        raise ValueError("the durations of the arcs do not add up to the period")
