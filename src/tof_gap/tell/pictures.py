# SPDX-License-Identifier: Apache-2.0
"""The report's pictures as inline images: where the gap lies, and how far it shrinks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.page import PALETTE, axes, figure_uri
from tof_sensor.geometry import cell_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_gap.tell.where import Bin

INK, PALE, BEFORE, AFTER = PALETTE["ink"], PALETTE["neutral"], PALETTE["contrast"], PALETTE["accent"]


def on_the_cad(d: Diagnosis, left: Sequence[Float]) -> str:
    """The parts seen in the session, coloured by mean gap before and after, from the middle view's side."""
    limit = _limit(d)
    figure, grid = axes(11, 4.6, columns=2)
    points: Any = None
    for ax, maps, title in zip(grid[0], (d.residual, left), ("before", "after adding what was named"), strict=True):
        xy, value = _projected(d, maps)
        points = ax.scatter(xy[:, 0], xy[:, 1], c=value, s=7, marker="s", cmap="RdBu_r", vmin=-limit, vmax=limit, linewidths=0)
        ax.set_aspect("equal")
        ax.axis("off")
        ax.set_title(title, color=INK, fontsize=11)
    figure.colorbar(points, ax=list(grid[0]), label="measured minus simulated, mm", shrink=0.8)
    return figure_uri(figure)


def _limit(d: Diagnosis) -> float:
    every = np.concatenate([np.abs(r[np.isfinite(r)]) for r in d.residual])
    return float(max(1e3 * np.quantile(every, 0.95), 1.0))


def _projected(d: Diagnosis, maps: Sequence[Float], cell_m: float = 0.012) -> tuple[Float, Float]:
    """(n, 2) screen positions and (n,) mean gap in mm of small cubes of space, nearest last."""
    points = np.concatenate([cell_points(v.frame)[np.isfinite(m)] for v, m in zip(d.evidence, maps, strict=True)])
    gap = np.concatenate([m[np.isfinite(m)] for m in maps])
    cube = np.floor(points / cell_m).astype(np.int64)
    size = np.ptp(cube, axis=0) + 1
    # One number a cube: sorting rows is twenty times slower.
    _, first, which = np.unique(np.ravel_multi_index((cube - cube.min(axis=0)).T, size), return_index=True, return_inverse=True)
    key = cube[first]
    mean = 1e3 * np.bincount(which, gap) / np.bincount(which)
    T = d.evidence[len(d.evidence) // 2].rendering.T_cell_camera
    local = ((key + 0.5) * cell_m - T[:3, 3]) @ T[:3, :3]
    order = np.argsort(-local[:, 2])
    return np.stack([local[order, 0], -local[order, 1]], axis=1), mean[order]


def how_far(d: Diagnosis) -> str:
    """Bars of the gap above the noise: before, after, and with each named effect alone; the noise as a band of its own."""
    gap = d.gap
    rows = [("gap before", gap.above_mm(gap.before), BEFORE), ("gap after", gap.above_mm(gap.after), AFTER)]
    rows += [(f"only {c.named.name.replace('_', ' ')}", gap.above_mm(c.alone.after), PALE) for c in d.causes]
    figure, ((ax,),) = axes(6.2, 0.45 * len(rows) + 1.0)
    ax.axvspan(0.0, gap.floor_mm, color=PALETTE["wash"], zorder=0)
    ax.axvline(gap.floor_mm, color=PALE, linestyle="--", linewidth=1, zorder=1)
    ax.barh([r[0] for r in rows], [r[1] for r in rows], color=[r[2] for r in rows], height=0.6, zorder=2)
    for i, (_, value, _) in enumerate(rows):
        ax.text(value, i, f" {value:.2f}", va="center", color=INK, fontsize=9)
    ax.text(gap.floor_mm, -0.72, f"noise {gap.floor_mm:.2f}", ha="center", color=INK, fontsize=8)
    ax.invert_yaxis()
    ax.set_xlabel("RMS above the noise on held-out views, mm")
    return figure_uri(figure)


def views(d: Diagnosis, left: Sequence[Float], most: int = 4) -> str:
    """Residual maps of a few views, before above, after below."""
    chosen = np.unique(np.linspace(0, len(d.residual) - 1, min(most, len(d.residual))).round().astype(int))
    limit = _limit(d)
    figure, grid = axes(11, 4.4, 2, len(chosen))
    for column, v in enumerate(chosen):
        for row, maps in enumerate((d.residual, left)):
            ax = grid[row][column]
            ax.imshow(1e3 * maps[v], cmap="RdBu_r", vmin=-limit, vmax=limit)
            ax.set_xticks([])
            ax.set_yticks([])
        grid[0][column].set_title(f"view {v}", fontsize=9, color=INK)
    grid[0][0].set_ylabel("before")
    grid[1][0].set_ylabel("after")
    return figure_uri(figure)


LABELS = {
    "range_m": "range, m",
    "incidence_deg": "incidence, deg",
    "amplitude": "amplitude",
    "edge_px": "distance to an edge, px",
    "time_s": "time, s",
    "temperature_c": "temperature, °C",
    "concavity": "concavity",
    "column": "column",
    "row": "row",
    "speed_m_s": "speed, m/s",
}


def by_quantity(bins: dict[str, list[Bin]]) -> str:
    """Mean gap against each quantity."""
    known = [(k, b) for k, b in bins.items() if len(b) >= 2]
    columns = 4
    rows = max(1, -(-len(known) // columns))
    figure, grid = axes(11, 2.2 * rows, rows, columns)
    for ax in grid.ravel()[len(known) :]:
        ax.axis("off")
    for ax, (name, b) in zip(grid.ravel(), known, strict=False):
        middle = [0.5 * (x.low + x.high) for x in b]
        ax.axhline(0, color=PALE, linewidth=0.8)
        ax.plot(middle, [x.bias_mm for x in b], color=BEFORE, marker="o", markersize=3, linewidth=1.2)
        ax.set_xlabel(LABELS.get(name, name), fontsize=8)
        ax.tick_params(labelsize=7)
    grid[0][0].set_ylabel("mean gap, mm", fontsize=8)
    return figure_uri(figure)
