# SPDX-License-Identifier: Apache-2.0
"""Standard deviation of a label: pose, CAD, silhouettes, and the unobservable range offset.

A label is the CAD seen along a ray, so its error is that of the pose and of the CAD, never that
of the sensor. It has four independent terms, all along z:

- pose: `J cov J'` with the point-to-plane Jacobian of depth along a fixed ray;
- CAD: the surface's own deviation along its normal, and that of its part, where parts disagree;
- edge: near a silhouette the pose decides which of two surfaces the pixel sees. The term is the step
  between them times the standard deviation of that decision;
- offset: a constant range offset moves the solved pose with it (5 mm of offset give 4.9 mm of label
  error), so its prior is part of every label's sigma.
"""

from __future__ import annotations

from math import erfc, sqrt
from typing import TYPE_CHECKING

import numba
import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Mask
    from tof_scene.render import Rendering
    from tof_sim_label.config import LabelConfig

REACH = 2
"""Pixels around a silhouette in which its term is computed; it reaches further only for a pose error of 1.5 px and more."""

STEP = 5e-4
"""Least depth step in metres beside a neighbour's plane that counts as a silhouette; smaller steps matter less than the CAD's own term."""
FAR = 4.0
"""Reach of a silhouette in its standard deviations."""


def label_sigma(rendering: Rendering, cov_right: Float, config: LabelConfig, parts: Float | None = None) -> Image:
    """Standard deviation of the label (H, W), metres of z; NaN where the ray misses.

    Args:
        rendering: the label's own rendering.
        cov_right: (6, 6) covariance of `T_cell_camera @ exp(xi)`.
        config: the terms that are not the pose's.
        parts: (P,) metres along the normal by which each part of the scene may stand off its CAD; None or empty: none does.
    """
    camera = rendering.camera
    root = np.linalg.cholesky(np.asarray(cov_right, float) + 1e-18 * np.eye(6))
    sigma: Image = _sigma(
        _cad(rendering, config.cad_sigma_mm * 1e-3, parts),
        rendering.depth,
        rendering.normal,
        rendering.mixed,
        rendering.second,
        camera.rays(),
        root,
        np.array([camera.fx, camera.fy]),
        config.unseen_offset_mm * 1e-3,
        config.edge_px,
    )
    return sigma


def _cad(rendering: Rendering, surface: float, parts: Float | None) -> Image:
    """(H, W) metres along the normal: how far the real surface is from its CAD."""
    if parts is None or not len(parts):
        return np.full(rendering.depth.shape, surface, np.float32)
    own = np.append(parts, 0.0)[rendering.part]
    return np.asarray(np.hypot(surface, own), np.float32)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sigma(
    cad: Image,
    depth: Image,
    normal: Image,
    mixed: Image,
    second: Image,
    rays: Float,
    root: Float,
    focal: Float,
    offset: float,
    edge_px: float,
) -> Image:
    h, w = depth.shape
    out = np.full((h, w), np.nan, np.float32)
    reach = min(REACH, int(FAR * _largest_image_sigma(depth, rays, root, focal, edge_px) + 0.5))
    edge = _near_edges(depth, normal, mixed, rays, reach)
    for v in range(h):
        for u in range(w):
            z = float(depth[v, u])
            if not z > 0.0:
                continue
            n, r = normal[v, u], rays[v, u]
            slope = n[0] * r[0] + n[1] * r[1] + n[2]
            surface = _pose_variance(n, r, z, root) + cad[v, u] * cad[v, u]
            step2 = 0.0
            if edge[v, u]:
                step2 = _silhouette(depth, mixed, second, rays, n, z, v, u, reach, _image_sigma(r, z, root, focal, edge_px))
            range2 = offset * offset / (r[0] * r[0] + r[1] * r[1] + 1.0)
            out[v, u] = sqrt(surface / (slope * slope) + step2 + range2)
    return out


@numba.njit(cache=True, error_model="numpy")
def _pose_variance(n: Image, r: Float, z: float, root: Float) -> float:
    """Variance along the normal of a surface point when the camera moves: |root' (n, p x n)|^2."""
    x, y = r[0] * z, r[1] * z
    turn = (y * n[2] - z * n[1], z * n[0] - x * n[2], x * n[1] - y * n[0])
    total = 0.0
    for k in range(6):
        t = n[0] * root[0, k] + n[1] * root[1, k] + n[2] * root[2, k]
        t += turn[0] * root[3, k] + turn[1] * root[4, k] + turn[2] * root[5, k]
        total += t * t
    return total


