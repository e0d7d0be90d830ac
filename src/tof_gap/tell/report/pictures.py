# SPDX-License-Identifier: Apache-2.0
"""The report's pictures as inline images: where the gap lies, and how far it shrinks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.page import PALETTE, axes, figure_uri
from tof_gap.seen.evidence.residual import single
from tof_gap.tell.report.words import most_pixels
from tof_sensor.geometry import cell_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_gap.tell.figures.where import Bin

INK, PALE, BEFORE, AFTER = PALETTE["ink"], PALETTE["neutral"], PALETTE["contrast"], PALETTE["accent"]


TICKS = 4
"""Most intervals between ticks of a small plot."""
NAMED = 9
"""Parts whose names stand on the map: those with most of its pixels."""
GAP_COLOURS = "RdBu_r"
NOT_COMPARED = "#cfd4d9"
SMOOTH_PX = 5
"""Side of the square whose mean a view's map shows."""
CUBES = 130
"""Cubes of space along the diagonal of the measured volume: as fine as the map shows, with some pixels in each."""
PIXELS = 2_000_000
"""Pixels of all views that fill these cubes: a hundred and more in each."""
SURE = 2.0
"""Standard errors from which the mean gap of a cube of space, or of a square of a view, has its full colour. Below, a cube is white and a square paler."""


def on_the_cad(d: Diagnosis, left: Sequence[Float], names: Sequence[str]) -> str:
    """The parts as the middle view sees them, coloured by mean gap: before and, where effects are known, after."""
    simulated = f"once the {'suspected' if d.doubted else 'named'} effects are simulated"
    panels = [(d.residual, "before"), (left, simulated)] if d.shares else [(d.residual, "")]
    shown = [(*_projected(d, maps), title) for maps, title in panels]
    limit = max(1.0, 2.5 * d.gap.shown_mm[0], 0.5 * d.gap.floor_mm)  # Single far cubes, or those at edges, do not set the scale.
    figure, grid = axes(5.5 * len(shown), 4.8, columns=len(shown))
    points: Any = None
    for ax, (xy, value, part, title) in zip(grid[0], shown, strict=True):
        points = ax.scatter(xy[:, 0], xy[:, 1], c=value, s=11, marker="s", cmap=GAP_COLOURS, vmin=-limit, vmax=limit, linewidths=0)
        _name_parts(ax, xy, part, names)
        ax.set_aspect("equal")
        ax.axis("off")
        ax.set_title(title, color=INK, fontsize=11)
    figure.colorbar(points, ax=list(grid[0]), label="measured minus simulated, mm", shrink=0.8)
    return figure_uri(figure)


def _name_parts(ax: Any, xy: Float, part: Ints, names: Sequence[str]) -> None:
    """Write the names of the parts with most points at their middle, where no other name stands."""
    counts = np.bincount(part[part >= 0], minlength=len(names))
    taken: list[Float] = []
    apart = np.ptp(xy, axis=0) * (0.16, 0.06)
    for index in np.argsort(-counts, kind="stable"):
        if len(taken) == NAMED or not counts[index] or index >= len(names):
            break
        middle = np.median(xy[part == index], axis=0)
        if all((np.abs(middle - other) > apart).any() for other in taken):
            taken.append(middle)
            box = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.8}
            ax.text(*middle, names[index], fontsize=7.5, color=INK, ha="center", va="center", bbox=box)


