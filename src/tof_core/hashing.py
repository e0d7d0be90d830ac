# SPDX-License-Identifier: Apache-2.0
"""Digests that identify the CAD, configuration and arrays from which a result was made."""

from __future__ import annotations

import hashlib
import json
from dataclasses import is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.config import to_mapping

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

DIGITS = 16
"""Hexadecimal digits of every digest: 64 bits distinguish all results that one user will make."""


def digest_bytes(*parts: bytes | memoryview) -> str:
    """Digest of byte strings; the boundaries between them count."""
    h = hashlib.blake2b(digest_size=DIGITS // 2)
    for part in parts:
        h.update(len(part).to_bytes(8, "little"))
        h.update(part)
    return h.hexdigest()


def digest_arrays(*arrays: NDArray[Any]) -> str:
    """Digest of arrays: type, shape and content."""
    parts: list[bytes] = []
    for a in arrays:
        parts += [f"{a.dtype.str}{a.shape}".encode(), np.ascontiguousarray(a).tobytes()]
    return digest_bytes(*parts)


def digest_file(path: Path) -> str:
    """Digest of a file's content."""
    h = hashlib.blake2b(digest_size=DIGITS // 2)
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            h.update(block)
    return h.hexdigest()


def digest_config(config: object) -> str:
    """Digest of a configuration dataclass, or of plain values as JSON holds them; key order does not count."""
    values = to_mapping(config) if is_dataclass(config) else config
    return digest_bytes(json.dumps(values, sort_keys=True, default=str).encode())
