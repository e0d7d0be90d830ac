# SPDX-License-Identifier: Apache-2.0
"""PNG, zstd and .npz from outside: what is whole is read as it was written, what is not is one line."""

from __future__ import annotations

import struct
import zipfile
import zlib
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from backports import zstd

from tof_core import npz
from tof_core.bounds import LARGEST_RASTER
from tof_core.errors import BagError, DatasetError, DecodeError
from tof_core.npz import read_npz
from tof_core.png import check_raster, decode_png, png_size
from tof_core.unpack import unzstd

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

RNG = np.random.default_rng(3)


def png(raster: NDArray[Any]) -> bytes:
    return bytes(cv2.imencode(".png", raster)[1].tobytes())


@pytest.mark.parametrize(("shape", "kind"), [((5, 7), np.uint16), ((5, 7), np.uint8), ((5, 7, 3), np.uint8), ((5, 7, 4), np.uint16)])
def test_a_png_is_decoded_as_it_was_written(shape: tuple[int, ...], kind: type[np.uint8 | np.uint16]) -> None:
    raster = RNG.integers(0, np.iinfo(kind).max, shape).astype(kind)
    decoded = decode_png(png(raster))
    assert decoded.dtype == kind
    np.testing.assert_array_equal(decoded, raster)
    assert png_size(png(raster)) == (7, 5)


def test_a_png_of_the_wrong_size_or_cut_off_is_refused() -> None:
    data = png(np.ones((40, 50), np.uint16))
    for damaged, says in (
        (b"", "is no PNG"),
        (b"\xff\xd8" + data[2:], "is no PNG"),
        (data[:40], "damaged PNG"),
        (data[:16] + struct.pack(">II", 60_000, 60_000) + data[24:], "has 60000x60000 pixels"),
        (data[:16] + struct.pack(">II", 0, 5) + data[24:], "has 0x5 pixels"),
    ):
        with pytest.raises(DecodeError, match=says):
            decode_png(damaged, "topic")


def test_a_png_whose_chunk_states_a_gigabyte_is_refused_before_it_is_read() -> None:
    data = png(np.ones((4, 5), np.uint16))
    at = data.index(b"IDAT") - 4
    for damaged, says in (
        (data[:at] + struct.pack(">I", 2**30) + data[at + 4 :], "a chunk of 1073741824 bytes ends beyond"),
        (data[: at + 6], "within a chunk's header"),
        (data[:-12], "without an end"),
    ):
        with pytest.raises(DecodeError, match=says):
            decode_png(damaged)
    np.testing.assert_array_equal(decode_png(data + b"trailing"), 1)


def test_a_png_whose_pixels_are_damaged_is_refused() -> None:
    """The header says 7 pixels more a row than were packed, and its checksum fits: the decoder gives up, or another size comes out."""
    data = png(np.ones((4, 5), np.uint16))
    head = data[12:16] + struct.pack(">I", 12) + data[20:29]
    with pytest.raises(DecodeError, match="damaged PNG"):
        decode_png(data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:])


def test_the_limit_of_a_raster_is_exact() -> None:
    check_raster(LARGEST_RASTER, 1)
    for width, height in ((LARGEST_RASTER + 1, 1), (0, 1), (-1, 5)):
        with pytest.raises(DecodeError):
            check_raster(width, height)


def test_zstd_is_unpacked_up_to_its_limit() -> None:
    data = zstd.compress(b"abc" * 1000)
    assert unzstd(data, 3000) == b"abc" * 1000
    for damaged, most, says in ((data, 2999, "more than 2999 bytes"), (data[:-3], 5000, "cut off"), (b"abcdef", 10, "damaged zstd")):
        with pytest.raises(BagError, match=says):
            unzstd(damaged, most)


def test_arrays_are_read_by_name(tmp_path: Path) -> None:
    stored = {"a": RNG.normal(size=(3, 4)), "b": np.asfortranarray(RNG.integers(0, 9, (2, 5))), "c": np.zeros((0, 3)), "d": np.array(4.0)}
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "x.npz", **stored)  # type: ignore[arg-type]
        read = read_npz(tmp_path / "x.npz")
        assert read.keys() == stored.keys()
        for name, array in stored.items():
            np.testing.assert_array_equal(read[name], array)
        assert read_npz(tmp_path / "x.npz", ("a", "none")).keys() == {"a"}


def test_arrays_that_are_damaged_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", a=np.zeros(1000))
    data = (tmp_path / "x.npz").read_bytes()
    for damaged in (
        b"",
        data[:500],
        data.replace(b"(1000,)", b"(-100,)"),
        data.replace(b"(1000,)", b"(9999,)"),
        data.replace(b"<f8", b"|O8"),
    ):
        (tmp_path / "y.npz").write_bytes(damaged)
        with pytest.raises(DatasetError):
            read_npz(tmp_path / "y.npz")
    with pytest.raises(FileNotFoundError):
        read_npz(tmp_path / "none.npz")


def stated(folder: Path, *shapes: tuple[int, ...]) -> Path:
    """An .npz file of arrays of ten bytes each, whose headers state these shapes."""
    with zipfile.ZipFile(folder / "stated.npz", "w") as archive:
        for number, shape in enumerate(shapes):
            text = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}}}\n".encode()
            archive.writestr(f"a{number}.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(range(10)))
    return folder / "stated.npz"


def test_a_header_states_the_size_that_its_array_has(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_npz(stated(tmp_path, (2, 5)))["a0"], np.arange(10).reshape(2, 5))
    for shape, size in (((9,), 9), ((11,), 11), ((-2, -5), 10), ((2, -5, -1), 10)):
        with pytest.raises(DatasetError, match=f"array a0 has not the {size} bytes"):
            read_npz(stated(tmp_path, shape))


def test_all_arrays_together_have_a_limit_which_is_that_of_the_file_where_that_is_larger(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = stated(tmp_path, (10,), (10,))
    monkeypatch.setattr(npz, "LARGEST_ARRAYS", 0)
    assert len(read_npz(path)) == 2, "twenty bytes in a file of some hundred"
    np.savez_compressed(path, a=np.zeros(1000, np.uint8), b=np.zeros(1000, np.uint8))
    for most, names, reads in ((1999, (), False), (2000, (), True), (1999, ("b",), True)):
        monkeypatch.setattr(npz, "LARGEST_ARRAYS", most)
        if reads:
            assert sum(a.nbytes for a in read_npz(path, names).values()) <= most
        else:
            with pytest.raises(DatasetError, match="arrays of more than 1999 bytes"):
                read_npz(path, names)
