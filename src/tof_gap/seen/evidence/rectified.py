# SPDX-License-Identifier: Apache-2.0
"""Images that a driver rectified by the nearest pixel: a pixel then holds the depth of a ray up to half a pixel beside its own.

The shift of each pixel is the same in all views. On a surface seen at a slant it is millimetres of depth, in rings and stripes where the
rectified grid passes the raw one, and no camera's range errs so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from scipy.ndimage import uniform_filter

from tof_core.cores import in_threads
from tof_gap.seen.evidence.rounded_map import Sums, rounding
from tof_sensor.geometry import ray_columns

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Image
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.frame import Frame

LEAST_VIEWS = 8
"""Fewest views: each half of them must show two shifts of every pixel."""
SD_PX = 0.3
"""Standard deviation of the rounding to the nearest pixel: 1 / sqrt(12)."""
MOST_PX = 0.5
"""The largest shift by rounding."""
NARROW_PX, WIDE_PX = 15, 61
"""Sides of the windows whose means are no shift of this kind. By the narrow one it is judged whether there is any: errors of range and lens are
wider. The wide one keeps the rings about the centre, which are a third of the image wide."""
SHARED_PX = 3
"""Side of the square whose pixels share one estimate: rings are at least some pixels wide but for the corners."""
SD_M = 0.003
"""Standard deviation of a pixel's own offset: millimetres, as of fixed patterns."""
STEEP_M = 0.02
"""Metres of depth for each pixel, beyond which a slope is an edge."""
LEAST_GAIN = 0.05
"""Least share of the squared error, noise included, that the shifts found by one half of the views explain in the other half. Nearest pixels:
0.08 to 0.18; other cameras: -0.02 and less, since a shift that is not there only adds noise. A strong fixed pattern: up to 0.09, since an offset of
a pixel that is seen at like slants resembles a shift; the offsets themselves explain 0.46 to 0.48 there."""


@dataclass(frozen=True, slots=True, eq=False)
class Offsets:
    """Normal equations (H, W) of an offset of each pixel along the ray, in metres: weights times squared columns, and columns and error."""

    aa: Float
    ae: Float

    def explained(self, offset: Float) -> float:
        """Squared error over the noise that offsets (H, W) explain."""
        return float((2.0 * offset * self.ae - offset * offset * self.aa).sum())


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Normal equations of what each pixel may have in all views; squared: the squared error over the noise."""

    shifts: Sums
    offsets: Offsets
    squared: float


T = TypeVar("T", Sums, Offsets)


def ray_shift(views: Sequence[ViewEvidence]) -> Image | None:
    """(H, W, 2) pixels along x and y from the ray of each pixel to that of its depth; None where the views show no such shift.

    The shifts that one half of the views finds must explain more in the other half than a fixed pattern does, an offset of each pixel. A camera
    with distortion publishes its own image: nothing was rectified.
    """
    if len(views) < LEAST_VIEWS or views[0].view.camera.distorted:
        return None
    one, other = (_sums(views[start::2], NARROW_PX) for start in (0, 1))
    squared = one.squared + other.squared
    gain, of_offsets = _crossed(one.shifts, other.shifts, _solved) / squared, _crossed(one.offsets, other.offsets, _offsets) / squared
    if gain < max(LEAST_GAIN, of_offsets):
        return None
    every = _sums(views, WIDE_PX)
    rounded = rounding(every.shifts.each(np.ravel), views[0].view.camera)
    # A driver may rectify by another lens model: then each pixel has its own shift.
    return np.asarray(rounded if every.shifts.explained(rounded) / every.squared > gain else _solved(every.shifts), np.float32)


def added_depth(frame: Frame, shift: Image) -> Float:
    """(H, W) metres of z that a shift (H, W, 2) of the rays in pixels adds, to first order."""
    return np.asarray(np.einsum("hwk,hwk->hw", _slopes(frame), shift))


def rounded_mm(views: Sequence[ViewEvidence]) -> float | None:
    """RMS in mm of depth along z by which rounding moved the pixels off edges; None where it did not."""
    added = [added_depth(v.frame, shift)[v.smooth] for v in views if (shift := v.view.ray_shift) is not None]
    return 1e3 * float(np.sqrt(np.mean(np.concatenate(added) ** 2))) if added else None


def _slopes(frame: Frame) -> Float:
    """(H, W, 2) metres of z for each pixel along x and y; 0 where the slope is that of an edge."""
    unit = np.diag([1.0 / frame.camera.fx, 1.0 / frame.camera.fy])
    slopes = ray_columns(frame, np.broadcast_to(unit, (*frame.depth.shape, 2, 2)))
    return np.where(np.abs(slopes).max(axis=-1, keepdims=True) < STEEP_M, slopes, 0.0)


def _sums(views: Sequence[ViewEvidence], window_px: int) -> Equations:
    """The normal equations (H, W) over all views. The error is the residual less its mean over a window."""

    def of_view(view: ViewEvidence) -> Float:
        keep = view.smooth.astype(float)
        share = np.maximum(uniform_filter(keep, window_px), window_px**-2)
        error = np.where(view.smooth, view.residual, 0.0).astype(float)
        error = keep * (error - uniform_filter(error, window_px) / share)
        x, y = np.moveaxis(_slopes(view.frame), -1, 0)
        weight = keep / np.where(view.smooth, view.sigma, 1.0).astype(float) ** 2
        along = np.where(view.smooth, 1.0 / np.where(view.smooth, view.frame.length, 1.0), 0.0)
        return np.stack([weight * p for p in (x * x, x * y, y * y, x * error, y * error, along * along, along * error, error**2)])

    xx, xy, yy, xe, ye, aa, ae, squared = np.asarray(sum(in_threads(of_view, views)))
    return Equations(Sums(xx, xy, yy, xe, ye), Offsets(aa, ae), float(squared.sum()))


def _crossed(one: T, other: T, solved: Callable[[T], Float]) -> float:
    """Squared error over the noise that the solution of each half of the views explains in the other half."""
    return other.explained(solved(one)) + one.explained(solved(other))


def _solved(sums: Sums) -> Float:
    """(H, W, 2) pixels: the shift by sums (H, W), shared by neighbours, at most `MOST_PX`."""
    of = sums.each(_shared)
    xx, yy = of.xx + SD_PX**-2.0, of.yy + SD_PX**-2.0
    shift = np.stack([yy * of.xe - of.xy * of.ye, xx * of.ye - of.xy * of.xe], axis=-1) / (xx * yy - of.xy**2)[..., None]
    return np.asarray(np.clip(shift, -MOST_PX, MOST_PX))


def _offsets(sums: Offsets) -> Float:
    """(H, W) metres along the ray: the offset by sums (H, W), shared by neighbours as a shift is."""
    return np.asarray(_shared(sums.ae) / (_shared(sums.aa) + SD_M**-2.0))


def _shared(sums: Float) -> Float:
    """Sums (H, W) over the square whose pixels share one estimate."""
    return np.asarray(SHARED_PX**2 * uniform_filter(sums, SHARED_PX))