@numba.njit(cache=True, error_model="numpy")
def _image_sigma(r: Float, z: float, root: Float, focal: Float, floor: float) -> float:
    """Standard deviation in pixels, mean of both axes, of where a point appears when the camera moves."""
    total = 0.0
    for k in range(6):
        # -(t + w x p), column by column of the root; p = z (r0, r1, 1)
        dx = root[0, k] + z * (root[4, k] - root[5, k] * r[1])
        dy = root[1, k] + z * (root[5, k] * r[0] - root[3, k])
        dz = root[2, k] + z * (root[3, k] * r[1] - root[4, k] * r[0])
        du = focal[0] * (dx - r[0] * dz) / z
        dv = focal[1] * (dy - r[1] * dz) / z
        total += du * du + dv * dv
    return sqrt(0.5 * total + floor * floor)


@numba.njit(cache=True, error_model="numpy")
def _largest_image_sigma(depth: Image, rays: Float, root: Float, focal: Float, floor: float) -> float:
    """The same at its largest, from every eighth pixel and a tenth more."""
    h, w = depth.shape
    largest = floor
    for v in range(0, h, 8):
        for u in range(0, w, 8):
            z = float(depth[v, u])
            if z > 0.0:
                largest = max(largest, _image_sigma(rays[v, u], z, root, focal, floor))
    return 1.1 * largest


@numba.njit(cache=True, error_model="numpy")
def _near_edges(depth: Image, normal: Image, mixed: Image, rays: Float, reach: int) -> Mask:
    """Pixels that see two surfaces, and those within reach of where depth leaves the plane of its neighbour."""
    h, w = depth.shape
    out = mixed > 0.0
    for v in range(h if reach > 0 else 0):
        for u in range(w):
            right = u + 1 < w and _leaves(depth, normal, rays, v, u, v, u + 1)
            below = v + 1 < h and _leaves(depth, normal, rays, v, u, v + 1, u)
            if right or below or mixed[v, u] > 0.0:
                out[max(0, v - reach) : v + reach + 2, max(0, u - reach) : u + reach + 2] = True
    return out


@numba.njit(cache=True, error_model="numpy")
def _leaves(depth: Image, normal: Image, rays: Float, v: int, u: int, a: int, b: int) -> bool:
    z, n, r, q = depth[v, u], normal[v, u], rays[v, u], rays[a, b]
    here = z * (n[0] * r[0] + n[1] * r[1] + n[2])
    slope = n[0] * q[0] + n[1] * q[1] + n[2]
    return bool(abs(depth[a, b] * slope - here) > STEP * abs(slope))


@numba.njit(cache=True, error_model="numpy")
def _silhouette(
    depth: Image,
    mixed: Image,
    second: Image,
    rays: Float,
    n: Image,
    z: float,
    v: int,
    u: int,
    reach: int,
    sigma_px: float,
) -> float:
    """Variance from the nearest edges: step^2 P (1 - P), with P the probability that the pixel sees the other surface."""
    h, w = depth.shape
    r = rays[v, u]
    worst = 0.0
    if mixed[v, u] > 0.0 and second[v, u] > 0.0:
        worst = _decision(second[v, u] - z, 0.5 - mixed[v, u], sigma_px)
    plane = z * (n[0] * r[0] + n[1] * r[1] + n[2])
    for dv in range(-reach, reach + 1):
        for du in range(-reach, reach + 1):
            a, b = v + dv, u + du
            if a < 0 or a >= h or b < 0 or b >= w or not depth[a, b] > 0.0:
                continue
            q = rays[a, b]
            slope = n[0] * q[0] + n[1] * q[1] + n[2]
            if abs(slope) < 0.02:
                continue
            away = sqrt(float(dv * dv + du * du)) - 0.5 + max(0.0, mixed[a, b])
            worst = max(worst, _decision(depth[a, b] - plane / slope, away, sigma_px))
    return worst


@numba.njit(cache=True, error_model="numpy")
def _decision(step: float, pixels: float, sigma_px: float) -> float:
    if not abs(step) < 1e3 or pixels > FAR * sigma_px:
        return 0.0
    p = 0.5 * erfc(pixels / (sigma_px * 1.4142135623730951))
    return step * step * p * (1.0 - p)
