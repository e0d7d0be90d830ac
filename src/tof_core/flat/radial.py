# SPDX-License-Identifier: Apache-2.0
"""Whether an image holds z or the distance along the ray: under the wrong assumption flat surfaces appear bent.

A plane's inverse z is linear in the normalised image coordinates (x, y). Let the stored value be
d = z L^a, with L the ray's length per metre of z: a = 0 for z, a = 1 for radial distance. Then
L^a / d is linear. Planes are grown under both assumptions, so that neither is favoured; on each,
the exponent `a` is fitted together with the plane. A curved surface gives an exponent far from
both and is ignored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.flat.planes import LEAST, PlaneGrower, thinned
from tof_core.stats import blocks, robust_std

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.camera import Camera

Z, RADIAL = 0.0, 1.0
"""The two exponents that are compared."""
FAULT = 0.001
"""Relative deviation from a plane (1 mm at 1 m) that real flat surfaces have."""
OUTLIER = 0.2
"""Share of surfaces that are not planes: their exponents are spread evenly from -10 to 10."""
BLOCK = 6
"""Side of the blocks, in pixels, whose means measure the correlation of neighbouring residuals."""
SURFACE_CAP = 5.0
"""Largest log odds of one surface: a sphere around the camera is exactly a plane under the wrong assumption."""
COPIES = 2.0
"""Each surface is found under both assumptions, so its evidence is divided by this."""


@dataclass(frozen=True, slots=True)
class RadialEvidence:
    """Evidence from the flat surfaces of a depth image: z or radial distance.

    exponent: power of the ray length that fits them best: 0 is z, 1 is radial (-1: converted once too often).
    std: its standard error; infinite where no wide flat surface was found.
    planes: surfaces used.
    bend_z_mm, bend_radial_mm: deviation of the flat surfaces from planes (RMS along z) if the values
    are z, and if they are radial.
    log_odds: natural logarithm of the odds of radial against z.
    """

    exponent: float
    std: float
    planes: int
    bend_z_mm: float
    bend_radial_mm: float
    log_odds: float

    @property
    def suspicion(self) -> float:
        """Probability (0..1) that the values are radial rather than z; 0.5 where there is no evidence."""
        return float(1.0 / (1.0 + np.exp(-np.clip(self.log_odds, -50.0, 50.0))))


@dataclass(frozen=True, slots=True)
class _Fit:
    """One surface: its exponent, the standard error, and its deviation from a plane in metres, read as z and as radial."""

    exponent: float
    std: float
    bend_z: float
    bend_radial: float

    @property
    def is_plane(self) -> bool:
        """Whether the exponent is within 1 of the exponent of z depth or of radial depth; on a curved surface it is neither."""
        return min(abs(self.exponent - Z), abs(self.exponent - RADIAL)) < 1.0

    @property
    def log_odds(self) -> float:
        odds = float(np.log(self._likelihood(RADIAL) / self._likelihood(Z))) if self.is_plane else 0.0
        return max(min(odds, SURFACE_CAP), -SURFACE_CAP)

    def _likelihood(self, a: float) -> float:
        near = np.exp(-0.5 * ((self.exponent - a) / self.std) ** 2) / (self.std * np.sqrt(2 * np.pi))
        return float((1 - OUTLIER) * near + OUTLIER / 20.0)


def radial_evidence(depth: Image, camera: Camera, surfaces: Ints | None = None) -> RadialEvidence:
    """Exponent of the flat surfaces in depth (H, W), metres.

    Args:
        depth: as stored, not converted; NaN invalid.
        camera: its intrinsics; a narrow field of view gives little evidence.
        surfaces: (H, W) numbers of surfaces known to be flat (from CAD), 0 none; found here if not given.
    """
    step = thinned(depth.shape)
    d, rays, length = (a[::step, ::step] for a in (depth.astype(np.float64), camera.rays(), camera.ray_length()))
    parts = _numbered(surfaces[::step, ::step]) if surfaces is not None else _found(d, rays, length)
    fits = [fit for on in parts if (fit := _fit(on, d, rays, length)) is not None]
    return _combined([f for f in fits if f.is_plane], COPIES if surfaces is None else 1.0)


def _combined(fits: list[_Fit], copies: float) -> RadialEvidence:
    """Mean over all surfaces, weighted by the inverse variance of the exponents."""
    if not fits:
        return RadialEvidence(float("nan"), float("inf"), 0, float("nan"), float("nan"), 0.0)
    w = np.array([f.std**-2 for f in fits])
    a, bends = np.array([f.exponent for f in fits]), np.array([[f.bend_z, f.bend_radial] for f in fits])
    bend_z, bend_radial = 1e3 * np.sqrt(w @ bends**2 / w.sum())
    return RadialEvidence(
        float(w @ a / w.sum()),
        float(np.sqrt(copies / w.sum())),
        len(fits),
        float(bend_z),
        float(bend_radial),
        sum(f.log_odds for f in fits) / copies,
    )


def _numbered(surfaces: Ints) -> Iterator[Mask]:
    yield from (surfaces == k for k in np.unique(surfaces[surfaces > 0]))


def _found(d: Float, rays: Float, length: Float) -> Iterator[Mask]:
    for reading in (Z, RADIAL):
        yield from PlaneGrower(length**reading / d, rays).planes()


def _fit(on: Mask, d: Float, rays: Float, length: Float) -> _Fit | None:
    """Fit a plane and the exponent to one surface, robustly; None where it is too small."""
    on = on & np.isfinite(d) & np.isfinite(length)
    if on.sum() < LEAST:
        return None
    w, x, y, log_length = np.sqrt(length[on]) / d[on], rays[on][:, 0], rays[on][:, 1], np.log(length[on])
    # First order about an exponent of one half, equally far from z and radial.
    A = np.stack([np.ones_like(x), x, y, -w * log_length], axis=1)
    solution, good = _robust(A, w)
    plane, column = A[good, :3], A[good, 3]
    level = float(np.median(w))
    lever = float(np.sqrt(np.mean(_off_plane(plane, column) ** 2))) / level
    residual = np.full(d.shape, np.nan)
    residual[tuple(np.argwhere(on)[good].T)] = (w - A @ solution)[good] / level
    std = float(np.linalg.norm([*_residual_std(residual), FAULT])) / max(lever, 1e-9)
    z, r = 1.0 / d[on][good], length[on][good] / d[on][good]
    return _Fit(0.5 + float(solution[3]), std, _bend(plane, z, z), _bend(plane, r, z))


def _robust(A: Float, w: Float, rounds: int = 8) -> tuple[Float, Mask]:
    """Least squares over the pixels within three sigma: the solution, and the pixels used."""
    good = np.ones(len(w), bool)
    solution = np.asarray(np.linalg.lstsq(A, w, rcond=None)[0], float)
    for _ in range(rounds):
        residual = np.abs(w - A @ solution)
        good = residual < 3.0 * max(robust_std(residual[good], 0.0), 1e-9)
        solution = np.asarray(np.linalg.lstsq(A[good], w[good], rcond=None)[0], float)
    return solution, np.asarray(good, bool)


def _residual_std(residual: Float) -> tuple[float, float]:
    """Standard error of the mean of residuals (H, W; NaN elsewhere), and the standard deviation common to a block.

    The second does not shrink with the number of pixels: a surface with such waves may be bent by as much as a whole.
    """
    h, w = (n // BLOCK * BLOCK for n in residual.shape)
    known = np.isfinite(residual)
    variance, n = float(residual[known].var()), int(known.sum())
    known[h:], known[:, w:] = False, False
    block = blocks(known, BLOCK)
    filled = block.count >= BLOCK * BLOCK // 2
    if filled.sum() < 4:
        return float(np.sqrt(variance / n)), float(np.sqrt(variance))
    count, mean = block.count[filled], block.mean(residual[known])[filled]
    common = float(np.average(mean**2 - variance / count, weights=count))
    return float(np.sqrt(variance / n)), float(np.sqrt(max(common, 0.0)))


def _off_plane(plane: Float, values: Float) -> Float:
    return np.asarray(values - plane @ np.linalg.lstsq(plane, values, rcond=None)[0])


def _bend(plane: Float, w: Float, inverse_depth: Float) -> float:
    """RMS distance in metres from the best plane through the inverse depths w."""
    return float(np.sqrt(np.mean((_off_plane(plane, w) / w / inverse_depth) ** 2)))
