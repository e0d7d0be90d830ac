# SPDX-License-Identifier: Apache-2.0
"""Plots of depth and pose errors for reports, as embedded PNG images."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import NullFormatter

from tof_core.page import PALETTE, axes, figure_uri

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_eval.sessions import PoseErrors

WAYS = ("neutral", "contrast", "third", "accent")


def pose_plot(poses: Sequence[PoseErrors]) -> str:
    """Pose error of every view by estimate, on logarithmic axes; the line is the median."""
    figure, plots = axes(11, 2.9, columns=2)
    for ax, unit, values in zip(plots[0], ("mm", "degrees"), ([p.millimetres for p in poses], [p.degrees for p in poses]), strict=True):
        for row, (errors, name) in enumerate(zip(values, WAYS, strict=False)):
            colour = PALETTE[name]
            y = row + np.linspace(-0.18, 0.18, len(errors))
            ax.scatter(np.maximum(errors, 1e-4), y, s=16, color=colour, alpha=0.75, linewidths=0)
            ax.plot([np.median(errors)] * 2, [row - 0.32, row + 0.32], color=colour, lw=2)
            ax.text(np.median(errors), row - 0.36, f"{np.median(errors):.2g}", ha="center", va="bottom", color=colour, fontsize=8.5)
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
        ax.xaxis.set_minor_formatter(NullFormatter())  # by default it labels every grid line within two decades
        ax.set_yticks(range(len(poses)), [p.name for p in poses])
        ax.set_ylim(len(poses) - 0.5, -0.75)
        ax.set_xlabel(f"distance from the true pose, {unit}")
        ax.grid(axis="x", lw=0.8)
    return figure_uri(figure)


def error_histogram(
    errors_mm: Sequence[tuple[str, NDArray[Any]]],
    span: float = 20.0,
    xlabel: str = "depth error against the truth, mm",
    band_mm: float = 0.0,
) -> str:
    """Distribution of depth errors; `band_mm`: standard deviation of the noise, shown as a band about zero.

    Bins of 1 mm: depth comes in whole millimetres, and narrower bins would show a comb.
    """
    figure, ((ax,),) = axes(5.4, 2.9)
    if band_mm > 0:
        ax.axvspan(-band_mm, band_mm, color=PALETTE["line"], lw=0, label=f"noise, ±{band_mm:.1f} mm")
    for (name, values), colour in zip(errors_mm, (PALETTE["neutral"], PALETTE["accent"]), strict=False):
        ax.hist(
            values,
            bins=np.arange(-span - 0.5, span + 1.0).tolist(),
            density=True,
            histtype="stepfilled",
            alpha=0.55,
            color=colour,
            label=name,
        )
    ax.set_xlabel(xlabel)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.legend(frameon=False)
    return figure_uri(figure)


def bars(counts: Sequence[tuple[str, float]], xlabel: str) -> str:
    """Horizontal bars, largest first."""
    rows = sorted(counts, key=lambda c: c[1])
    figure, ((ax,),) = axes(5.4, 2.9)
    ax.barh([name for name, _ in rows], [value for _, value in rows], color=PALETTE["accent"], height=0.62)
    for i, (_, value) in enumerate(rows):
        ax.text(value, i, f" {value:.2f} %", va="center", fontsize=8.5)
    ax.set_xlabel(xlabel)
    ax.spines["left"].set_visible(False)
    ax.tick_params(left=False)
    ax.margins(x=0.15)
    return figure_uri(figure)
