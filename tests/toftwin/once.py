# SPDX-License-Identifier: Apache-2.0
"""What several calls of a test compute alike, computed once: a diagnosis takes most of a test's time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


def once(work: Callable[..., Any]) -> Callable[..., Any]:
    """The function, computed at the first call only; later calls get that result, whatever their arguments are."""
    made: list[Any] = []

    def remembered(*args: Any, **how: Any) -> Any:
        if not made:
            made.append(work(*args, **how))
        return made[0]

    return remembered
