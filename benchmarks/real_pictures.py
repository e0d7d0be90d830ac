# SPDX-License-Identifier: Apache-2.0
"""Pictures of docs/real.md, made from the real captures: `python -m benchmarks.real_pictures`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.bench_board_errors import robust, tables
from benchmarks.bench_real import DATA, views_of
from benchmarks.primitives import PrimitiveConfig, fit_primitives
from tof_core.camera import radial_to_z
from tof_core.page import PALETTE, axes

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.capture import View

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
DPI = 80
LIMIT_MM = 30.0
"""Colours end there."""
BLOCK_PX = 8
"""Side of the squares that the board's map shows the median of."""
PLANE_MM, NEAR_MM = 15.0, 60.0
"""Distance from a plane within which a pixel belongs to it, and up to which the picture shows it."""
AMPLITUDES = 12


def main() -> None:
    """Draw both pictures, or say what is missing."""
    if not DATA.is_dir():
        print("skipped: no ../shared/data beside the checkout")
        return
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name, figure in (("real_board.png", board()), ("real_others.png", others())):
        figure.savefig(PICTURES / name, dpi=DPI)
        print(PICTURES / name)


def board() -> Any:
    """The Kinect v2 before a board: error over the image, by range and by amplitude."""
    frames = tables()
    every = {k: np.concatenate([t[k] for t in frames]) for k in ("error", "across", "down", "log", "log2", "one", "range")}
    figure, grid = axes(13, 3.6, columns=3)
    place, by_range, by_light = grid[0]
    shown = _map(place, _blocks(every), "measured minus board, mm, median of all frames")
    figure.colorbar(shown, ax=place, shrink=0.8)
    names = ("across", "down")
    tilt = robust(np.stack([every[n] for n in ("one", "log", "log2", *names)], axis=1), every["error"])
    flat = [t["error"] - t["across"] * tilt[3] - t["down"] * tilt[4] for t in frames]
    ranges = [float(np.median(t["range"])) for t in frames]
    for values, colour, words in (
        ([t["error"] for t in frames], PALETTE["neutral"], "as measured"),
        (flat, PALETTE["accent"], "without the tilt over the image"),
    ):
        by_range.plot(ranges, [1e3 * float(np.median(v)) for v in values], "o", color=colour, label=words)
    by_range.set(xlabel="range of the frame, m", ylabel="median error, mm", title="one point a frame")
    by_range.legend(frameon=False)
    left = np.concatenate([v - np.median(v) for v in flat])
    edges = np.quantile(every["log"], np.linspace(0, 1, AMPLITUDES + 1))
    at = np.clip(np.searchsorted(edges, every["log"], side="right") - 1, 0, AMPLITUDES - 1)
    quartiles = np.array([np.quantile(1e3 * left[at == k], (0.25, 0.5, 0.75)) for k in range(AMPLITUDES)])
    light = 5e3 * np.exp(0.5 * (edges[1:] + edges[:-1]))
    by_light.fill_between(light, quartiles[:, 0], quartiles[:, 2], color=PALETTE["accent"], alpha=0.2)
    by_light.plot(light, quartiles[:, 1], color=PALETTE["accent"])
    by_light.set(xscale="log", xlabel="amplitude", ylabel="mm", title="without tilt and each frame's median: quartiles")
    return figure


def others() -> Any:
    """Azure Kinect and ifm O3R: distance from the largest plane of the frame, which is the only reference there is."""
    figure, grid = axes(13, 2.9, columns=4)
    static, moved = views_of(DATA / "real/azure_kinect_static/bag")
    narrow = views_of(DATA / "real/azure_kinect_nfov/bag")[0]
    radial = views_of(DATA / "real/ifm_o3r/bag_radial")[0]
    change = 1e3 * (moved.depth.astype(np.float64) - static.depth)
    _map(grid[0][0], change, "Azure Kinect, one scene twice:\nsecond minus first frame, mm")
    _map(grid[0][1], from_plane(narrow), "Azure Kinect, one frame:\nfrom the largest plane, mm")
    _map(grid[0][2], from_plane(radial), "ifm O3R taken for depth:\nfrom the largest plane, mm")
    as_z = replace(radial, depth=radial_to_z(radial.camera, radial.depth))
    shown = _map(grid[0][3], from_plane(as_z), "ifm O3R taken for distance\nalong the ray, mm")
    figure.colorbar(shown, ax=list(grid[0]), shrink=0.8)
    return figure


def _blocks(every: dict[str, Float]) -> Float:
    """(h, w) median error in mm of squares of the image, NaN where the board never was."""
    h, w = 424 // BLOCK_PX, 512 // BLOCK_PX
    row, column = ((0.5 * (every[n] + 1) * k).astype(int).clip(0, k - 1) for n, k in (("down", h), ("across", w)))
    square, out = row * w + column, np.full(h * w, np.nan)
    order = np.argsort(square, kind="stable")
    for at in np.split(order, np.flatnonzero(np.diff(square[order])) + 1):
        out[square[at[0]]] = 1e3 * np.median(every["error"][at])
    return out.reshape(h, w)


def from_plane(view: View) -> Float:
    """(H, W) millimetres from the largest plane of the frame, positive towards the camera; NaN beyond `NEAR_MM` of it."""
    found = fit_primitives(view.depth, view.camera, PrimitiveConfig(tolerance_mm=PLANE_MM, max_count=1))
    off = 1e3 * found[0].surface.distance(view.camera.points(view.depth).reshape(-1, 3)).reshape(view.depth.shape)
    return np.where(np.abs(off) < NEAR_MM, off, np.nan)


def _map(ax: Any, value: Float, title: str) -> Any:
    shown = ax.imshow(value, cmap="RdBu_r", vmin=-LIMIT_MM, vmax=LIMIT_MM)
    ax.set_title(title)
    ax.axis("off")
    return shown


if __name__ == "__main__":
    main()
