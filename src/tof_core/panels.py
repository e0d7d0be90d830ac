# SPDX-License-Identifier: Apache-2.0
"""Images of depth, depth errors and parts side by side, for reports, as an embedded PNG image."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.page import axes, figure_uri

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

NO_DEPTH = "#ced4da"
"""Grey of pixels without a value; white is an error of zero."""


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
    for kind, label in (("depth", "m along the optical axis"), ("error", "mm, + is farther")):
        if kind in shown:
            in_rows, drawn = shown[kind]
            bar: Any = figure.colorbar(drawn, ax=plots[sorted(in_rows)].ravel().tolist(), shrink=0.8, pad=0.012, aspect=18 * len(in_rows))
            bar.set_label(label)
            bar.outline.set_visible(False)
    return figure_uri(figure)


def _show(ax: Any, array: NDArray[Any], kind: str, depth: tuple[float, float], span_mm: float) -> Any:
    ax.set_facecolor(NO_DEPTH)
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
