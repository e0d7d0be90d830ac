# SPDX-License-Identifier: Apache-2.0
"""The discrepancy: smooth unmodelled errors that neighbours and views share, as columns with a prior.

Systematic errors of a depth camera depend on few quantities: range (wiggling), amplitude, the place on
the part (multipath, deviation), the pixel (fixed pattern, lens) and the view (drift); the rest is smooth
in the image. Each kind is a Gaussian process, written as a few columns with unit-variance coefficients
times one size in metres. The sizes are estimated from the data (`mixed`), and are near zero where there is
only noise. This is a low-rank form of Kennedy and O'Hagan's discrepancy. Without it, thousands of
neighbours with a common error would count as thousands of measurements and outweigh every prior.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_align.bounced import Emitters, emitters_of, no_emitters
from tof_align.lens import lens_scale
from tof_align.parts import MOTIONS, PartFrames, no_parts, parts_of
from tof_core.lens import LENS
from tof_core.stats import grouped

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from tof_align.config import DiscrepancyConfig
    from tof_align.limits import SharedLimits
    from tof_align.linearise import Linearised
    from tof_align.parts import Places
    from tof_core.arrays import Float

SHARED = ("range", "amplitude", "object", "image", "bounce", "lens", "part")
"""Kinds with coefficients that all views share, in the order of their columns."""
SPAN = (0.002, 0.998)
"""Quantiles of an observable between which knots are placed, so that a few gross pixels do not stretch them."""
SURFACE_STRIDE = 7
"""Every so many pixels, one is a candidate for a centre on the surface."""
CHORD_45 = 0.77
"""Difference of two unit normals 45 degrees apart: one correlation length."""
FACE_LENGTHS = 5.0
"""Correlation length of the error that a whole face shares, in those of `object_m`."""
LOCAL = ("offset", "bend", "smooth")
"""Kinds with coefficients of each view: a constant, cosines of orders 1 and 2, cosines of higher orders."""


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """The columns of a session's discrepancy, the same for all views.

    knots_range (metres), knots_amplitude (ln amplitude): knots of cubic B-splines; centres (m, 6): position and scaled normal of points
    of the surface; root_*: square roots of covariances, by which coefficients have unit variance; lens_m: RMS in metres of the raw
    columns of the lens, 0 for none.
    """

    knots_range: Float
    root_range: Float
    knots_amplitude: Float
    root_amplitude: Float
    centres: Float
    root_object: Float
    object_m: float
    order: int
    parts: PartFrames = field(default_factory=no_parts)
    emitters: Emitters = field(default_factory=no_emitters)
    lens_m: float = 0.0

    @property
    def shared(self) -> tuple[int, ...]:
        """Columns per kind of `SHARED`."""
        image, part = image_count(self.order), MOTIONS * len(self.parts.index)
        line = self.root_range.shape[1], self.root_amplitude.shape[1], self.root_object.shape[1]
        return *line, image, self.emitters.count, 2 * len(LENS) * (self.lens_m > 0), part

    @property
    def local(self) -> tuple[int, ...]:
        """Columns per kind of `LOCAL`."""
        if self.order < 0:
            return 0, 0, 0
        bend = image_count(min(self.order, 2))
        return 1, bend, image_count(self.order) - bend


def empty_basis() -> Basis:
    """No discrepancy: all residuals are noise."""
    none = np.zeros((0, 0))
    return Basis(np.zeros(0), none, np.zeros(0), none, np.zeros((0, 6)), none, 1.0, -1)


def basis_of(views: Sequence[Linearised], config: DiscrepancyConfig, *, widen: float = 1.0, around: Sequence[Places] = ()) -> Basis:
    """Columns for the ranges, amplitudes and surfaces of these views; ranges and amplitudes are extended by the factor `widen`.

    `around`: more surfaces and parts that later views may see.
    """
    if not config.enabled or not any(len(v.residual) for v in views):
        return empty_basis()
    ranges = np.concatenate([v.depth * v.ray_length for v in views])
    spread = np.array([1.0 / widen, widen])
    knots, root = _line(np.outer(ranges, spread).ravel(), config.range_m, config)
    known = [v.log_amplitude for v in views if v.log_amplitude is not None]
    amplitudes = np.concatenate(known) if len(known) == len(views) else np.zeros(0)
    amplitudes = np.add.outer(amplitudes[np.isfinite(amplitudes)], 2.0 * np.log(spread)).ravel()
    knots_a, root_a = _line(amplitudes, config.amplitude, config)
    places = [*views, *around]
    surface = np.concatenate([_surface(p, config.object_m)[::SURFACE_STRIDE] for p in places])
    centres = farthest_points(surface, config.centres)
    inverse_root = _inverse_root(_surface_covariance(centres, centres))
    parts = parts_of(places, config.part_share) if config.parts else no_parts()
    return Basis(
        knots,
        root,
        knots_a,
        root_a,
        centres,
        inverse_root,
        config.object_m,
        config.image_order,
        parts,
        emitters_of(views),
        lens_scale(views),
    )


def least_sizes(kinds: Iterable[str], basis: Basis, config: DiscrepancyConfig) -> dict[str, float]:
    """Metres: the least size of each kind; that of the lens is the error of a good calibration."""
    floor = config.floor_mm * 1e-3
    return {kind: max(floor, config.lens_least * basis.lens_m) if kind == "lens" else floor for kind in kinds}


def _line(values: Float, length: float, config: DiscrepancyConfig) -> tuple[Float, Float]:
    """Knots of cubic B-splines over what `values` span, and the root of a Matern 3/2 covariance between them."""
    if len(values) < 2:
        return np.zeros(0), np.zeros((0, 0))
    low, high = np.quantile(values, SPAN)
    step = config.knots * length
    count = int(np.clip(np.ceil((high - low) / step), 1, config.most_knots))
    # Equal values (one pixel, an amplitude without contrast) still need distinct knots.
    knots = low + max((high - low) / count, 0.01 * step) * np.arange(-1, count + 2)
    between = matern(np.abs(knots[:, None] - knots[None]) / length)
    return knots, np.asarray(np.linalg.cholesky(between + 1e-9 * np.eye(len(knots))), float)


def matern(distance: Float) -> Float:
    """Correlation of a Matern 3/2 process at a distance in correlation lengths."""
    r = np.sqrt(3.0) * np.minimum(distance, 50.0)
    return np.asarray((1.0 + r) * np.exp(-r))


def spline_entries(knots: Float, x: Float) -> tuple[NDArray[np.int32], Float]:
    """Places and values (n, 4) of the uniform cubic B-splines that are not zero at x.

    Constant beyond the outer knots; zero where x is NaN.
    """
    known = np.isfinite(x)
    position = np.clip((np.where(known, x, knots[1]) - knots[1]) / (knots[1] - knots[0]), 0, len(knots) - 3 - 1e-9)
    left = position.astype(np.int32)
    t = position - left
    s = 1.0 - t
    values = np.stack([s**3, 3 * t**3 - 6 * t**2 + 4, 3 * s**3 - 6 * s**2 + 4, t**3], axis=1)
    return left[:, None] + np.arange(4, dtype=np.int32), values * (known / 6.0)[:, None]


def surface_columns(basis: Basis, view: Places) -> NDArray[np.floating[Any]]:
    """(n, m) covariance of the error at each pixel with that at each centre of the surface, in single precision."""
    return _surface_covariance(_surface(view, basis.object_m), basis.centres, np.float32)


def _surface(view: Places, length: float) -> Float:
    """(n, 6) position of the surface in correlation lengths, and its normal, scaled so that 45 degrees are one length."""
    return np.concatenate([view.point / length, view.normal / CHORD_45], axis=1)


def _surface_covariance(x: Float, y: Float, kind: type[np.floating[Any]] = np.float64) -> NDArray[np.floating[Any]]:
    """(n, m) covariance between places on the part: half of it decays within a correlation length, half within five.

    The second half is an error that a whole face shares. A pose can imitate it, so it must be allowed for. Exponentials of all pixels
    and centres take half of the time in single precision (`kind`), and err by less than 1e-6; distances lose digits where they nearly
    cancel, and are computed in double precision.
    """
    place, facing = _square_distance(x[:, :3], y[:, :3]), _square_distance(x[:, 3:], y[:, 3:])
    near = _half_exp(np.add(place, facing).astype(kind, copy=False))
    place /= FACE_LENGTHS**2
    place += facing
    near += _half_exp(place.astype(kind, copy=False))
    return near


def _half_exp(square: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """exp(-distance) / 2, in the place of the squared distances: matrices of all pixels and centres are slow to allocate."""
    np.sqrt(square, out=square)
    np.negative(square, out=square)
    np.exp(square, out=square)
    square *= 0.5
    return square


def _square_distance(x: Float, y: Float) -> Float:
    """(n, m) by one product: |x|^2 - 2 x.y + |y|^2; sums over whole matrices would take longer than it."""
    left = np.column_stack([-2.0 * x, np.einsum("ij,ij->i", x, x), np.ones(len(x))])
    right = np.column_stack([y, np.ones(len(y)), np.einsum("ij,ij->i", y, y)])
    out: Float = left @ right.T
    return np.maximum(out, 0.0, out=out)


def _inverse_root(K: NDArray[np.floating[Any]]) -> Float:
    """K^-1/2, for the columns of Nystroem's approximation."""
    if not K.size:
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(K)
    return np.asarray(vectors / np.sqrt(np.maximum(values, 1e-6)) @ vectors.T)