def _projected(d: Diagnosis, maps: Sequence[Float]) -> tuple[Float, Float, Ints]:
    """Of small cubes of space, nearest last: (n, 2) screen positions, (n,) mean gap in mm (0 where not significant), (n,) part."""
    step = max(1, sum(int(np.isfinite(m).sum()) for m in maps) // PIXELS)
    shown = [np.flatnonzero(np.isfinite(m))[::step].copy() for m in maps]  # a slice would keep the indices of all pixels
    points = np.concatenate([single(cell_points(v.frame).reshape(-1, 3)[at]) for v, at in zip(d.evidence, shown, strict=True)])
    gap = np.concatenate([m.ravel()[at] for m, at in zip(maps, shown, strict=True)])
    cell_m = float(np.linalg.norm(np.ptp(np.quantile(points, (0.02, 0.98), axis=0), axis=0))) / CUBES
    cube = np.floor(points / cell_m).astype(np.int64)
    del points
    size = np.ptp(cube, axis=0) + 1
    # One number for each cube: sorting rows is twenty times slower.
    _, first, which = np.unique(np.ravel_multi_index((cube - cube.min(axis=0)).T, size), return_index=True, return_inverse=True)
    key = cube[first]
    count = np.bincount(which)
    mean = np.bincount(which, gap) / count
    noise2 = np.concatenate([np.broadcast_to(f, m.shape).ravel()[at] for f, m, at in zip(d.floor2, maps, shown, strict=True)])
    mean = 1e3 * np.where(np.abs(mean) > SURE * np.sqrt(np.bincount(which, noise2)) / count, mean, 0.0)
    part = np.concatenate([v.rendering.part.ravel()[at] for v, at in zip(d.evidence, shown, strict=True)])[first]
    T = d.evidence[len(d.evidence) // 2].rendering.T_cell_camera
    local = ((key + 0.5) * cell_m - T[:3, 3]) @ T[:3, :3]
    order = np.argsort(-local[:, 2], kind="stable")
    return np.stack([local[order, 0], -local[order, 1]], axis=1), mean[order], part[order]


def how_far(d: Diagnosis) -> str:
    """Bars of the gap above the noise: before, after, and with each named effect alone; the noise as a band of its own.

    Where edges or wrapped pixels count, the gap without them: these are few, and would hide everything else.
    """
    gap = d.gap
    rows = [(f"gap {when}", mm, colour) for when, mm, colour in zip(("before", "after"), gap.shown_mm, (BEFORE, AFTER), strict=True)]
    rows += [(f"only {c.named.name.replace('_', ' ')}", c.alone.shown_mm[1], PALE) for c in d.causes]
    figure, ((ax,),) = axes(6.2, 0.45 * len(rows) + 0.5, gaps_in=(0.0, 0.0))
    ax.axvspan(0.0, gap.floor_mm, color=PALETTE["wash"], zorder=0)
    ax.axvline(gap.floor_mm, color=PALE, linestyle="--", linewidth=1, zorder=1)
    ax.barh([r[0] for r in rows], [r[1] for r in rows], color=[r[2] for r in rows], height=0.6, zorder=2)
    for i, (_, value, _) in enumerate(rows):
        ax.text(value, i, f" {value:.2f}", va="center", color=INK, fontsize=9)
    ax.text(gap.floor_mm, -0.72, f"noise {gap.floor_mm:.2f}", ha="center", color=INK, fontsize=8)
    ax.invert_yaxis()
    where = "" if gap.off_edges_mm is None else f", {most_pixels(d.verdict)}"
    ax.set_xlabel(f"RMS above the noise on held-out views{where}, mm")
    return figure_uri(figure)


def views(d: Diagnosis, left: Sequence[Float], most: int = 4) -> str:
    """Some views: amplitude for orientation, the gap before and after as means of neighbouring pixels; grey where nothing is compared."""
    chosen = np.unique(np.linspace(0, len(d.residual) - 1, min(most, len(d.residual))).round().astype(int))
    gaps = [[_smooth(maps[v], d.floor2[v]) for v in chosen] for maps in (d.residual, left)]
    limit = max(1.0, float(np.nanquantile(np.abs(np.concatenate([g.ravel() for g, _ in gaps[0]])), 0.98)))
    figure, grid = axes(11, 6.4, 3, len(chosen))
    image: Any = None
    for column, v in enumerate(chosen):
        light = np.sqrt(np.maximum(np.nan_to_num(d.evidence[v].frame.amplitude), 0.0))
        grid[0][column].imshow(light, cmap="gray", vmax=np.percentile(light, 99))
        for row in (1, 2):
            image = _gap_image(grid[row][column], *gaps[row - 1][column], limit)
        for row in range(3):
            grid[row][column].set_xticks([])
            grid[row][column].set_yticks([])
        grid[0][column].set_title(f"view {v + 1}", fontsize=9, color=INK)
    for row, label in enumerate(("amplitude", "gap before", "gap after")):
        grid[row][0].set_ylabel(label)
    figure.colorbar(image, ax=list(grid[1:].ravel()), label="measured minus simulated, mm", shrink=0.8)
    return figure_uri(figure)


def _gap_image(ax: Any, gap_mm: Float, noise_mm: Float, limit: float) -> Any:
    """A map whose colours are pale where noise is large: white without a gap, full colour from `SURE` standard errors on."""
    known = np.isfinite(gap_mm)
    ax.set_facecolor(NOT_COMPARED)
    ax.imshow(np.where(known, 1.0, np.nan), cmap="gray", vmin=0.0, vmax=1.0)
    sure = np.clip(np.abs(gap_mm) / np.maximum(SURE * noise_mm, 1e-9), 0.0, 1.0)
    return ax.imshow(gap_mm, cmap=GAP_COLOURS, vmin=-limit, vmax=limit, alpha=np.where(known, sure, 0.0))


def _smooth(gap: Float, noise2: Float) -> tuple[Float, Float]:
    """Mean in mm over the known pixels of the `SMOOTH_PX` x `SMOOTH_PX` around each pixel, and its standard error; NaN at unknown pixels.

    Args:
        gap: (H, W) metres.
        noise2: (H, W) or a number, variance of the noise of a pixel, metres squared.
    """
    from scipy import ndimage

    known = np.isfinite(gap)
    share = np.maximum(ndimage.uniform_filter(known.astype(float), SMOOTH_PX), SMOOTH_PX**-2)
    mean = ndimage.uniform_filter(np.where(known, gap, 0.0), SMOOTH_PX) / share
    noise = ndimage.uniform_filter(np.where(known, noise2, 0.0), SMOOTH_PX) / share**2 / SMOOTH_PX**2
    return 1e3 * np.where(known, mean, np.nan), 1e3 * np.sqrt(np.maximum(noise, 0.0))


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


def by_quantity(bins: dict[str, list[Bin]]) -> tuple[str, str]:
    """Mean gap against the quantity that it varies with most, and against every other quantity, with the noise as a band.

    Returns two pictures, "" for one that is missing. Quantities are ordered by the variance of their bins' means.
    """
    known = sorted(((k, b) for k, b in bins.items() if len(b) >= 2), key=lambda x: -_varies(x[1]))
    if not known:
        return "", ""
    top = 1.4 * max(*(abs(x.bias_mm) for _, b in known for x in b), float(np.median([x.floor_mm for x in known[0][1]])))
    figure, ((ax,),) = axes(7.0, 2.5, gaps_in=(0.0, 0.0))
    _curve(ax, *known[0], top)
    ax.set_ylabel("mean gap, mm")
    main = figure_uri(figure)
    if len(known) < 2:
        return main, ""
    columns, rest = 3, known[1:]
    rows = -(-len(rest) // columns)
    figure, grid = axes(10.5, 2.1 * rows - 0.4, rows, columns, gaps_in=(0.2, 0.5), sharey=True)
    for ax in grid.ravel()[len(rest) :]:
        ax.axis("off")
    for ax, (name, b) in zip(grid.ravel(), rest, strict=False):
        ax.locator_params(nbins=TICKS)
        _curve(ax, name, b, top)
        ax.tick_params(labelsize=8)
    grid[0][0].set_ylabel("mean gap, mm")
    return main, figure_uri(figure)


def _varies(b: Sequence[Bin]) -> float:
    """Variance of the bins' means, weighted by pixels."""
    weight, mean = np.array([x.pixels for x in b], float), np.array([x.bias_mm for x in b])
    return float(np.average((mean - np.average(mean, weights=weight)) ** 2, weights=weight))


def _curve(ax: Any, name: str, b: Sequence[Bin], top: float) -> None:
    middle = [0.5 * (x.low + x.high) for x in b]
    floor = np.array([x.floor_mm for x in b])
    ax.fill_between(middle, -floor, floor, color=PALETTE["wash"], linewidth=0)
    ax.plot(middle, floor, middle, -floor, color=PALETTE["line"], linewidth=0.8)
    ax.axhline(0, color=PALE, linewidth=0.8)
    ax.plot(middle, [x.bias_mm for x in b], color=BEFORE, marker="o", markersize=3, linewidth=1.4)
    ax.set_ylim(-top, top)
    if name == "amplitude":
        ax.set_xscale("log")
    ax.set_xlabel(LABELS.get(name, name))
