# SPDX-License-Identifier: Apache-2.0
"""Planes and spheres fitted once to one depth image, where a scene has no CAD.

Greedy RANSAC on points with normals (after Schnabel, Wahl, Klein 2007): the candidate with which most
points agree, in distance and in direction, is refined by least squares and its points are removed.
Points that belong to no surface get no label.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tof_core.config import param
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.camera import Camera


@dataclass(frozen=True, slots=True)
class PrimitiveConfig:
    """Limits for points of one surface."""

    stride: int = param(3, "raster step, in pixels, between the points used", unit="px", low=1)
    tolerance_mm: float = param(5.0, "farthest a point may lie from its surface", unit="mm", low=0.1)
    angle_deg: float = param(20.0, "farthest its normal may turn from the surface's", unit="deg", low=1.0, high=90.0)
    min_share: float = param(0.0012, "least share of all points that make a surface", low=1e-4, high=1.0)
    max_radius_mm: float = param(300.0, "largest sphere", unit="mm", low=1.0)
    max_count: int = param(32, "most surfaces", low=1)
    candidates: int = param(300, "candidates tried per surface and kind", low=10)
    seed: int = param(0, "seed of the random candidates", low=0)


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """normal . p = offset, normal (3,) towards the camera; metres, camera frame."""

    normal: Float
    offset: float

    def distance(self, points: Float) -> Float:
        """Signed distance (n,) of points (n, 3), positive on the camera's side."""
        return np.asarray(points @ self.normal - self.offset)

    def normals(self, points: Float) -> Float:
        """(n, 3) outward normals beside the points."""
        return np.broadcast_to(self.normal, points.shape)


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """Centre (3,) in the camera frame and radius, metres."""

    centre: Float
    radius: float

    def distance(self, points: Float) -> Float:
        """Signed distance (n,) of points (n, 3), positive outside."""
        return np.asarray(np.linalg.norm(points - self.centre, axis=-1) - self.radius)

    def normals(self, points: Float) -> Float:
        """(n, 3) outward normals beside the points."""
        out = points - self.centre
        return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))


