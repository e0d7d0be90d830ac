# SPDX-License-Identifier: Apache-2.0
"""Arrays from an .npz file: the sizes in the headers are checked before any array is read."""

from __future__ import annotations

import zipfile
import zlib
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy

from tof_core.bounds import LARGEST_ARRAYS
from tof_core.errors import DatasetError

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from numpy.typing import NDArray

    Header = tuple[tuple[int, ...], bool, np.dtype[Any]]

_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_npz(path: Path, names: Collection[str] = ()) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file by name: all if `names` is empty, else the named ones that the file has.

    The arrays may hold `LARGEST_ARRAYS` bytes together, or as many as the file has on disk. Objects (pickles) are refused.

    Raises:
        FileNotFoundError: there is no such file.
        DatasetError: damaged, too large, or with arrays of Python objects.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = {m.filename.removesuffix(".npy"): m for m in archive.infolist()}
            wanted = {name: members[name] for name in (names or members) if name in members}
            _check_sizes(archive, wanted, path)
            return {name: _array(archive, member) for name, member in wanted.items()}
    except (FileNotFoundError, DatasetError):
        raise
    except (OSError, ValueError, EOFError, KeyError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error) as error:
        raise DatasetError(f"is no .npz file or damaged ({str(error) or type(error).__name__})", where=path) from None


def _check_sizes(archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo], path: Path) -> None:
    """Refuse headers that state more bytes than allowed, or another size than the array's."""
    allowed = max(LARGEST_ARRAYS, path.stat().st_size)
    total = 0
    for name, member in members.items():
        with archive.open(member) as file:
            shape, _, dtype = _header(file)
            stated = prod(shape) * dtype.itemsize
            if dtype.hasobject:
                raise DatasetError(f"array {name} holds Python objects", where=path, todo="arrays of numbers are read")
            if min(shape, default=0) < 0 or stated != member.file_size - file.tell():
                raise DatasetError(f"array {name} has not the {stated} bytes that its header states", where=path)
        total += stated
        if total > allowed:
            raise DatasetError(f"holds arrays of more than {allowed} bytes", where=path, todo="is the file damaged?")


def _header(file: Any) -> Header:
    version = npy.read_magic(file)
    if version not in _READERS:
        raise ValueError(f"array format {version}")
    header: Header = _READERS[version](file)
    return header


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(member) as file:
        return np.asarray(npy.read_array(file, allow_pickle=False))
