"""Orbits and branches on disk: npz with JSON metadata, no pickle.

A file holds two arrays: `metadata`, UTF-8 bytes of one JSON object, and `numbers`, all states, breaks and
scales one after the other.  The metadata carry a schema name and version, the servo, the method and, for
every arc, where its numbers stand and their shapes.  Loading checks all of it and says what is wrong with
a damaged or foreign file.
"""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from .branch import Branch, SpecialPoint
from .errors import InputError, Status
from .orbit import Arc, Orbit
from .servo import flatten, unflatten

Array = np.ndarray

SCHEMA = "casahunt"
VERSION = 1


class _Writer:
    """Collects arrays; hands out their place."""

    def __init__(self) -> None:
        self.parts: list[Array] = []
        self.used = 0

    def put(self, array: Array) -> dict[str, Any]:
        self.parts.append(np.ascontiguousarray(array, float).ravel())
        place = {"at": self.used, "shape": list(array.shape)}
        self.used += array.size
        return place

    def numbers(self) -> Array:
        return np.concatenate(self.parts) if self.parts else np.zeros(0)


def _orbit_record(orbit: Orbit, writer: _Writer) -> dict[str, Any]:
    return {
        "model": orbit.model,
        "servo": flatten(orbit.servo),
        "gain": orbit.gain,
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
    """Write an orbit to `path` (npz).  Raises InputError where that is not possible."""
    writer = _Writer()
    _write(path, "orbit", {"orbit": _orbit_record(orbit, writer)}, writer)


def save_branch(branch: Branch, path: str | Path) -> None:
    """Write a branch to `path` (npz).  Raises InputError where that is not possible."""
    writer = _Writer()
    content = {
        "model": branch.model,
        "servo": flatten(branch.servo),
        "ended": branch.ended,
        "orbits": [_orbit_record(orbit, writer) for orbit in branch.orbits],
        "special": [
            {"kind": s.kind, "meaning": s.meaning, "orbit": _orbit_record(s.orbit, writer)} for s in branch.special
        ],
    }
    _write(path, "branch", content, writer)


def _write(path: str | Path, kind: str, content: dict[str, Any], writer: _Writer) -> None:
    path = Path(path)
    metadata = {
        "schema": SCHEMA,
        "version": VERSION,
        "kind": kind,
        "numpy": np.__version__,
        "casadi": ca.__version__,
        **content,
    }
    text = np.frombuffer(json.dumps(metadata).encode(), dtype=np.uint8)
    # Written beside and moved into place: an interrupt never leaves half a file under the final name.
    partial = path.with_name(path.name + ".partial")
    try:
        with partial.open("wb") as stream:
            np.savez(stream, metadata=text, numbers=writer.numbers())
        os.replace(partial, path)
    except OSError as error:
        raise InputError(f"cannot write {str(path)!r}: {error.strerror or error}") from None


def load_orbit(path: str | Path) -> Orbit:
    """Read an orbit written by `save_orbit`.  Raises InputError for anything else, saying what is wrong."""
    metadata, numbers = _read(path, "orbit")
    return _checked(path, lambda: _orbit(metadata["orbit"], numbers))


def load_branch(path: str | Path) -> Branch:
    """Read a branch written by `save_branch`.  Raises InputError for anything else, saying what is wrong."""
    metadata, numbers = _read(path, "branch")
    return _checked(
        path,
        lambda: Branch(
            model=metadata["model"],
            servo=unflatten(metadata["servo"]),
            orbits=tuple(_orbit(record, numbers) for record in metadata["orbits"]),
            ended=str(metadata["ended"]),
            special=tuple(
                SpecialPoint(s["kind"], _orbit(s["orbit"], numbers), s["meaning"]) for s in metadata["special"]
            ),
        ),
    )


def _checked(path: str | Path, build: Any) -> Any:
    try:
        return build()
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"{str(path)!r} is damaged: its metadata and its numbers do not fit ({error!r})") from None


def _read(path: str | Path, kind: str) -> tuple[dict[str, Any], Array]:
    name = repr(str(path))
    try:
        with np.load(Path(path), allow_pickle=False) as file:
            if not {"metadata", "numbers"} <= set(getattr(file, "files", ())):
                raise InputError(f"{name} is an npz file, but not one of casahunt: it has no metadata")
            text, numbers = bytes(file["metadata"]), np.asarray(file["numbers"], float)
    except FileNotFoundError:
        raise InputError(f"{name}: no such file") from None
    except (OSError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{name} is damaged or no npz file: {error}") from None
    except InputError:
        raise
    except (ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{name} is no npz file of casahunt: {error}") from None
    try:
        metadata = json.loads(text)
    except ValueError:
        raise InputError(f"{name} is damaged: its metadata are not JSON") from None
    if not isinstance(metadata, dict) or metadata.get("schema") != SCHEMA:
        raise InputError(f"{name} is an npz file, but not one of casahunt")
    if metadata.get("version") != VERSION:
        found = metadata.get("version")
        raise InputError(f"{name} has the schema version {found!r}; this program reads version {VERSION}")
    if metadata.get("kind") != kind:
        raise InputError(f"{name} holds a {metadata.get('kind')}, not a {kind}")
    if not np.isfinite(numbers).all():
        raise InputError(f"{name} is damaged: it holds NaN or infinity")
    return metadata, numbers


def _orbit(record: dict[str, Any], numbers: Array) -> Orbit:
    def take(place: dict[str, Any]) -> Array:
        size = int(np.prod(place["shape"]))
        part = numbers[place["at"] : place["at"] + size]
        return part.reshape(place["shape"]).copy()

    arcs = tuple(
        Arc(a["mode"], a["event"], float(a["duration"]), take(a["breaks"]), take(a["states"]), take(a["end"]))
        for a in record["arcs"]
    )
    orbit = Orbit(
        model=record["model"],
        servo=unflatten(record["servo"]),
        gain=float(record["gain"]),
        half=bool(record["half"]),
        degree=int(record["degree"]),
        kind=record["scheme"],
        arcs=arcs,
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
        scale=take(record["scale"]),
    )
    if len(orbit.cycle.phases) != len(arcs):
        raise ValueError("arcs and phase sequence differ")
    return orbit