Surface: TypeAlias = Plane | Sphere


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A surface, its pixels (H, W) on the strided raster, and their RMS distance in metres."""

    surface: Surface
    pixels: Mask
    rms: float


def fit_primitives(depth: Image, camera: Camera, config: PrimitiveConfig | None = None) -> list[Fitted]:
    """Planes and spheres of a z-depth image (H, W), largest first; pixels are on the strided raster.

    Raises:
        RefusedError: nothing in the image is flat or round.
    """
    config = config or PrimitiveConfig()
    points, normals = oriented_points(depth, camera, config.stride)
    ok = np.isfinite(points + normals).all(axis=-1)
    where = np.flatnonzero(ok)
    p, n = points.reshape(-1, 3)[where], normals.reshape(-1, 3)[where]
    left, rng, found = np.ones(len(p), bool), np.random.default_rng(config.seed), list[Fitted]()
    least = max(20, int(config.min_share * len(p)))
    while left.sum() >= least and len(found) < config.max_count:
        surface = _best(p[left], n[left], config, rng)
        if surface is None:
            break
        agreeing = np.zeros(len(p), bool)
        agreeing[left] = _agree(surface, p[left], n[left], config)
        patch = largest_patch(_spread(agreeing, where, ok.shape))
        inlier = agreeing & patch.ravel()[where]
        if inlier.sum() >= least:
            found.append(Fitted(surface, patch, float(np.sqrt(np.mean(surface.distance(p[inlier]) ** 2)))))
            left &= ~inlier
        else:
            left &= ~agreeing  # a few pixels here and there are not a surface
    if not found:
        msg = "no plane and no sphere found"
        raise RefusedError(msg, where="depth image", todo="give a scene.yaml with CAD instead")
    return found


def oriented_points(depth: Image, camera: Camera, stride: int) -> tuple[Float, Float]:
    """Points and unit normals towards the camera, (h, w, 3) on the strided raster, NaN at edges.

    Normals come from differences over one raster step on either side of a local mean; the points
    themselves are not averaged, which would shrink curved surfaces.
    """
    import cv2

    valid = np.isfinite(depth).astype(np.float32)
    filled = np.where(valid > 0, depth, 0.0).astype(np.float32)
    size = (max(2 * stride - 1, 3),) * 2
    weight = cv2.blur(valid, size)
    mean = cv2.blur(filled, size) / np.where(weight > 0.99, weight, np.nan)
    smooth = (camera.rays() * mean[..., None])[::stride, ::stride]
    points = camera.points(depth)[::stride, ::stride]
    normals = np.full(points.shape, np.nan)
    across, down = smooth[1:-1, 2:] - smooth[1:-1, :-2], smooth[2:, 1:-1] - smooth[:-2, 1:-1]
    cross = np.cross(down, across)
    normals[1:-1, 1:-1] = cross / np.linalg.norm(cross, axis=-1, keepdims=True)
    return points, np.where((normals * points).sum(axis=-1, keepdims=True) > 0, -normals, normals)


def largest_patch(mask: Mask) -> Mask:
    """The largest connected patch of a mask (h, w), one step of gaps closed."""
    import cv2

    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    _, patch, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
    if len(stats) < 2:
        return np.zeros_like(mask)
    return np.asarray(mask & (patch == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))))


def _best(p: Float, n: Float, config: PrimitiveConfig, rng: np.random.Generator) -> Surface | None:
    """The candidate with most support, refined; support is counted on a sample."""
    sample = rng.choice(len(p), min(len(p), 4000), replace=False)
    few = p[sample], n[sample]
    candidates = [*_planes(*few, config, rng), *_spheres(*few, config, rng)]
    if not candidates:
        return None
    judges = p[sample[::3]], n[sample[::3]]
    support = [int(_agree(c, *judges, config).sum()) for c in candidates]
    best = candidates[int(np.argmax(support))]
    for _ in range(5):
        inlier = _agree(best, p, n, config)
        if inlier.sum() < 10:
            return None
        best = refine(best, p[inlier])
    return best if _agree(best, p, n, config).any() else None


def _agree(surface: Surface, p: Float, n: Float, config: PrimitiveConfig) -> Mask:
    close = np.abs(surface.distance(p)) < config.tolerance_mm * 1e-3
    aligned = (surface.normals(p) * n).sum(axis=-1) > np.cos(np.radians(config.angle_deg))
    return np.asarray(close & aligned)


def _planes(p: Float, n: Float, config: PrimitiveConfig, rng: np.random.Generator) -> list[Surface]:
    """Planes through a point and those of its neighbours that lie in its own plane."""
    out = list[Surface]()
    for i in rng.choice(len(p), min(len(p), config.candidates), replace=False):
        near = np.flatnonzero((np.abs((p - p[i]) @ n[i]) < 4e-3 * config.tolerance_mm) & (np.linalg.norm(p - p[i], axis=1) < 0.25))
        if len(near) >= 10:
            out.append(refine(Plane(n[i], float(n[i] @ p[i])), p[rng.choice(near, min(len(near), 60), replace=False)]))
    return out


def _spheres(p: Float, n: Float, config: PrimitiveConfig, rng: np.random.Generator) -> list[Surface]:
    """Spheres whose centre is where the normals of two nearby points meet."""
    from scipy.spatial import cKDTree

    near = cKDTree(p).query(p, k=min(len(p), 40))[1]
    other = near[np.arange(len(p)), rng.integers(near.shape[1], size=len(p))]
    way, turn = p[other] - p, n[other] - n
    # p_i - R n_i = p_j - R n_j; the best radius, and the distance of the two centres
    radius = (way * turn).sum(axis=1) / np.maximum((turn**2).sum(axis=1), 1e-12)
    miss = np.linalg.norm(way - radius[:, None] * turn, axis=1)
    bent = np.linalg.norm(turn, axis=1) > 0.2
    good = np.flatnonzero(bent & (radius > 0.01) & (radius < 1e-3 * config.max_radius_mm) & (miss < 0.3 * radius))
    good = rng.permutation(good)[: config.candidates]
    centre = 0.5 * (p + p[other] - radius[:, None] * (n + n[other]))
    return [Sphere(centre[k], float(radius[k])) for k in good]


def refine(surface: Surface, p: Float) -> Surface:
    """Least squares: total for a plane, Gauss-Newton on the distance for a sphere."""
    if isinstance(surface, Plane):
        middle = p.mean(axis=0)
        normal = np.linalg.svd(p - middle, full_matrices=False)[2][-1]
        normal = -normal if normal @ middle > 0 else normal
        return Plane(normal, float(normal @ middle))
    for _ in range(10):
        J = np.hstack([-surface.normals(p), -np.ones((len(p), 1))])
        step = np.linalg.lstsq(J, -surface.distance(p), rcond=None)[0]
        surface = Sphere(surface.centre + step[:3], surface.radius + float(step[3]))
    return surface


def _spread(inlier: Mask, where: Ints, shape: tuple[int, ...]) -> Mask:
    out = np.zeros(shape, bool)
    out.ravel()[where[inlier]] = True
    return out
