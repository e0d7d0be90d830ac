# SPDX-License-Identifier: Apache-2.0
"""In which part of the image an error lies: an error of the camera may have a place there and none in the cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

QUARTER, HALF = 0.6, 0.85
"""Shares of the energy from which a quarter or a half of the image is stated: twice the quarter's and the half's own share of the image, or nearly."""


def image_place(views: Sequence[ViewEvidence], left: Sequence[Float], noise2: Sequence[Float], block_px: int) -> str:
    """The quarter or half of the image that carries errors `left` (H, W metres per view), in words; "" where none carries most.

    noise2: (H, W) m^2 of noise per view. Means of squares of `block_px` pixels count above that of white noise, by their information.
    """
    energy = sum(_energy(v, e, f, block_px) for v, e, f in zip(views, left, noise2, strict=True))
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
    return ""


def _energy(view: ViewEvidence, error: Float, noise2: Float, block_px: int) -> Float:
    """(h, w) squared block means of a view above those of white noise, over the variance of these; blocks at the border that are not whole are left out."""
    seen = np.isfinite(error) & np.isfinite(noise2)
    n, e, f = (_block_sums(np.where(seen, image, 0.0), block_px) for image in (np.ones_like(error), error, noise2))
    with np.errstate(divide="ignore", invalid="ignore"):
        white2 = view.correlation.area * f / n**2
        excess = ((e / n) ** 2 - white2) / white2
    return np.asarray(np.where((n > 0) & (white2 > 0), excess, 0.0))


def _block_sums(image: Float, block_px: int) -> Float:
    h, w = (size // block_px for size in image.shape)
    return np.asarray(image[: h * block_px, : w * block_px].reshape(h, block_px, w, block_px).sum(axis=(1, 3), dtype=float))
