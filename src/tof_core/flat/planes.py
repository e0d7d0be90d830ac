# SPDX-License-Identifier: Apache-2.0
"""Planes in a depth image, largest first: fitted to local patches, grown over connected pixels.

In w = 1/z a plane is linear in the normalised image coordinates: a fit has three parameters
and is linear least squares.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import robust_std, second_differences

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask

COLUMNS = 120
"""Approximate columns of the subsampled image; more add nothing about large planes."""
PLANES = 8
SAMPLES = 250
"""Local patches tried for each plane."""
PATCH = 24
"""Pixels drawn for a patch, within a twelfth of the image to each side; half of them must be on no plane yet."""
LEAST = 60
"""Fewest pixels of a surface."""
FLAT = 0.002
"""Relative distance from a plane (2 mm at 1 m), beyond the noise, within which a pixel belongs to it."""


def thinned(shape: tuple[int, ...]) -> int:
    """Step of the subsampling, in pixels."""
    return max(round(shape[1] / COLUMNS), 1)


class PlaneGrower:
    """Finds planes in w (H, W), the inverse z (NaN invalid), with the camera's rays (H, W, 3)."""

    def __init__(self, w: Float, rays: Float, seed: int = 0) -> None:
        """Smooth the image and estimate its noise."""
        self._random = np.random.default_rng(seed)
        # A lens calibrated from a small board has no rays in the corners of the image.
        w = np.where(np.isfinite(rays).all(axis=-1), w, np.nan)
        self._A = np.nan_to_num(np.stack([np.ones(w.shape), rays[..., 0], rays[..., 1]], axis=-1))
        self._w = _smoothed(w)
        self._tolerance = FLAT + 2.5 * _noise(self._w)
        self._free = np.isfinite(self._w) & np.isfinite(w)

    def planes(self) -> Iterator[Mask]:
        """Pixels (H, W) of one plane after another."""
        from scipy.ndimage import binary_dilation

        for _ in range(PLANES):
            start = self._best_patch()
            if start is None:
                return
            on = self._grown(start)
            if on is None:
                self._free &= ~self._near(start)
                continue
            yield on
            self._free &= ~binary_dilation(on)

    def _near(self, plane: Float) -> Mask:
        return self._free & (np.abs(self._A @ plane - self._w) < self._tolerance * np.abs(self._w))

    def _best_patch(self) -> Float | None:
        """The plane through a local patch that most free pixels lie on (MSAC)."""
        v, u = np.nonzero(self._free)
        if len(v) < LEAST:
            return None
        some = self._random.choice(len(v), min(len(v), 3000), replace=False)
        v, u = v[some], u[some]
        A, w = self._A[v, u], self._w[v, u]
        tried = self._patches(v, u)
        if not len(tried):
            return None
        misfit = np.abs(A @ tried.T - w[:, None]) / (self._tolerance * w[:, None])
        return np.asarray(tried[int(np.argmax(np.maximum(1 - misfit**2, 0).sum(axis=0)))])

    def _patches(self, v: NDArray[np.int64], u: NDArray[np.int64]) -> Float:
        """Planes (n, 3) through pixels drawn around randomly chosen pixels."""
        height, width = self._free.shape
        reach = max(max(height, width) // 12, 2)
        at = self._random.integers(0, len(v), SAMPLES)[:, None]
        rows = np.clip(v[at] + self._random.integers(-reach, reach + 1, (SAMPLES, PATCH)), 0, height - 1)
        columns = np.clip(u[at] + self._random.integers(-reach, reach + 1, (SAMPLES, PATCH)), 0, width - 1)
        free = self._free[rows, columns]
        A = self._A[rows, columns] * free[..., None]
        w = np.where(free, self._w[rows, columns], 0.0)
        normal = np.einsum("nki,nkj->nij", A, A)
        good = (free.sum(axis=1) >= PATCH // 2) & (np.linalg.cond(normal) < 1e12)
        return np.asarray(np.linalg.solve(normal[good], np.einsum("nki,nk->ni", A, w)[good][..., None])[..., 0])

    def _grown(self, plane: Float, rounds: int = 6) -> Mask | None:
        """The largest connected surface on the plane, refitted to itself."""
        from scipy.ndimage import label

        on: Mask | None = None
        for _ in range(rounds):
            parts = label(self._near(plane))[0]
            sizes = np.bincount(parts.ravel())
            sizes[0] = 0
            if sizes.max() < LEAST:
                return None
            on = np.asarray(parts == sizes.argmax())
            plane = np.asarray(np.linalg.lstsq(self._A[on], self._w[on], rcond=None)[0], float)
        return on


def _smoothed(w: Float, size: int = 5) -> Float:
    """Median over size by size neighbours, NaN left out."""
    from scipy.ndimage import median_filter

    # Half of the invalid pixels count as +inf and half as -inf, so that they do not shift the median.
    rows = np.arange(w.shape[0])[:, None] + np.arange(w.shape[1])
    filled = np.where(np.isfinite(w), w, np.where(rows % 2, np.inf, -np.inf))
    out = median_filter(filled, size)
    return np.where(np.isfinite(out), out, np.nan)


def _noise(w: Float) -> float:
    """Relative noise of a pixel, from second differences five pixels apart along rows."""
    bend = second_differences(w, axis=1, step=5) / w[:, 5:-5]
    return robust_std(bend[np.isfinite(bend)], 0.0)
