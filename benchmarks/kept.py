# SPDX-License-Identifier: Apache-2.0
"""Rows of a long bench as they come, so that a run that was cut goes on where it stopped.

Only where TOFTWIN_KEEP names a folder; rows say nothing of the code that made them, so take a fresh folder for other code.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

Rows = list[dict[str, Any]]


def kept(key: str, make: Callable[[], Rows]) -> Rows:
    """The rows of one unit of work: read where they were kept, made and kept otherwise."""
    folder = os.environ.get("TOFTWIN_KEEP")
    if not folder:
        return make()
    path = Path(folder) / f"{key}.json"
    if path.exists():
        return list(json.loads(path.read_text(encoding="utf-8")))
    rows = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(rows), encoding="utf-8")
    partial.replace(path)
    return rows