def farthest_points(points: Float, count: int) -> Float:
    """(min(count, n), d) points as far apart as possible (greedy, from the first one)."""
    if not len(points) or count < 1:
        return points[:0]
    chosen = [0]
    far = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(far)))
        far = np.minimum(far, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]


def image_count(order: int) -> int:
    """Number of cosines over the image up to an order, without the constant."""
    return max(0, (order + 1) * (order + 2) // 2 - 1)


def image_columns(view: Linearised, order: int) -> Float:
    """(n, k) cosines over the image up to an order, without the constant; higher orders are smaller (`fading`)."""
    return cosines(*view.raster, order)[view.cell]


@lru_cache(maxsize=8)
def cosines(h: int, w: int, order: int) -> Float:
    """(h*w, k) the same for every raster pixel."""
    x = np.cos(np.pi * np.outer(np.arange(w) + 0.5, np.arange(order + 1)) / w)
    y = np.cos(np.pi * np.outer(np.arange(h) + 0.5, np.arange(order + 1)) / h)
    pairs = [(i, total - i) for total in range(1, order + 1) for i in range(total + 1)]
    columns = [np.outer(y[:, j], x[:, i]).ravel() * fading(i, j) for i, j in pairs]
    return np.stack(columns, axis=1) if columns else np.zeros((h * w, 0))


def fading(i: int, j: int) -> float:
    """Size of a cosine of orders (i, j), relative to the lowest ones."""
    return float((1.0 + i * i + j * j) ** -0.75)


def inflation(view: Linearised, residual: Float, weight: Float, limits: SharedLimits) -> float:
    """Ratio of the variance of a mean of pixels to that of independent pixels, at least `least`.

    residual (n,): metres after the fit; weight (n,): inverse variances before this factor. Sums over blocks of block x block raster
    pixels are compared with their expected variance; for independent neighbours the ratio is the scale of the noise.
    """
    used = weight > 0
    e2 = weight * residual**2
    white = float(e2[used].mean()) if used.any() else 1.0
    _h, w = view.raster
    y, x = np.divmod(view.cell, w)
    blocks = grouped(y // limits.block, x // limits.block)
    count = blocks.sum(used)
    full = count >= limits.block_share * limits.block**2
    if full.sum() < limits.blocks:
        return max(limits.least, white)
    together = float((blocks.sum(np.sqrt(weight) * residual)[full] ** 2).sum() / count[full].sum())
    return max(limits.least, white, together)


def shared_inflation(energy: float, pixels: float, neighbours: float) -> float:
    """Factor for the variance of each of `pixels`, from the chi-square `energy` that a fit leaves of them.

    White noise leaves energy = pixels. Any excess is an error that about `neighbours` drawn pixels share. It replaces the smooth kinds
    of this module while effects are tested: beside a free function of range, a wiggle would be no evidence.
    """
    return 1.0 + max(energy / pixels - 1.0, 0.0) * neighbours
