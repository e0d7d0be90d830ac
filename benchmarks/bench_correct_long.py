# SPDX-License-Identifier: Apache-2.0
"""Back to the first picture from 200 starts near and 200 far: the issue's own counts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.bench_correct import FAR, NEAR, far_figures, near_figures, returns

if TYPE_CHECKING:
    from benchmarks.figure import Figure


def run() -> list[Figure]:
    """The same bars as the short bench."""
    found = [*near_figures(returns(*NEAR, 200)), *far_figures(returns(*FAR, 200))]
    return [replace(figure, what=f"200 starts: {figure.what}") for figure in found]
