# SPDX-License-Identifier: Apache-2.0
"""Is every part there, over more than 3000 judged part views: the issue's own count."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.bench_inspect import figures, judged
from tof_scene.builtin import builtin_names

if TYPE_CHECKING:
    from benchmarks.figure import Figure


def run() -> list[Figure]:
    """The same bars as the short bench."""
    found = figures([j for name in builtin_names() for build in range(25) for j in judged(name, build, 8)])
    return [replace(figure, what=f"long: {figure.what}") for figure in found]
