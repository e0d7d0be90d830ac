# SPDX-License-Identifier: Apache-2.0
"""Multipath of one bounce: range error of each point by light reflected from other parts, from geometry and stated albedo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_scene.maps import CLEARANCE_M, half_space

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_scene.raycast import Raycaster

LIT = 1.0 - 1e-3
"""Share of the way between lamp and surface that must be free."""


def one_bounce(caster: Raycaster, lamp: Float, points: Float, normals: Float, rays: int) -> Float:
    """(n, P) metres along the ray: range error of each point by light from each of the scene's P parts.

    Monte Carlo gathering (Kajiya 1986) of one bounce between Lambertian surfaces: a part lit by the lamp (radiosity albedo cos / r^2)
    illuminates the point. The error is its share of the light times half the detour, valid for small shares.

    Args:
        caster: the scene, with its albedos.
        lamp: (3,) position of lamp and camera in the cell frame.
        points: (n, 3) in the cell frame.
        normals: (n, 3) unit, towards the lamp.
        rays: rays per point, with cosine density.
    """
    n, parts = len(points), len(caster.albedo)
    starts = np.repeat(points + CLEARANCE_M * normals, rays, axis=0)
    directions = half_space(normals, rays).reshape(-1, 3)
    hits = caster.cast(starts, directions)
    met = np.flatnonzero(np.isfinite(hits.t))
    at = starts[met] + hits.t[met, None] * directions[met]
    to_lamp = lamp - at
    far = np.linalg.norm(to_lamp, axis=1)
    cosine = np.einsum("ij,ij->i", hits.normal[met], to_lamp) / far
    free = caster.cast(at + CLEARANCE_M * hits.normal[met], to_lamp).t
    lit = (cosine > 0) & ~(free < LIT)
    met, at, far, cosine = met[lit], at[lit], far[lit], cosine[lit]
    own = lamp - points
    way = np.linalg.norm(own, axis=1)
    direct = np.einsum("ij,ij->i", normals, own) / way**3
    of, part = met // rays, hits.part[met]
    share = caster.albedo[part] * cosine / far**2 / (rays * direct[of])
    detour = 0.5 * (far + hits.t[met] - way[of])
    return np.bincount(of * parts + part, share * detour, n * parts).reshape(n, parts).astype(np.float64, copy=False)
