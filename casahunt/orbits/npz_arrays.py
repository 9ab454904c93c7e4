"""The arrays of an npz file, unpacked within limits: what a file holds is not what it takes on the disk.

    npz = zip of NAME.npy, each with its size, its checksum and the way it is packed

The sizes that are stated are looked at first, no more than these is unpacked, whatever follows, and only what numpy
writes: stored or deflated, since what is packed otherwise cannot be unpacked bit by bit.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

import numpy as np

from ..errors import InputError

Array = np.ndarray

LARGEST_ARRAYS = {"metadata": 3e7, "numbers": 2e8}
"""Bytes of an array by its name: those of 6000 cycles of four states at the least tolerance, six times the longest
curve that the command line computes.  Reading takes three times as much memory, metadata made for that 25 times."""
FRAME = 1e4
"""Bytes around an array at most: names, checksums, its type and shape."""


def arrays(content: bytes, name: str, dtypes: Mapping[str, type]) -> dict[str, Array] | None:
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
