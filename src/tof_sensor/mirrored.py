# SPDX-License-Identifier: Apache-2.0
"""Light that reaches a pixel via a glossy part that reflects another surface.

The lamp lights a point q; the coat at p reflects it into the lens. Relative to the matt light of p, this is the share
R(theta) (rho_q cos(i_q) / r_q^2) / (rho_p cos(theta) / r_p^2). Its path from lamp to lens is longer by r_q + |q - p| - r_p.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.frame import once_per_frame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Ints
    from tof_sensor.frame import Frame

    ComplexArray = NDArray[np.complex128]

NORMAL_REFLECTANCE = 0.04
"""Fresnel reflectance of a lacquer (refractive index 1.5) at normal incidence."""
OFF_SURFACE_M = 1e-4
"""Distance from the surface at which a reflected ray starts, so that it does not hit the surface, metres."""
SHORT_OF = 1 - 1e-3
"""Share of the way from the lamp to a point that must be free."""
LEAST_LIGHT = 1e-3
"""Least matt light of a point in 1/m^2 that is used as denominator; albedo 1 at 1 m has 1."""


def schlick(cosine: Float) -> Float:
    """Reflectance of a lacquered surface by the cosine of the incidence: Schlick's approximation of Fresnel's law (1994)."""
    return np.asarray(NORMAL_REFLECTANCE + (1 - NORMAL_REFLECTANCE) * (1 - cosine) ** 5)


@dataclass(frozen=True, slots=True, eq=False)
class Mirrored:
    """Pixels (n,) of a part that reflect light (flat indices), the light of each relative to its matt light, and by how much its path is longer."""

    pixels: Ints
    share: Float
    longer_m: Float

    def phasor(self, waves_per_m: float) -> ComplexArray:
        """(n,) the light with its phase: `waves_per_m` times the excess path."""
        return np.asarray(self.share * np.exp(1j * waves_per_m * self.longer_m))


NOTHING = Mirrored(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))


def mirrored_light(frame: Frame, part: int) -> Mirrored:
    """What a part of the scene reflects in a view, traced once for all frequencies.

    Needs `frame.context.caster`: without it, and for part -1, nothing is reflected.
    """
    if frame.context.caster is None or part < 0:
        return NOTHING
    traced = _traced(frame)
    if part not in traced:
        traced[part] = _reflected(frame, part)
    return traced[part]


@partial(once_per_frame, whole=True)
def _traced(frame: Frame) -> dict[int, Mirrored]:
    """What parts of the scene reflect in a view: the same at every frequency; `mirrored_light` fills it."""
    del frame
    return {}


def _reflected(frame: Frame, part: int) -> Mirrored:
    """What a part of the scene reflects in a view."""
    here = frame.valid & (frame.rendering.part == part)
    pixels = np.flatnonzero(here)
    if not len(pixels):
        return NOTHING
    caster, T = frame.context.caster, frame.rendering.T_cell_camera
    assert caster is not None
    R, t = T[:3, :3], T[:3, 3]
    points, normals = frame.points[here], np.nan_to_num(frame.rendering.normal[here].astype(np.float64))
    range_m = np.linalg.norm(points, axis=1)
    along = points / range_m[:, None]
    cosine = -np.einsum("ni,ni->n", along, normals)
    away = along + 2 * cosine[:, None] * normals
    hits = caster.cast((points + OFF_SURFACE_M * normals) @ R.T + t, away @ R.T)
    met, distance = np.isfinite(hits.t), np.nan_to_num(hits.t, nan=0.0, posinf=0.0)
    second = points + away * distance[:, None]
    far = np.linalg.norm(second, axis=1)
    toward = np.nan_to_num(hits.normal) @ R
    lit = np.einsum("ni,ni->n", second, toward) / far
    # The lamp must light the side of q that faces the coat.
    seen = met & (cosine > 0) & (lit * np.einsum("ni,ni->n", away, toward) > 0)
    seen[seen] = ~caster.blocked(np.broadcast_to(t, (int(seen.sum()), 3)), second[seen] @ R.T, SHORT_OF)
    albedo = np.array([p.material.albedo for p in caster.scene.parts])
    matt = np.maximum(np.nan_to_num(frame.rendering.albedo[here].astype(np.float64)) * cosine / range_m**2, LEAST_LIGHT)
    share = np.where(seen, schlick(cosine) * albedo[hits.part] * np.abs(lit) / far**2 / matt, 0.0)
    some = np.flatnonzero(share)
    return Mirrored(pixels[some], share[some], (far + distance - range_m)[some])
