# SPDX-License-Identifier: Apache-2.0
"""In which part of the image an error lies: an error of the camera, its lens or window may have a place there and none in the cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.evidence.view import ViewEvidence

QUARTER, HALF = 0.6, 0.85
"""Shares of the energy from which a quarter or a half of the image is stated: twice the quarter's and the half's own share of the image, or nearly."""
SPOTS, SPOTS_CARRY = 0.2, 0.7
"""Share of the image's blocks that carry most in half of the views, and the share of the other half's energy that they carry from which the
error keeps its place: drops on a window 0.81, a door that moves 0.48, fumes 0.26."""
SPOTS_WORDS = "the same places of the image in all views, a fifth of it"
"""What is stated of an error that keeps its place in the image."""


def image_place(views: Sequence[ViewEvidence], left: Sequence[Float], noise2: Sequence[Float], block_px: int) -> str:
    """The part of the image that carries errors `left` (H, W metres per view), in words: a quarter, a half, or the same spots in all views.

    "" where none carries most.

    noise2: (H, W) m^2 of noise per view. Means of squares of `block_px` pixels count above that of white noise, by their information.
    """
    of_views = [_energy(v, e, f, block_px) for v, e, f in zip(views, left, noise2, strict=True)]
    energy = sum(of_views)
    total = float(np.sum(energy))
    if total <= 0:
        return ""
    down, across = np.shape(energy)[0] // 2, np.shape(energy)[1] // 2
    rows = {"upper": slice(None, down), "lower": slice(-down, None)}
    columns = {"left": slice(None, across), "right": slice(-across, None)}
    quarters = {f"{r} {c} quarter": np.sum(energy[at, to]) / total for r, at in rows.items() for c, to in columns.items()}  # type: ignore[index]
    halves = {f"{r} half": np.sum(energy[at]) / total for r, at in rows.items()}  # type: ignore[index]
    halves |= {f"{c} half": np.sum(energy[:, to]) / total for c, to in columns.items()}  # type: ignore[index]
    for shares, least in ((quarters, QUARTER), (halves, HALF)):
        most = max(shares, key=shares.__getitem__)
        if shares[most] >= least:
            return f"the {most} of the image"
    of_blocks = np.array([e.ravel() for e in of_views])
    spots = carried(of_blocks, np.broadcast_to(np.arange(of_blocks.shape[1]), of_blocks.shape))
    # A robot that looks at one part from everywhere has its error in one place of the image too.
    on_parts = carried(of_blocks, np.array([_part(v, block_px) for v in views]))
    return SPOTS_WORDS if spots >= max(SPOTS_CARRY, on_parts) else ""


def carried(energy: Float, group: Ints) -> float:
    """Share of the energy (v, b) of half of the views in the few of their blocks whose groups (v, b) carry most in the other half; the less of both ways."""
    shares = []
    for half in (0, 1):
        known, held = ((group[h::2].ravel(), energy[h::2].ravel()) for h in (half, 1 - half))
        if held[1].sum() <= 0:
            return 0.0
        groups = int(group.max()) + 1
        density = np.bincount(known[0], known[1], groups) / np.maximum(np.bincount(known[0], minlength=groups), 1)
        order = np.argsort(-density, kind="stable")
        blocks, sums = (np.cumsum(np.bincount(held[0], weights, groups)[order]) for weights in (None, held[1]))
        shares.append(float(np.interp(SPOTS * blocks[-1], [0, *blocks], [0.0, *sums]) / sums[-1]))
    return min(shares)


def _energy(view: ViewEvidence, error: Float, noise2: Float, block_px: int) -> Float:
    """(h, w) squared block means of a view above those of white noise, over the variance of these; blocks at the border that are not whole are left out."""
    seen = np.isfinite(error) & np.isfinite(noise2)
    n, e, f = (_block_sums(np.where(seen, image, 0.0), block_px) for image in (np.ones_like(error), error, noise2))
    with np.errstate(divide="ignore", invalid="ignore"):
        white2 = view.correlation.area * f / n**2
        excess = ((e / n) ** 2 - white2) / white2
    return np.asarray(np.where((n > 0) & (white2 > 0), excess, 0.0))


def _part(view: ViewEvidence, block_px: int) -> Ints:
    """(b,) 1 + the part in the middle of each block, 0 where no part is."""
    middle = view.rendering.part[block_px // 2 :: block_px, block_px // 2 :: block_px]
    h, w = (size // block_px for size in view.rendering.part.shape)
    return np.asarray(middle[:h, :w].ravel() + 1)


def _block_sums(image: Float, block_px: int) -> Float:
    h, w = (size // block_px for size in image.shape)
    return np.asarray(image[: h * block_px, : w * block_px].reshape(h, block_px, w, block_px).sum(axis=(1, 3), dtype=float))
