# SPDX-License-Identifier: Apache-2.0
"""A rendering from a simulator's ideal depth image: normals, incidence and mixed pixels are computed from the depth."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_scene.rendering import Rendering, depth_only

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Image, Mask
    from tof_core.camera import Camera

STEP = 0.005
"""Depth step between neighbours, relative to range and beyond both planes, from which they are on two surfaces (5 mm at 1 m)."""
SAME = 0.005
"""Relative difference of depth up to which a pixel of the ideal image is on the scene's surface."""


def imaged(camera: Camera, depth: Image, border: Float, *, albedo: Image | None = None, normal: Image | None = None) -> Rendering:
    """The rendering of an ideal depth image.

    Args:
        camera: its raster.
        depth: (H, W) metres along z, exact, NaN without a surface.
        border: (2, H, W) in 0..1: position of an edge between a pixel's centre and its right and lower neighbour's. A depth image of the
            camera's resolution does not determine it; uniform random numbers give all shares of mixed pixels.
        albedo: (H, W), 1 where not given.
        normal: (H, W, 3) unit, camera frame, either sign; computed from the depth if not given.
    """
    across, down = _slope(depth, axis=1), _slope(depth, axis=0)
    facing = _normal(camera, depth, across, down) if normal is None else normal.astype(np.float64)
    along = np.einsum("hwi,hwi->hw", facing, camera.rays())
    facing = np.where(along[..., None] > 0, -facing, facing)
    with np.errstate(invalid="ignore"):
        incidence = np.arccos(np.clip(np.abs(along) / camera.ray_length(), 0.0, 1.0))
    mixed, second = _mixed(depth, across, down, border)
    return replace(
        depth_only(camera, depth),
        normal=facing.astype(np.float32),
        incidence=incidence.astype(np.float32),
        albedo=np.where(np.isfinite(depth), 1.0 if albedo is None else albedo, np.nan).astype(np.float32),
        mixed=mixed,
        second=second,
    )


def completed(seen: Rendering, scene: Rendering) -> Rendering:
    """`seen` with the scene's part, face, normal, albedo and mixed pixels where both show the same surface; elsewhere unchanged."""
    with np.errstate(invalid="ignore"):
        same = np.abs(seen.depth - scene.depth) <= SAME * scene.depth

    def either(own: NDArray[Any], known: NDArray[Any]) -> NDArray[Any]:
        return np.where(same.reshape(same.shape + (1,) * (own.ndim - 2)), known, own)

    return replace(
        seen,
        T_cell_camera=scene.T_cell_camera,
        part=either(seen.part, scene.part),
        face=either(seen.face, scene.face),
        normal=either(seen.normal, scene.normal),
        incidence=either(seen.incidence, scene.incidence),
        albedo=either(seen.albedo, scene.albedo),
        mixed=either(seen.mixed, scene.mixed),
        second=either(seen.second, scene.second),
    )


def _slope(depth: Image, axis: int) -> Float:
    """(H, W) change of 1/z per pixel along an axis, from the side on which the surface continues; NaN where neither does.

    1/z is linear in the image of a plane, so the slope to either side is that of the plane; across an edge it is not.
    """
    q = 1.0 / depth.astype(np.float64)
    beside = {k: _shifted(q, k, axis) for k in (-2, -1, 1, 2)}
    forward, backward = beside[1] - q, q - beside[-1]
    bend = {1: np.abs(q - 2 * beside[1] + beside[2]), -1: np.abs(q - 2 * beside[-1] + beside[-2])}
    bend = {k: np.where(np.isfinite(b), b, np.abs(s)) for (k, b), s in zip(bend.items(), (forward, backward), strict=True)}
    bend = {k: np.where(np.isfinite(b), b, np.inf) for k, b in bend.items()}
    return np.where(bend[1] <= bend[-1], forward, backward)


def _shifted(values: Float, by: int, axis: int) -> Float:
    """Values of the neighbour `by` pixels further along an axis; NaN beyond the image."""
    out = np.full_like(values, np.nan)
    n = values.shape[axis]
    into, of = slice(max(-by, 0), n - max(by, 0)), slice(max(by, 0), n - max(-by, 0))
    index = (slice(None),) * axis
    out[(*index, into)] = values[(*index, of)]
    return out


def _normal(camera: Camera, depth: Image, across: Float, down: Float) -> Float:
    """(H, W, 3) unit normals: a plane a x + b y + c = 1/z has the normal (a, b, c)."""
    x, y = np.moveaxis(camera.rays()[..., :2], -1, 0)
    per_x, per_y = _pixels_per_ray(camera)
    a, b = across * per_x[0] + down * per_x[1], across * per_y[0] + down * per_y[1]
    n = np.stack([a, b, 1.0 / depth - a * x - b * y], axis=-1)
    return np.asarray(-n / np.linalg.norm(n, axis=-1, keepdims=True))


@lru_cache(maxsize=8)
def _pixels_per_ray(camera: Camera) -> tuple[tuple[Float, Float], tuple[Float, Float]]:
    """Columns and rows per unit of normalised x, and of y, each (H, W)."""
    x, y = np.moveaxis(camera.rays()[..., :2], -1, 0)
    (x_row, x_column), (y_row, y_column) = np.gradient(x), np.gradient(y)
    det = x_column * y_row - x_row * y_column
    return (y_row / det, -y_column / det), (-x_row / det, x_column / det)


def _mixed(depth: Image, across: Float, down: Float, border: Float) -> tuple[Image, Image]:
    """(H, W) share of a second surface in each pixel, and its depth."""
    share, second = np.zeros(depth.shape), np.full(depth.shape, np.nan)
    for axis, slope, at in ((1, across, border[0]), (0, down, border[1])):
        edge = _edge(depth, slope, axis)
        for by, own in ((1, np.where(edge, 0.5 - at, 0.0)), (-1, _shifted(np.where(edge, at - 0.5, 0.0), -1, axis))):
            more = own > share
            share = np.where(more, own, share)
            second = np.where(more, _shifted(depth.astype(np.float64), by, axis), second)
    return share.astype(np.float32), second.astype(np.float32)


def _edge(depth: Image, slope: Float, axis: int) -> Mask:
    """(H, W) whether the next pixel along an axis is on another surface: the step fits neither pixel's plane."""
    q = 1.0 / depth.astype(np.float64)
    step, beside = _shifted(q, 1, axis) - q, _shifted(slope, 1, axis)
    missed = np.fmin(np.abs(step - np.nan_to_num(slope)), np.abs(step - np.nan_to_num(beside)))
    with np.errstate(invalid="ignore"):
        return np.asarray(missed > STEP * q)
