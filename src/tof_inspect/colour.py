# SPDX-License-Identifier: Apache-2.0
"""Colour as evidence for a part: its surface in the reference image against the surface behind it, corrected for the lighting."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.stats import robust_stds
from tof_inspect.evidence import eroded
from tof_inspect.light import fit_light

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_inspect.config import ColourConfig
    from tof_inspect.light import Light
    from tof_inspect.picture import Picture
    from tof_inspect.without import Without
    from tof_scene.raycast import Hits, Raycaster

FLAT = np.log(4.6 * 2.0 * 2.0)
"""Log volume of all colours: a factor of a hundred in brightness, of seven in each ratio of channels."""


class Colours:
    """Evidence of each part from reference images and current images."""

    def __init__(self, caster: Raycaster, first: Sequence[Picture], now: Sequence[Picture], config: ColourConfig) -> None:
        """Fit the change of lighting from each reference image to each current one, on parts that are not inspected."""
        self._caster, self._config = caster, config
        fixed = np.array([not part.inspect for part in caster.scene.parts])
        pairs = [(then, picture, fit_light(caster, then, picture, fixed, config)) for picture in now for then in first]
        self._pairs = [(then, picture, light) for then, picture, light in pairs if light is not None]

    @property
    def pairs(self) -> int:
        """Number of image pairs that overlap enough to estimate the change of lighting."""
        return len(self._pairs)

    def log_ratio(self, without: Without, part: int) -> float:
        """Log likelihood ratio of present over absent; 0 without evidence.

        All images share the lighting and its unmodelled part, so n of them count as the root of n.
        """
        every = [self._pair_ratio(then, now, light, without, part) for then, now, light in self._pairs]
        ratios = [v for v in every if v != 0.0]
        return float(np.sum(ratios) / np.sqrt(len(ratios))) if ratios else 0.0

    def _pair_ratio(self, then: Picture, now: Picture, light: Light, without: Without, part: int) -> float:
        """Log ratio of one image pair: log density of the median colour given the part's reference colour minus that given the background's."""
        rows, cols = self._box(now, part)
        if not len(rows):
            return 0.0
        hits, points = now.look(self._caster, rows, cols)
        mine = np.flatnonzero(_inner(hits.part == part, rows, cols))
        tones = now.tones[rows, cols]
        expected = then.recall(self._caster, points[mine]) + light.change(hits.normal[mine])
        error = tones[mine] - expected
        known = np.isfinite(error).all(axis=1)
        if int(known.sum()) < self._config.min_pixels:
            return 0.0
        there = _density(np.median(error[known], axis=0), light.sigma, self._config)
        T = now.T_cell_camera
        behind = without.cast(T[:3, 3], now.camera.rays()[rows[mine], cols[mine]] @ T[:3, :3].T)
        gone = self._behind(tones, hits, mine[known], behind.part[known], behind.normal[known], light)
        return there - gone

    def _behind(self, tones: Float, hits: Hits, mine: Ints, behind: Ints, normal: Float, light: Light) -> float:
        """Log density of the part's median tones given the tones of the background around the part."""
        which = int(np.bincount(behind + 1).argmax()) - 1
        if which < 0:
            return -float(FLAT)
        facing = np.median(normal[behind == which], axis=0)
        ring = (hits.part == which) & (hits.normal @ facing > self._config.alike) & np.isfinite(tones).all(axis=1)
        if int(ring.sum()) < self._config.min_pixels:
            return -float(FLAT)
        middle = np.median(tones[ring], axis=0)
        spread = robust_stds(tones[ring], middle)
        return _density(np.median(tones[mine], axis=0) - middle, np.hypot(light.sigma, spread), self._config)

    def _box(self, now: Picture, part: int) -> tuple[Ints, Ints]:
        """Rows and columns (n,) of the part's bounding box with a margin; of a large box, a subsample."""
        p = se3.apply(se3.inverse(now.T_cell_camera), self._caster.scene.parts[part].vertices)
        if (p[:, 2] < 0.05).any():
            return np.zeros(0, int), np.zeros(0, int)
        uv, margin = now.camera.project(p), self._config.margin_px
        low, high = np.nanmin(uv, axis=0) - margin, np.nanmax(uv, axis=0) + margin
        left, top = np.maximum(low, 0).astype(int)
        right, bottom = np.minimum(high, [now.camera.width - 1, now.camera.height - 1]).astype(int)
        if right < left or bottom < top:
            return np.zeros(0, int), np.zeros(0, int)
        step = max(1, int(np.sqrt((right - left + 1) * (bottom - top + 1) / self._config.pixels)))
        rows, cols = np.mgrid[top : bottom + 1 : step, left : right + 1 : step]
        return rows.ravel(), cols.ravel()


def _inner(mine: Mask, rows: Ints, cols: Ints) -> Mask:
    """The mask without its outermost ring of pixels, if enough remain."""
    inner = eroded(mine.reshape(len(np.unique(rows)), len(np.unique(cols)))).ravel()
    return np.asarray(inner if inner.sum() >= 12 else mine)


def _density(error: Float, sigma: Float, config: ColourConfig) -> float:
    """Log density of an error (3,): a Gaussian, mixed with a share `surprise` (edge of a shadow, gloss) spread over all colours."""
    exponent = -0.5 * float(((error / sigma) ** 2).sum()) - float(np.log(sigma).sum()) - 1.5 * np.log(2 * np.pi)
    return float(np.logaddexp(np.log1p(-config.surprise) + exponent, np.log(config.surprise) - FLAT))
