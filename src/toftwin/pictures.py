# SPDX-License-Identifier: Apache-2.0
"""Pictures of depth for reports: one look, inline PNG."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import NullFormatter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from toftwin.evaluate import PoseErrors

INK, PAPER, ACCENT = "#1c2733", "#ffffff", "#0b7285"
WAYS = ("#868e96", "#e8590c", "#7048e8", "#0b7285")
mpl.rcParams.update(
    {
        "font.size": 9,
        "axes.edgecolor": "#ced4da",
        "axes.labelcolor": INK,
        "text.color": INK,
        "xtick.color": "#495057",
        "ytick.color": "#495057",
        "axes.titlesize": 9.5,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "figure.facecolor": PAPER,
        "savefig.facecolor": PAPER,
    }
)


def data_uri(figure: Figure, dpi: int = 110) -> str:
    """A figure as an inline PNG; the figure is closed."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi, bbox_inches="tight", pad_inches=0.06)
    plt.close(figure)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()


def panels(images: Sequence[tuple[str, NDArray[Any], str]], *, columns: int, span_mm: float = 10.0, width: float = 11.0) -> str:
    """Images side by side: (title, array, kind); kind `depth` in metres, `error` in metres shown as ±span_mm, `part` ids, `grey`.

    Depth images share one scale, so that they can be compared.
    """
    rows = -(-len(images) // columns)
    ratio = images[0][1].shape[0] / images[0][1].shape[1]
    figure, axes = plt.subplots(
        rows, columns, figsize=(width, rows * (0.93 * width / columns * ratio + 0.3)), squeeze=False, layout="constrained"
    )
    depths = np.concatenate([a[np.isfinite(a)].ravel() for _, a, kind in images if kind == "depth"] or [np.zeros(1)])
    low, high = np.percentile(depths, [1, 99]) if depths.size else (0.0, 1.0)
    for ax in axes.flat:
        ax.axis("off")
    shown: dict[str, tuple[set[int], Any]] = {}
    for i, (ax, (title, array, kind)) in enumerate(zip(axes.flat, images, strict=False)):
        ax.set_title(title, loc="left")
        drawn = _show(ax, array, kind, (float(low), float(high)), span_mm)
        shown[kind] = (shown.get(kind, (set(), None))[0] | {i // columns}, drawn)
    for kind, label in (("depth", "m along the optical axis"), ("error", "mm, positive: too far")):
        if kind in shown:
            in_rows, drawn = shown[kind]
            bar: Any = figure.colorbar(drawn, ax=axes[sorted(in_rows)].ravel().tolist(), shrink=0.8, pad=0.012, aspect=18 * len(in_rows))
            bar.set_label(label)
            bar.outline.set_visible(False)
    return data_uri(figure)


def _show(ax: Any, array: NDArray[Any], kind: str, depth: tuple[float, float], span_mm: float) -> Any:
    ax.set_facecolor("#f1f3f5")
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
    figure, axes = plt.subplots(1, 2, figsize=(11, 2.9), layout="constrained")
    for ax, unit, values in zip(axes, ("mm", "degrees"), ([p.millimetres for p in poses], [p.degrees for p in poses]), strict=True):
        for row, (errors, colour) in enumerate(zip(values, WAYS, strict=False)):
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
        ax.grid(axis="x", color="#e9ecef", lw=0.8)
        ax.set_axisbelow(True)
    return data_uri(figure)


def error_histogram(errors_mm: Sequence[tuple[str, NDArray[Any]]], span: float = 20.0) -> str:
    """Distribution of depth errors."""
    figure, ax = plt.subplots(figsize=(5.4, 2.9), layout="constrained")
    for (name, values), colour in zip(errors_mm, ("#adb5bd", ACCENT), strict=False):
        ax.hist(
            values, bins=np.linspace(-span, span, 121).tolist(), density=True, histtype="stepfilled", alpha=0.55, color=colour, label=name
        )
    ax.set_xlabel("depth error against the truth, mm")
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.legend(frameon=False)
    return data_uri(figure)


def bars(counts: Sequence[tuple[str, float]], xlabel: str) -> str:
    """Horizontal bars, largest first."""
    rows = sorted(counts, key=lambda c: c[1])
    figure, ax = plt.subplots(figsize=(5.4, 2.9), layout="constrained")
    ax.barh([name for name, _ in rows], [value for _, value in rows], color=ACCENT, height=0.62)
    for i, (_, value) in enumerate(rows):
        ax.text(value, i, f" {value:.2f} %", va="center", fontsize=8.5)
    ax.set_xlabel(xlabel)
    ax.spines["left"].set_visible(False)
    ax.tick_params(left=False)
    ax.margins(x=0.15)
    return data_uri(figure)
