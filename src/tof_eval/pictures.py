# SPDX-License-Identifier: Apache-2.0
"""Pictures of depth and poses for reports, as PNG images inside the page."""

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


def panels(images: Sequence[tuple[str, NDArray[Any], str]], *, columns: int, span_mm: float = 10.0, width: float = 11.0) -> str:
    """Images side by side: (title, array, kind); kind `depth` in metres, `error` in metres shown as ±span_mm, `part` ids, `grey`.

    Depth images share one scale, so that they can be compared.
    """
    rows = -(-len(images) // columns)
    ratio = images[0][1].shape[0] / images[0][1].shape[1]
    figure, plots = axes(width, rows * (0.93 * width / columns * ratio + 0.3), rows, columns)
    depths = np.concatenate([a[np.isfinite(a)].ravel() for _, a, kind in images if kind == "depth"] or [np.zeros(1)])
    low, high = np.percentile(depths, [1, 99]) if depths.size else (0.0, 1.0)
    for ax in plots.flat:
        ax.axis("off")
    shown: dict[str, tuple[set[int], Any]] = {}
    for i, (ax, (title, array, kind)) in enumerate(zip(plots.flat, images, strict=False)):
        ax.set_title(title, loc="left")
        drawn = _show(ax, array, kind, (float(low), float(high)), span_mm)
        shown[kind] = (shown.get(kind, (set(), None))[0] | {i // columns}, drawn)
    for kind, label in (("depth", "m along the optical axis"), ("error", "mm, positive: too far")):
        if kind in shown:
            in_rows, drawn = shown[kind]
            bar: Any = figure.colorbar(drawn, ax=plots[sorted(in_rows)].ravel().tolist(), shrink=0.8, pad=0.012, aspect=18 * len(in_rows))
            bar.set_label(label)
            bar.outline.set_visible(False)
    return figure_uri(figure)


def _show(ax: Any, array: NDArray[Any], kind: str, depth: tuple[float, float], span_mm: float) -> Any:
    ax.set_facecolor(PALETTE["wash"])
    ax.axis("on")
    ax.set_xticks([])
    ax.set_yticks([])
    if kind == "depth":
        return ax.imshow(array, cmap="viridis_r", vmin=depth[0], vmax=depth[1], interpolation="nearest")
    if kind == "error":
        return ax.imshow(array * 1e3, cmap="RdBu_r", vmin=-span_mm, vmax=span_mm, interpolation="nearest")
    if kind == "part":
        return ax.imshow(np.ma.masked_less(array, 0), cmap="tab20", vmin=0, vmax=19, interpolation="nearest")
    return ax.imshow(array, cmap="gray", interpolation="nearest")


def pose_plot(poses: Sequence[PoseErrors]) -> str:
    """Every view's pose error by way of posing, on logarithmic axes; the line is the median."""
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
        ax.xaxis.set_minor_formatter(NullFormatter())  # within two decades it would write every line's number
        ax.set_yticks(range(len(poses)), [p.name for p in poses])
        ax.set_ylim(len(poses) - 0.5, -0.75)
        ax.set_xlabel(f"distance from the true pose, {unit}")
        ax.grid(axis="x", lw=0.8)
    return figure_uri(figure)


def error_histogram(errors_mm: Sequence[tuple[str, NDArray[Any]]], span: float = 20.0) -> str:
    """Distribution of depth errors."""
    figure, ((ax,),) = axes(5.4, 2.9)
    for (name, values), colour in zip(errors_mm, (PALETTE["neutral"], PALETTE["accent"]), strict=False):
        ax.hist(
            values, bins=np.linspace(-span, span, 121).tolist(), density=True, histtype="stepfilled", alpha=0.55, color=colour, label=name
        )
    ax.set_xlabel("depth error against the truth, mm")
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
