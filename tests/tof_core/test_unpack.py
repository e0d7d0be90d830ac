# SPDX-License-Identifier: Apache-2.0
"""Chunks of a bag: unpacked to the size that their header states and not a byte further."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import pytest
from backports import zstd

from tof_core import unpack as room
from tof_core.bounds import LARGEST_CHUNK
from tof_core.errors import BagError
from tof_core.unpack import UNPACKERS, BoundedZstd, unpack, unzstd

if TYPE_CHECKING:
    from pathlib import Path

CONTENT = bytes(range(256)) * 40


def packed(compression: str) -> bytes:
    if compression == "lz4":
        return bytes(pytest.importorskip("lz4.frame").compress(CONTENT))
    return zstd.compress(CONTENT) if compression == "zstd" else CONTENT


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_a_chunk_is_what_was_packed(compression: str) -> None:
    assert unpack(packed(compression), compression, len(CONTENT)) == CONTENT
    assert UNPACKERS[compression](packed(compression), len(CONTENT)) == CONTENT


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_a_chunk_one_byte_larger_than_it_says_is_refused(compression: str) -> None:
    with pytest.raises(BagError, match=f"larger than the {len(CONTENT) - 1} bytes that its header states"):
        unpack(packed(compression), compression, len(CONTENT) - 1)


def test_a_chunk_that_states_too_large_a_size_is_refused_before_it_is_unpacked() -> None:
    unpack(b"", "", LARGEST_CHUNK)
    with pytest.raises(BagError, match=f"a chunk of {LARGEST_CHUNK + 1} bytes"):
        unpack(b"", "", LARGEST_CHUNK + 1)


def test_another_compression_is_named() -> None:
    with pytest.raises(BagError, match="packed with 'brotli'"):
        unpack(b"", "brotli", 5)


def test_a_message_of_the_largest_size_is_read_and_one_byte_more_is_not() -> None:
    assert unzstd(zstd.compress(CONTENT), len(CONTENT)) == CONTENT
    assert BoundedZstd.decompress(zstd.compress(CONTENT)) == CONTENT
    with pytest.raises(BagError, match="more than"):
        unzstd(zstd.compress(CONTENT), len(CONTENT) - 1)


@pytest.mark.parametrize(
    ("storage", "ratio", "reads"), [(1, 1, False), (2 * len(CONTENT), 0, True), (2 * len(CONTENT) - 1, 0, False), (0, 10_000, True)]
)
def test_storage_files_are_unpacked_together_up_to_the_limit_or_to_a_multiple_of_their_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, storage: int, ratio: int, *, reads: bool
) -> None:
    """Two files of the same content: the limit counts both."""
    monkeypatch.setattr(room, "LARGEST_STORAGE", storage)
    monkeypatch.setattr(room, "LARGEST_RATIO", ratio)
    (tmp_path / "a").write_bytes(packed("zstd"))
    bounded = BoundedZstd()

    def read() -> bytes:
        with (tmp_path / "a").open("rb") as file, bounded.open(file, "rb") as content:
            return io.BytesIO(content.read()).getvalue()

    if reads:
        assert read() + read() == CONTENT + CONTENT
    else:
        with pytest.raises(BagError, match="unpack to more than"):
            read() + read()
