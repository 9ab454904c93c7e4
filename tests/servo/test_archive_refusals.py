"""Files that are not what they should be are refused in one sentence."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
from archived import assert_same, computed, refusal

from casahunt import Branch, InputError, SpecialPoint, load_branch, load_orbit, save_branch, save_orbit
from casahunt.orbits.archive import VERSION


@pytest.fixture
def orbit_file(tmp_path):
    path = tmp_path / "orbit.npz"
    save_orbit(computed("switch"), path)
    return path


@pytest.fixture
def branch_file(tmp_path):
    path = tmp_path / "branch.npz"
    orbit = computed("switch")
    save_branch(Branch("gain", (orbit,), (SpecialPoint("fold", orbit, "a fold"),)), path)
    return path


def rewritten(path, edit):
    """Change (metadata, numbers) of a file; `edit` returns the new pair."""
    with np.load(path, allow_pickle=False) as file:
        metadata, numbers = json.loads(bytes(file["metadata"])), file["numbers"].copy()
    metadata, numbers = edit(metadata, numbers)
    text = metadata if isinstance(metadata, bytes) else json.dumps(metadata).encode()
    np.savez(path, metadata=np.frombuffer(text, dtype=np.uint8), numbers=numbers)


@pytest.mark.parametrize("load", [load_orbit, load_branch])
def test_missing_file(tmp_path, load):
    path = tmp_path / "none.npz"
    assert refusal(load, path) == f"{str(path)!r}: no such file"


@pytest.mark.parametrize("load", [load_orbit, load_branch])
def test_folder(tmp_path, load):
    message = refusal(load, tmp_path)
    assert repr(str(tmp_path)) in message and "cannot be read" in message


@pytest.mark.parametrize(
    "content",
    [b"", b"P", b"hello\n", b"[servo]\ninertia = 1\n", bytes(1000), np.random.default_rng(1).bytes(5000)],
    ids=["empty", "one byte", "text", "toml", "zeros", "noise"],
)
def test_no_npz_file(tmp_path, content):
    path = tmp_path / "some.npz"
    path.write_bytes(content)
    for load in (load_orbit, load_branch):
        message = refusal(load, path)
        assert repr(str(path)) in message and "no npz file" in message


def test_npy_file(tmp_path):
    np.save(tmp_path / "some.npy", np.ones(3))
    assert "no npz file" in refusal(load_orbit, tmp_path / "some.npy")


def test_zip_file(tmp_path):
    with zipfile.ZipFile(tmp_path / "some.npz", "w") as archive:
        archive.writestr("metadata.npy", "not an array")
        archive.writestr("numbers.npy", "not an array")
    assert "is damaged" in refusal(load_orbit, tmp_path / "some.npz")


def test_pickled_arrays_are_refused(tmp_path):
    path = tmp_path / "some.npz"
    np.savez(path, metadata=np.array([{"schema": "casahunt"}], dtype=object), numbers=np.zeros(3))
    message = refusal(load_orbit, path)
    assert repr(str(path)) in message and "damaged" in message


@pytest.mark.parametrize("load", ["orbit", "branch"])
def test_truncated_file(orbit_file, branch_file, load):
    path, read = (orbit_file, load_orbit) if load == "orbit" else (branch_file, load_branch)
    whole = path.read_bytes()
    for kept in [0, 1, 2, 3, 20, 100, *range(200, len(whole), len(whole) // 40), len(whole) - 1]:
        path.write_bytes(whole[:kept])
        message = refusal(read, path)
        assert repr(str(path)) in message and ("damaged" in message or "no npz file" in message), (kept, message)


@pytest.mark.parametrize("mask", [0x01, 0x80, 0xFF])
def test_flipped_bytes(orbit_file, mask):
    """A checksum covers both arrays; a byte of the zip directory that says nothing about them may change."""
    whole = orbit_file.read_bytes()
    refused = 0
    ends = {*range(300), *range(len(whole) - 300, len(whole))}  # headers and directory of the file
    places = sorted(ends | set(range(300, len(whole), 97)))
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= mask
        orbit_file.write_bytes(damaged)
        try:
            loaded = load_orbit(orbit_file)
        except InputError as error:
            refused += 1
            assert repr(str(orbit_file)) in str(error)
        else:
            assert_same(loaded, computed("switch"))
    assert refused > len(places) // 2


def test_foreign_npz(tmp_path):
    path = tmp_path / "foreign.npz"
    np.savez(path, x=np.ones(3))
    assert refusal(load_orbit, path) == f"{str(path)!r} is an npz file, but not one of casahunt: it has no metadata"
    np.savez(path, metadata=np.ones(3), numbers=np.ones(3))
    assert "metadata is an array of float64" in refusal(load_orbit, path)
    np.savez(path, metadata=np.frombuffer(b"{}", dtype=np.uint8), numbers=np.array(["a"]))
    assert "numbers is an array of <U1" in refusal(load_orbit, path)


@pytest.mark.parametrize("schema", ["another program", None, 3])
def test_other_schema(orbit_file, schema):
    rewritten(orbit_file, lambda m, n: (m | {"schema": schema}, n))
    message = refusal(load_orbit, orbit_file)
    assert repr(str(orbit_file)) in message and "not one of casahunt" in message


@pytest.mark.parametrize("version", [0, VERSION + 1, "1", None])
def test_other_version(orbit_file, version):
    rewritten(orbit_file, lambda m, n: (m | {"version": version}, n))
    message = refusal(load_orbit, orbit_file)
    assert f"schema version {version!r}; this program reads version {VERSION}" in message


def test_orbit_is_no_branch(orbit_file, branch_file):
    assert refusal(load_branch, orbit_file) == f"{str(orbit_file)!r} holds an orbit, not a branch"
    assert refusal(load_orbit, branch_file) == f"{str(branch_file)!r} holds a branch, not an orbit"


@pytest.mark.parametrize("text", [b"", b"{", b"\xff\xfe", b"[1, 2]", b"3", b"null", b"[" * 100_000])
def test_broken_metadata(orbit_file, text):
    rewritten(orbit_file, lambda m, n: (text, n))
    message = refusal(load_orbit, orbit_file)
    assert repr(str(orbit_file)) in message and "metadata" in message


@pytest.mark.parametrize("kept", [0, 1, -1])
def test_numbers_too_short(orbit_file, kept):
    rewritten(orbit_file, lambda m, n: (m, n[:kept]))
    message = refusal(load_orbit, orbit_file)
    assert "is damaged" in message and "numbers are not enough" in message


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_not_finite(orbit_file, branch_file, value):
    def edit(metadata, numbers):
        numbers[numbers.size // 2] = value
        return metadata, numbers

    for path, load in ((orbit_file, load_orbit), (branch_file, load_branch)):
        rewritten(path, edit)
        assert refusal(load, path) == f"{str(path)!r} is damaged: it holds NaN or infinity"


def test_metadata_not_finite(orbit_file):
    rewritten(orbit_file, lambda m, n: (m | {"orbit": m["orbit"] | {"period": float("nan")}}, n))
    assert "not JSON" in refusal(load_orbit, orbit_file)


RECORD_KEYS = sorted(
    ["model", "servo", "gain", "half", "degree", "scheme", "period", "amplitude", "period_error", "amplitude_error"]
    + ["parameter_error", "status", "solver", "iterations", "unknowns", "residual", "wall_s", "scale", "arcs"]
)


@pytest.mark.parametrize("key", RECORD_KEYS)
def test_metadata_without_a_key(orbit_file, key):
    def edit(metadata, numbers):
        assert set(metadata["orbit"]) == set(RECORD_KEYS)
        del metadata["orbit"][key]
        return metadata, numbers

    rewritten(orbit_file, edit)
    message = refusal(load_orbit, orbit_file)
    assert "is damaged" in message and f"{key!r} is missing" in message


@pytest.mark.parametrize("value", [None, "x", -1, 1e308, [], {}, [None], {"at": 0}], ids=repr)
def test_metadata_with_a_wrong_value(orbit_file, value):
    """Wherever it stands: an InputError or, where any value will do, an orbit; nothing else."""
    whole = orbit_file.read_bytes()

    def places(tree, path=()):
        for key, below in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield (*path, key)
            if isinstance(below, dict | list):
                yield from places(below, (*path, key))

    with np.load(orbit_file) as file:
        all_places = list(places(json.loads(bytes(file["metadata"]))))
    assert len(all_places) > 60
    refused = 0
    for *path, last in all_places:
        orbit_file.write_bytes(whole)

        def edit(metadata, numbers, path=path, last=last):
            tree = metadata
            for key in path:
                tree = tree[key]
            tree[last] = value
            return metadata, numbers

        rewritten(orbit_file, edit)
        try:
            loaded = load_orbit(orbit_file)
        except InputError as error:
            refused += 1
            assert repr(str(orbit_file)) in str(error)
        else:
            assert loaded.arcs and loaded.cycle
    assert refused > len(all_places) // 2


@pytest.mark.parametrize(
    ("edit", "complaint"),
    [
        (lambda r: r.update(status="WONDERFUL"), "WONDERFUL"),
        (lambda r: r.update(model="swich"), "swich"),
        (lambda r: r.update(model="lugre"), "no cycle with the phases"),
        (lambda r: r.update(scheme="lobatto"), "lobatto"),
        (lambda r: r.update(degree=99), "degree"),
        (lambda r: r.update(degree=r["degree"] - 1), "shape"),
        (lambda r: r.update(gain=-0.1), "gain = -0.1: must be greater than 0"),
        (lambda r: r.update(half=False), "do not add up"),
        (lambda r: r.update(arcs=r["arcs"][:1] * 2), "do not add up"),
        (lambda r: r["arcs"][0].update(duration=-1.0), "do not add up"),
        (lambda r: r.update(period=2 * r["period"]), "do not add up"),
        (lambda r: r["arcs"][0].update(mode="fly"), "fly"),
        (lambda r: r["arcs"][1].update(mode="slip+"), "no cycle with the phases"),
        (
            lambda r: r["arcs"][1].update(states=r["arcs"][0]["states"], breaks=r["arcs"][0]["breaks"]),
            "states in an interval",
        ),
        (lambda r: r["arcs"][0].update(event="landing"), "landing"),
        (lambda r: r["arcs"][0]["breaks"].update(at=-1), "not enough"),
        (lambda r: r["arcs"][0]["breaks"].update(at=10**9), "not enough"),
        (lambda r: r["arcs"][0]["breaks"].update(at=r["arcs"][0]["states"]["at"]), "breaks"),
        (lambda r: r["arcs"][0]["states"].update(shape=[1, 2]), "shape"),
        (lambda r: r["scale"].update(shape=[4]), "shape"),
        (lambda r: r["servo"].update({"friction.statik": 1.0}), "friction.statik"),
        (lambda r: r["servo"].update({"servo.inertia": -1.0}), "servo.inertia = -1: must be greater than 0"),
    ],
)
def test_metadata_that_contradict_themselves(orbit_file, edit, complaint):
    def edited(metadata, numbers):
        edit(metadata["orbit"])
        return metadata, numbers

    rewritten(orbit_file, edited)
    message = refusal(load_orbit, orbit_file)
    assert repr(str(orbit_file)) in message and "is damaged" in message
    assert complaint in message


def test_branch_of_two_models(branch_file):
    save_branch(Branch("gain", (computed("switch"), computed("lugre"))), branch_file)
    assert "another model" in refusal(load_branch, branch_file)


@pytest.mark.parametrize("key", ["ended", "orbits", "special"])
def test_branch_without_a_key(branch_file, key):
    rewritten(branch_file, lambda m, n: ({k: v for k, v in m.items() if k != key}, n))
    assert f"{key!r} is missing" in refusal(load_branch, branch_file)
