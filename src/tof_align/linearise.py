# SPDX-License-Identifier: Apache-2.0
"""One view against the CAD at one pose: residuals along z, and their Jacobian."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_align.config import WeightConfig
    from tof_align.pixels import Pixels
    from tof_core.arrays import Float, Ints, Mask
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """The n pixels with both a measured and a rendered depth, at the pose `T_cell_camera`.

    jacobian (n, 6): metres of rendered z per right perturbation of the camera's pose (x, y, z,
    rotX, rotY, rotZ); residual (n,): measured minus rendered z, metres; sigma (n,): its noise,
    metres; index (n,): flat indices into (H, W); cell: flat indices into the raster (h, w);
    point (n, 3), normal (n, 3): of the surface, cell frame; part (n,): index of the part in the scene; ray_length (n,).
    bounced (n, P): metres of z by the light of each part (`bounced.Light`), None if not computed; lens (n, 16): metres of z by
    errors of the lens (`lens.lens_columns`), None if not computed.
    """

    T_cell_camera: Float
    index: Ints
    cell: Ints
    raster: tuple[int, int]
    jacobian: Float
    residual: Float
    sigma: Float
    depth: Float
    ray: Float
    point: Float
    normal: Float
    log_amplitude: Float | None
    part: Ints
    bounced: Float | None = None
    lens: Float | None = None

    @property
    def ray_length(self) -> Float:
        """Radial distance per metre of z, (n,)."""
        return np.asarray(np.linalg.norm(self.ray, axis=1))


def linearise(pixels: Pixels, T_cell_camera: Float, caster: Raycaster, config: WeightConfig) -> Linearised:
    """Cast the raster's rays and linearise rendered z about the pose.

    A plane with normal n through p = z r is seen along r at
    z(xi) = z - (n . v + (p x n) . w) / (n . r) when the camera moves by exp(xi), xi = (v, w)
    (Chen and Medioni's point to plane, measured along the ray instead of the normal).
    """
    R, t = T_cell_camera[:3, :3], T_cell_camera[:3, 3]
    directions = pixels.rays @ R.T
    flat = directions.reshape(-1, 3)
    hits = caster.cast(np.broadcast_to(t, flat.shape), flat)
    z = np.asarray(hits.t, float)
    both = np.isfinite(z) & np.isfinite(pixels.depth.ravel())
    rays = pixels.rays.reshape(-1, 3)
    normal = np.asarray(hits.normal, float)
    facing = np.einsum("ij,ij->i", normal, flat)
    length = np.sqrt(np.einsum("ij,ij->i", flat, flat))
    seen = both & (-facing > np.cos(np.radians(config.grazing_deg)) * length)
    seen &= ~_edges(z, normal, flat, facing, pixels.shape, config.edge_mm * 1e-3)
    at = np.flatnonzero(seen)
    n_camera = normal[at] @ R
    p_camera = z[at, None] * rays[at]
    jacobian = np.concatenate([n_camera, np.cross(p_camera, n_camera)], axis=1) / -facing[at, None]
    slope = np.sqrt(np.maximum((length[at] / facing[at]) ** 2 - 1.0, 0.0))
    lateral = 0.3 * pixels.angle * z[at] * slope  # A third of a footprint, as depth on a slope.
    return Linearised(
        T_cell_camera=T_cell_camera,
        index=pixels.index.ravel()[at],
        cell=at,
        raster=pixels.shape,
        jacobian=jacobian,
        residual=pixels.depth.ravel()[at] - z[at],
        sigma=np.hypot(pixels.sigma.ravel()[at], lateral),
        depth=z[at],
        ray=rays[at],
        point=t + z[at, None] * flat[at],
        normal=normal[at],
        log_amplitude=None if pixels.log_amplitude is None else pixels.log_amplitude.ravel()[at],
        part=hits.part[at].astype(np.int64),
    )


def _edges(z: Float, normal: Float, direction: Float, facing: Float, raster: tuple[int, int], limit: float) -> Mask:
    """(h*w,) raster points with one of four neighbours off the tangent plane by more than `limit`."""
    h, w = raster
    z = z.reshape(h, w)
    n, d = normal.reshape(h, w, 3), direction.reshape(h, w, 3)
    own = z * facing.reshape(h, w)  # n . p of the tangent plane
    edge = np.zeros((h, w), bool)
    for here, there in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:, 1:], np.s_[:, :-1]),
        (np.s_[:-1], np.s_[1:]),
        (np.s_[1:], np.s_[:-1]),
    ):
        off = np.abs(np.einsum("ijk,ijk->ij", n[here], d[there]) * z[there] - own[here])
        edge[here] |= ~(off < limit)
    return edge.ravel()
