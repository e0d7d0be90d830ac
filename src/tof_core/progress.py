# SPDX-License-Identifier: Apache-2.0
"""Progress of long work on stderr; silent where stderr is no terminal."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

T = TypeVar("T")
DELAY_S = 1.0
"""Seconds; shorter work shows no progress."""
_quiet = False


def set_quiet(quiet: bool = True) -> None:  # noqa: FBT001, FBT002 (a switch and nothing else)
    """Show no progress from now on (`--quiet`)."""
    global _quiet  # noqa: PLW0603 (one process, one terminal)
    _quiet = quiet


def progress(iterable: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Pass `iterable` on, with a bar named `what` on stderr where that is a terminal."""
    if _hidden():
        yield from iterable
        return
    yield from _bar(what, total, iterable)


@contextmanager
def steps(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A function to call with the name of each of `total` steps as the step begins; it moves a bar named `what`."""
    if _hidden():
        yield lambda _: None
        return
    with _bar(what, total) as bar:
        begun = False

        def begin(name: str) -> None:
            nonlocal begun
            bar.set_postfix_str(name, refresh=False)
            bar.update(int(begun))
            begun = True

        yield begin


def _hidden() -> bool:
    """Whether no bar is shown."""
    return _quiet or not sys.stderr.isatty()


def _bar(what: str, total: int | None, iterable: Iterable[T] | None = None) -> Any:
    """A bar with the share done and the remaining time."""
    from tqdm import tqdm

    return tqdm(iterable, desc=what, total=total, leave=False, dynamic_ncols=True, file=sys.stderr, delay=DELAY_S)
