# SPDX-License-Identifier: Apache-2.0
"""Stripes of a beat: one wave over the image, in some views and not in others, its phase new each time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask
    from tof_gap.seen.residual import ViewEvidence

CELLS = 43
"""Rows of cells that are averaged before waves are looked for: two to the finest wave's turn."""
TURNS = np.arange(2.5, 20.1, 0.5)
TILTS = np.arange(-3.0, 3.1, 0.5)
"""Waves tried: turns over the height and over the width of the image."""
LEAST_TURNS = 3.5
"""A best wave of fewer is no wave but a slope: what other effects leave."""
BAND = 1.5
"""Turns to either side that belong to one beat, whose envelope widens its line."""
HIT = 25.0
"""Chi-square of a wave (two degrees of freedom) from which a view is hit."""
ALIKE = 5.0
"""Rayleigh's n R^2 of the hit views' phases from which they are one phase (0.7 % by chance; a pattern that is always there has n)."""
STANDS_OUT = 8.0
"""How far the best wave's energy must stand above the median wave's."""


@dataclass(frozen=True, slots=True, eq=False)
class Beat:
    """turns, tilt: the wave; hit (V,): the views that have it; size_m: RMS in those, along the ray."""

    turns: float
    tilt: float
    hit: Mask
    size_m: float


def beat(views: Sequence[ViewEvidence]) -> Beat | None:
    """The wave that some views have and others do not, None where there is none."""
    waves = np.stack([_waves(v) for v in views])
    energy = np.abs(waves) ** 2
    total = energy.sum(axis=0)
    best = int(np.argmax(total))
    turns, tilt = (TURNS[best // len(TILTS)], TILTS[best % len(TILTS)])
    if turns < LEAST_TURNS:
        return None
    mine = energy[:, best]
    hit = mine > max(HIT, 0.03 * mine.max())
    # Rows that jump have every wave across them alike: a beat must stand out of those of its own tilt too.
    usual = max(np.median(total), np.median(total[best % len(TILTS) :: len(TILTS)]))
    if total[best] < STANDS_OUT * usual or not 3 <= hit.sum() < len(views):
        return None
    phase = waves[hit, best] / np.abs(waves[hit, best])
    if len(phase) * abs(phase.mean()) ** 2 > ALIKE:
        return None  # The same wave in every view is the sensor's own pattern.
    sizes = [float(np.mean(stripes(v, turns, tilt)[v.smooth] ** 2)) for v, h in zip(views, hit, strict=True) if h]
    return Beat(float(turns), float(tilt), hit, float(np.sqrt(np.mean(sizes))))


def _cells(view: ViewEvidence) -> tuple[Float, Float, Float, Float]:
    """Rows and columns (as shares of the image), mean residual along the ray and its variance, per cell of the view."""
    h, w = view.residual.shape
    row, column = np.nonzero(view.smooth)
    side = max(1, h // CELLS)
    _, cell = np.unique(row // side * 10_000 + column // side, return_inverse=True)
    n = np.bincount(cell).astype(float)
    r = (view.residual * view.frame.length)[view.smooth]
    white = (view.sigma * view.frame.length)[view.smooth] ** 2
    mean = [np.bincount(cell, x) / n for x in (row / h, column / w, r, white)]
    return mean[0], mean[1], mean[2], mean[3] / n


def _waves(view: ViewEvidence) -> NDArray[np.complex128]:
    """(turns * tilts,) each wave in a view, after the view's own smooth field: the square of its size is the chi-square that it takes off."""
    y, x, r, white = _cells(view)
    if len(r) < 100:
        return np.zeros(len(TURNS) * len(TILTS), complex)
    root = 1.0 / np.sqrt(white)
    smooth = np.stack([y**i * x**j for i in range(4) for j in range(4 - i)], axis=1)
    Q, _ = np.linalg.qr(smooth * root[:, None])
    e = r * root
    e -= Q @ (Q.T @ e)
    rows, columns = (np.exp(2j * np.pi * k[:, None] * q) for k, q in ((TURNS, y), (TILTS, x)))
    # Cosine and sine of a wave of several turns are at right angles, each with half of the weights' sum.
    b = (rows * (root * e)) @ columns.T
    return np.asarray(b * np.sqrt(2.0 / (root**2).sum())).ravel()


def stripes(view: ViewEvidence, turns: float, tilt: float) -> Float:
    """(H, W) metres along the ray of a view's beat: waves within the band of the line, fitted to the view itself."""
    h, w = view.residual.shape
    y, x, r, white = _cells(view)
    waves = [(f, tilt) for f in np.arange(turns - BAND, turns + BAND + 0.1, 0.5)]
    # Foreign light off a surface stays while own light falls with range and incidence: there the beat weighs more.
    weak = np.nan_to_num(view.frame.radial**2 / np.maximum(np.cos(view.rendering.incidence), 0.1))
    weak = weak / np.median(weak[view.smooth])

    def basis(row: Float, column: Float) -> Float:
        angle = [2 * np.pi * (f * row + t * column) for f, t in waves]
        plain = np.stack([g(a) for a in angle for g in (np.cos, np.sin)], axis=-1)
        at = np.clip(np.rint(row * h).astype(int), 0, h - 1), np.clip(np.rint(column * w).astype(int), 0, w - 1)
        return np.concatenate([plain, plain * weak[at][..., None]], axis=-1)

    root = 1.0 / np.sqrt(white)
    B = basis(y, x) * root[:, None]
    c = np.linalg.solve(B.T @ B + 1e-3 * np.trace(B.T @ B) / B.shape[1] * np.eye(B.shape[1]), B.T @ (r * root))
    row, column = np.mgrid[:h, :w]
    return np.asarray(basis(row / h, column / w) @ c)
