# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.filtered FOLDER`: recorded sessions through the denoising filters of firmware; are the same effects named?

FOLDER is one that `python -m benchmarks.gap_check --form foreign --step record --out FOLDER` has made. Each filter averages depth over a
window, without the neighbours that lie on another surface, as cameras do before they send an image. A filter leaves every bias of the
camera as it is and adds none on even surfaces: the right verdict is that of the session without it.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.curved import verdict_of
from benchmarks.gap_check.record import BAGS, SEALED
from tof_core.cores import one_thread

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Image
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster

SURFACE_M = 0.03
"""Depth difference to a pixel beyond which a neighbour lies on another surface: ten times the noise of such cameras."""


def even(depth: Image, width: int) -> Float:
    """Mean of the neighbours on the same surface in a window of `width` pixels."""
    return _weighted(depth, np.ones((width, width)))


def gaussian(depth: Image, sigma_px: float) -> Float:
    """Mean of the neighbours on the same surface, weighted by a Gaussian of their distance."""
    at = np.arange(-int(2 * sigma_px + 1), int(2 * sigma_px + 1) + 1)
    line = np.exp(-0.5 * (at / sigma_px) ** 2)
    return _weighted(depth, line[:, None] * line)


def median(depth: Image, width: int) -> Float:
    """Median of the neighbours on the same surface in a window of `width` pixels."""
    around = np.stack(list(_neighbours(depth, width)))
    with np.errstate(invalid="ignore"):
        around[~(np.abs(around - depth) < SURFACE_M)] = np.nan
    out = np.full(depth.shape, np.nan)
    seen = np.isfinite(depth)
    out[seen] = np.nanmedian(around[:, seen], axis=0)
    return out


FILTERS: dict[str, Callable[[Image], Float]] = {
    "3 x 3": lambda depth: even(depth, 3),
    "5 x 5": lambda depth: even(depth, 5),
    "gauss": lambda depth: gaussian(depth, 1.0),
    "median": lambda depth: median(depth, 3),
}


def _neighbours(depth: Image, width: int) -> Sequence[Float]:
    """(H, W) images of each neighbour of a window, NaN beyond the image."""
    half, (h, w) = width // 2, depth.shape
    padded = np.pad(depth.astype(float), half, constant_values=np.nan)
    return [padded[i : i + h, j : j + w] for i, j in np.ndindex(width, width)]


def _weighted(depth: Image, window: Float) -> Float:
    """Mean, weighted by a square window, of the neighbours on the same surface."""
    total, weight = np.zeros(depth.shape), np.zeros(depth.shape)
    for neighbour, w in zip(_neighbours(depth, len(window)), window.ravel(), strict=True):
        same = np.abs(neighbour - depth) < SURFACE_M
        total[same] += w * neighbour[same]
        weight[same] += w
    return np.where(weight > 0, total / np.maximum(weight, 1e-12), np.nan)


def through(firmware: Callable[[Image], Float]) -> Callable[[Sequence[View], Raycaster], list[View]]:
    """What sends the depth images of views through a filter."""
    return lambda views, _: [replace(v, depth=firmware(v.depth).astype(np.float32)) for v in views]


def main() -> int:
    """Filter, diagnose, and print a line for each session; then how many have the verdict of the unfiltered session."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.filtered", description=__doc__)
    parser.add_argument("folder", type=Path, help="recorded sessions of the emerging camera")
    parser.add_argument("--sessions", default="", help="numbers of the sessions, joined by commas; all if empty")
    parser.add_argument("--filters", default="", help=f"filters, joined by commas ({', '.join(FILTERS)}); they take turns; all if empty")
    args = parser.parse_args()
    one_thread()
    asked = {int(n) for n in args.sessions.split(",") if n}
    kinds = [k.strip() for k in args.filters.split(",") if k.strip()] or list(FILTERS)
    alike = total = 0
    for number, sealed in enumerate(sorted((args.folder / SEALED).glob("*/case.json"))):
        if asked and number not in asked:
            continue
        kind, bag = kinds[number % len(kinds)], args.folder / BAGS / sealed.parent.name
        plain, filtered = verdict_of(bag, lambda views, _: views), verdict_of(bag, through(FILTERS[kind]))
        truth, total = json.loads(sealed.read_text()), total + 1
        alike += filtered == plain
        mark = "same" if filtered == plain else "OTHER"
        words = f"{', '.join(plain)}; through the filter {', '.join(filtered)}"
        print(f"{mark:5s}  {bag.name}  {truth['kind']:8s} {kind:6s}  {', '.join(truth['causes']) or '-':40s} {words}", flush=True)
    print(f"the same verdict through a filter: {alike} of {total}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
