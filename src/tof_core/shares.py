# SPDX-License-Identifier: Apache-2.0
"""Shares in words."""

from __future__ import annotations

WHOLE = 0.01
"""Share from which per cent are stated without a decimal."""
LEAST = 0.001
"""Smallest share that is stated as a number."""


def in_percent(share: float, decimals: int | None = None) -> str:
    """A share in per cent, with one decimal where it is small; "0 %" stands for 0 and for negative rounding errors of sums.

    Args:
        share: 1 is all.
        decimals: decimals of every share, for columns of a table and for shares near 1.
    """
    if decimals is not None:
        return f"{100 * share:.{decimals}f} %"
    if abs(share) < LEAST:
        return f"under {100 * LEAST:.1f} %" if share > 0.0 else "0 %"
    return f"{100 * share:.{1 if abs(share) < WHOLE else 0}f} %"
