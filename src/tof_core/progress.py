# SPDX-License-Identifier: Apache-2.0
"""Progress of long work on stderr; silent where nobody watches."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

T = TypeVar("T")
_quiet = False


def set_quiet(quiet: bool = True) -> None:  # noqa: FBT001, FBT002 (a switch and nothing else)
    """Show no progress from now on (`--quiet`)."""
    global _quiet  # noqa: PLW0603 (one process, one terminal)
    _quiet = quiet


def progress(iterable: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Pass `iterable` on, with a bar named `what` on stderr where that is a terminal."""
    if _quiet or not sys.stderr.isatty():
        yield from iterable
        return
    from tqdm import tqdm

    yield from tqdm(iterable, desc=what, total=total, leave=False, dynamic_ncols=True, file=sys.stderr)
