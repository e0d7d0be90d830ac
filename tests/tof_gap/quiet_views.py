# SPDX-License-Identifier: Apache-2.0
"""Views of a tilted plane with photon noise and nothing else: what scatter is looked for in."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tests.tof_sensor.plane import NORMAL, plane_depth
from tof_align.chain import Chain
from tof_align.config import Priors
from tof_core.camera import Camera
from tof_core.capture import Capture, View
from tof_gap.limits.evidence import EvidenceLimits
from tof_gap.seen.evidence.residual import gather
from tof_scene.render import Rendering

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

CAMERA = Camera(width=112, height=86, fx=105.0, fy=105.0, cx=55.5, cy=42.5)
SHAPE = CAMERA.shape
VIEWS = 12
SIGMA_M = 0.004
"""Scatter along the ray at the middle amplitude."""


def rendering(offset_m: float) -> Rendering:
    """The plane from one camera, `offset_m` farther than 0.9 m."""
    rays = CAMERA.rays()
    cosine = -(rays @ NORMAL) / CAMERA.ray_length()
    return Rendering(
        camera=CAMERA,
        T_cell_camera=np.eye(4),
        depth=plane_depth(rays, offset=-0.9 - offset_m).astype(np.float32),
        part=np.zeros(SHAPE, np.int16),
        face=np.zeros(SHAPE, np.int32),
        normal=np.broadcast_to(NORMAL.astype(np.float32), (*SHAPE, 3)).copy(),
        incidence=np.arccos(cosine).astype(np.float32),
        albedo=np.full(SHAPE, 0.5, np.float32),
        mixed=np.zeros(SHAPE, np.float32),
        second=np.full(SHAPE, np.nan, np.float32),
    )


def views(
    rng: np.random.Generator, extra: Float | None = None, *, photons: bool = True, captures: Sequence[int] = (1,) * VIEWS
) -> tuple[ViewEvidence, ...]:
    """Sessions of `VIEWS` views; `extra` (V, H, W) metres along the ray is added to the photons' own scatter, or is all there is.

    `captures` (V,): of each view, whose means scatter less.
    """
    renderings = [rendering(0.05 * k) for k in range(VIEWS)]
    made = []
    for k, r in enumerate(renderings):
        length = CAMERA.ray_length()
        light = 2000.0 * np.exp(0.8 * np.sin(np.arange(SHAPE[1]) / 9.0))[None] / (r.depth * length) ** 2
        scatter = SIGMA_M * np.sqrt(2000.0 / light) * rng.standard_normal(SHAPE) * photons + (0.0 if extra is None else extra[k])
        depth = (r.depth + scatter / np.sqrt(captures[k]) / length).astype(np.float32)
        capture = Capture(k, CAMERA, depth, np.zeros(SHAPE, np.uint8), amplitude=light.astype(np.float32))
        one = View.of_capture(capture)
        made.append(replace(one, station=0, captures=captures[k], count=one.count * np.uint16(captures[k])))
    return gather(made, renderings, None, EvidenceLimits(edge_px=0))  # type: ignore[arg-type]


def chain() -> Chain:
    """All cameras where the robot says, at one station, arms held firmly."""
    one = np.eye(4)
    many = np.broadcast_to(one, (VIEWS, 4, 4)).copy()
    return Chain(np.zeros(VIEWS, int), (0,), one[None].copy(), many, one[None].copy(), many.copy(), one, Priors(arm_mm=0.05, arm_deg=0.005))
