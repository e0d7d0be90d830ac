# SPDX-License-Identifier: Apache-2.0
"""Presence of parts over more than 3000 part views, with builds of their own.

`TOFTWIN_KEEP=FOLDER` keeps what is done, so that a run that was cut goes on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.bench_inspect import figures
from benchmarks.part_views import part_views

if TYPE_CHECKING:
    from benchmarks.figure import Figure
    from benchmarks.part_views import PartView

LONG = True
BUILDS = range(400, 430)
"""Looked into by nobody before their figures; 100 to 124 were."""


def views() -> list[PartView]:
    """Every second build with first pictures in colour, every tenth at 400 x 300."""
    return [v for build in BUILDS for v in part_views(build, 5, colour=build % 2 == 0, wide=build % 10 == 5)]


def run() -> list[Figure]:
    """The same bars as the short bench."""
    return [replace(figure, what=f"long: {figure.what}") for figure in figures(views())]
