# SPDX-License-Identifier: Apache-2.0
"""Corrective pose from 200 starts near and 102 far, with starts of their own.

`TOFTWIN_KEEP=FOLDER` keeps what is done, so that a run that was cut goes on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.bench_correct import FAR, NEAR, biased, far_figures, figure_11, near_figures
from benchmarks.stand import returns

if TYPE_CHECKING:
    from benchmarks.figure import Figure

LONG = True
SEED = 4409
"""Looked into by nobody before its figures; 3301 was."""


def run() -> list[Figure]:
    """The same bars as the short bench."""
    found = [
        *near_figures(returns(*NEAR, 200, seed=SEED, stands=24)),
        *far_figures(returns(*FAR, 102, seed=SEED, stands=17)),
        *far_figures(returns(*FAR, 18, seed=SEED, stands=9, cad=False), " without CAD"),
        biased(12, 6, SEED),
        *figure_11(2, SEED),
    ]
    return [replace(figure, what=f"long: {figure.what}") for figure in found]
