# SPDX-License-Identifier: Apache-2.0
"""Colour as evidence for a part: its surface in the reference image against the surface behind it, corrected for the lighting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.stats import robust_stds
from tof_inspect.evidence import eroded
from tof_inspect.light import fit_light

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Bytes, Float, Ints, Mask
    from tof_core.camera import Camera
    from tof_core.capture import Colour
    from tof_inspect.config import ColourConfig
    from tof_inspect.light import Light
    from tof_inspect.without import Without
    from tof_scene.raycast import Hits, Raycaster

GAMMA = 2.2
"""Exponent from grey values to linear brightness, close to sRGB."""
DARK = 0.003
"""Brightness, as a share of white, below which noise dominates the colour; added before the logarithm."""
FLAT = np.log(4.6 * 2.0 * 2.0)
"""Log volume of all colours: a factor of a hundred in brightness, of seven in each ratio of channels."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A colour image at its pose in the cell.

    tones (h, w, 3): log brightness (mean of the channels), log red over green, log blue over green; NaN where saturated.
    Shading and shadow change the first; the two ratios hardly change.
    """

    camera: Camera
    T_cell_camera: Float
    tones: Float

    @classmethod
    def of(cls, colour: Colour | None, T_cell_depth: Float) -> Picture | None:
        """The picture of a colour image, from the pose of its depth image; None without image, calibration or TF."""
        if colour is None or colour.camera is None or colour.T_camera_colour is None:
            return None
        return cls(colour.camera, np.asarray(T_cell_depth @ colour.T_camera_colour), tones_of(colour.image))

    def look(self, caster: Raycaster, rows: Ints, cols: Ints) -> tuple[Hits, Float]:
        """Hits of the rays of pixels (n,), and the points hit (n, 3) in the cell."""
        T = self.T_cell_camera
        rays = self.camera.rays()[rows, cols] @ T[:3, :3].T
        hits = caster.cast(T[:3, 3], rays)
        return hits, T[:3, 3] + rays * hits.t[:, None]

    def recall(self, caster: Raycaster, points: Float) -> Float:
        """Tones (n, 3) of surface points (n, 3) in this image; NaN where they are not visible."""
        eye = self.T_cell_camera[:3, 3]
        uv = self.camera.project(se3.apply(se3.inverse(self.T_cell_camera), points))
        at = np.floor(np.nan_to_num(uv, nan=-9.0) + 0.5).astype(np.int64)
        seen = np.flatnonzero(((at >= 0) & (at < [self.camera.width, self.camera.height])).all(axis=1))
        way = points[seen] - eye
        near = caster.cast(eye, way).t > 1.0 - 0.003 / np.maximum(np.linalg.norm(way, axis=1), 0.1)
        clear = seen[near]
        out = np.full((len(points), 3), np.nan)
        out[clear] = self.tones[at[clear, 1], at[clear, 0]]
        return out


def tones_of(image: Bytes) -> Float:
    """Tones (h, w, 3) of an RGB image (h, w, 3), averaged over 3 x 3 pixels."""
    from scipy import ndimage

    linear = (image.astype(float) / 255.0) ** GAMMA
    mean = np.stack([ndimage.uniform_filter(linear[..., k], 3, mode="nearest") for k in range(3)], axis=-1)
    log = np.log(mean + DARK)
    tones = np.stack([log.mean(axis=-1), log[..., 0] - log[..., 1], log[..., 2] - log[..., 1]], axis=-1)
    saturated = np.asarray((image >= 252).any(axis=-1, keepdims=True))
    return np.asarray(np.where(saturated, np.nan, tones))


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
