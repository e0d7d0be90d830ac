# SPDX-License-Identifier: Apache-2.0
"""Stripes by the beat with another modulated light: one plane wave over the image, in some of the views, with a new phase in each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import beside, blocks
from tof_gap.seen.finding import CONFIDENT, Finding, most
from tof_sensor.effects.interference import Interference

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.foreign import BeatLimits
    from tof_gap.seen.evidence.view import ViewEvidence

TURNS = np.arange(2.5, 20.1, 0.5)
TILTS = np.arange(-3.0, 3.1, 0.5)
"""Waves that are tried: periods over the height and over the width of the image."""


@dataclass(frozen=True, slots=True, eq=False)
class Beat:
    """turns, tilt: periods of the wave over height and width; hit (V,): the views that have it; size_m: metres RMS in those, along the ray."""

    turns: float
    tilt: float
    hit: Mask
    size_m: float

    def finding(self, views: Sequence[ViewEvidence], reference: float, limits: BeatLimits) -> Finding:
        """The finding `interference`; reference: amplitude to which its size refers."""
        along = [stripes(v, self.turns, self.tilt, limits) * h / v.frame.length for v, h in zip(views, self.hit, strict=True)]
        size_m = min(self.size_m, most(Interference, "burst_m"))
        effect = Interference(burst_m=size_m, duty=float(self.hit.mean()), reference=reference)
        note = f"stripes of {self.turns:g} turns in {int(self.hit.sum())} of {len(views)} views"
        return Finding(effect, CONFIDENT, share=np.abs(np.stack(along)), common=np.stack(along), note=note, structure=True)


def beat(views: Sequence[ViewEvidence], limits: BeatLimits) -> Beat | None:
    """The wave that some views have and others do not; None without one."""
    waves = np.stack([_waves(v, limits) for v in views])
    energy = np.abs(waves) ** 2
    total = energy.sum(axis=0)
    best = int(np.argmax(total))
    turns, tilt = (TURNS[best // len(TILTS)], TILTS[best % len(TILTS)])
    if turns < limits.turns:
        return None
    own = energy[:, best]
    hit = own > max(limits.chi2, limits.share * own.max())
    # Noise of whole rows contains all waves across the rows equally: a beat must also exceed the other waves of its tilt.
    usual = max(np.median(total), np.median(total[best % len(TILTS) :: len(TILTS)]))
    if total[best] < limits.stands_out * usual or not limits.views <= hit.sum() < len(views):
        return None
    phase = waves[hit, best] / np.abs(waves[hit, best])
    if len(phase) * abs(phase.mean()) ** 2 > limits.phase:
        return None  # The same wave in every view is the sensor's own pattern.
    sizes = [float(np.mean(stripes(v, turns, tilt, limits)[v.smooth] ** 2)) for v, h in zip(views, hit, strict=True) if h]
    found = Beat(float(turns), float(tilt), hit, float(np.sqrt(np.mean(sizes))))
    return found if explained(views, found, limits) >= limits.explains else None


def explained(views: Sequence[ViewEvidence], found: Beat, limits: BeatLimits) -> float:
    """Share of the error that the neighbours in the hit views have in common, beside a cubic field, that the stripes explain.

    Stripes that explain little are a part of another structure, such as an effect that is too small to be named, whose maps hold many waves.
    """
    common = removed = 0.0
    for view in (v for v, hit in zip(views, found.hit, strict=True) if hit):
        along = stripes(view, found.turns, found.tilt, limits) / view.frame.length
        before, after = (_common(v, limits) for v in (view, replace(view, residual=view.residual - along)))
        common, removed = common + max(before, 0.0), removed + before - after
    return removed / max(common, 1e-12)


def _common(view: ViewEvidence, limits: BeatLimits) -> float:
    """Chi-square of the means over cells beside a cubic field, less what noise of single pixels makes of it."""
    y, x, r, white = _cell_means(view, limits)
    root = 1.0 / np.sqrt(white)
    Q, _ = np.linalg.qr(_cubic(y, x) * root[:, None])
    return float((beside(Q, r * root) ** 2).sum()) - len(r)


def _cubic(y: Float, x: Float) -> Float:
    """(n, 10) terms of a cubic field."""
    return np.stack([y**i * x**j for i in range(4) for j in range(4 - i)], axis=1)


def _cell_means(view: ViewEvidence, limits: BeatLimits) -> tuple[Float, Float, Float, Float]:
    """Rows and columns (as shares of the image), mean residual along the ray and its variance, per cell of the view."""
    h, w = view.residual.shape
    row, column = np.nonzero(view.smooth)
    cells = blocks(view.smooth, max(1, h // limits.rows))
    r = (view.residual * view.frame.length)[view.smooth]
    white = (view.mean_sigma * view.frame.length)[view.smooth] ** 2
    mean = [cells.mean(x) for x in (row / h, column / w, r, white)]
    return mean[0], mean[1], mean[2], mean[3] / cells.count


def _waves(view: ViewEvidence, limits: BeatLimits) -> NDArray[np.complex128]:
    """(turns * tilts,) complex amplitude of each wave in a view beside a cubic field; its squared magnitude is the chi-square removed."""
    y, x, r, white = _cell_means(view, limits)
    if len(r) < limits.cells:
        return np.zeros(len(TURNS) * len(TILTS), complex)
    root = 1.0 / np.sqrt(white)
    Q, _ = np.linalg.qr(_cubic(y, x) * root[:, None])
    e = beside(Q, r * root)
    rows, columns = (np.exp(2j * np.pi * k[:, None] * q) for k, q in ((TURNS, y), (TILTS, x)))
    # Cosine and sine over several periods are orthogonal, each with half of the sum of the weights.
    b = (rows * (root * e)) @ columns.T
    return np.asarray(b * np.sqrt(2.0 / (root**2).sum())).ravel()


def stripes(view: ViewEvidence, turns: float, tilt: float, limits: BeatLimits) -> Float:
    """(H, W) metres along the ray of a view's stripes: waves near the frequency (turns, tilt), fitted to the view itself; 0 in a view of few cells."""
    h, w = view.residual.shape
    y, x, r, white = _cell_means(view, limits)
    if len(r) < limits.cells:
        return np.zeros((h, w))
    waves = [(f, tilt) for f in np.arange(turns - limits.band, turns + limits.band + 0.1, 0.5)]
    weak = weakness(view, limits.cosine)

    def basis(row: Float, column: Float) -> Float:
        angle = [2 * np.pi * (f * row + t * column) for f, t in waves]
        plain = np.stack([g(a) for a in angle for g in (np.cos, np.sin)], axis=-1)
        at = np.clip(np.rint(row * h).astype(int), 0, h - 1), np.clip(np.rint(column * w).astype(int), 0, w - 1)
        return np.concatenate([plain, plain * weak[at][..., None]], axis=-1)

    root = 1.0 / np.sqrt(white)
    B = basis(y, x) * root[:, None]
    c = np.linalg.solve(B.T @ B + limits.ridge * np.trace(B.T @ B) / B.shape[1] * np.eye(B.shape[1]), B.T @ (r * root))
    row, column = np.mgrid[:h, :w]
    return np.asarray(basis(row / h, column / w) @ c)


def weakness(view: ViewEvidence, cosine: float) -> Float:
    """(H, W) range^2 / cos(incidence), with at least `cosine` in the denominator, over its median: inverse strength of the own light.

    Foreign light off a surface does not depend on the camera's range and incidence; the camera's own light falls with both.
    """
    weak = np.nan_to_num(view.frame.radial**2 / np.maximum(np.cos(view.rendering.incidence), cosine))
    return np.asarray(weak / np.median(weak[view.smooth])) if view.smooth.any() else weak
