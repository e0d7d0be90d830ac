# SPDX-License-Identifier: Apache-2.0
"""The driver's conversion of distance to z, by its table of ray lengths or not at all: tested on a board, whose poses do not depend on depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.evidence.residual import with_codes
from tof_gap.seen.finding import CONFIDENT, Finding
from tof_sensor.effects.radial_depth import RadialDepth
from tof_sensor.effects.z_conversion import REVERSED, ZConversion

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from tof_core.arrays import Float, Ints
    from tof_core.camera import Camera
    from tof_core.capture import View
    from tof_gap.limits.evidence import LevelLimits
    from tof_scene.scene import Scene

BETTER = 0.8
"""Ratio of the spreads of depth about the board, by another reading and by the stated one, below which the other is the driver's: a Kinect v2 has 0.5, a wrong reading more than 1."""
ALIKE = 0.05
"""Relative difference of spread within which the simpler reading is taken: with a principal point in the image's middle, mirrored columns change nothing."""
LEAST_VIEWS, LEAST_PIXELS = 4, 200
"""Least number of views, and of pixels in each."""


@dataclass(frozen=True, slots=True)
class Reading:
    """What a depth image holds: distance over the ray lengths of `table`, times the stated ray lengths if `along_ray`."""

    table: str = "stated"
    along_ray: bool = False

    def effects(self) -> list[ZConversion | RadialDepth]:
        """The effects of the reading, in the order in which they are removed."""
        return [
            *([] if self.table == "stated" else [ZConversion(table=self.table)]),
            *([RadialDepth(share=1.0)] if self.along_ray else []),
        ]


READINGS = tuple(Reading(table, along_ray) for along_ray, table in product((False, True), REVERSED))
"""All readings, the simplest first."""


def reading(views: Sequence[View], scene: Scene, left_out: AbstractSet[str] = frozenset()) -> Reading | None:
    """The reading with depth clearly nearer to the board's plane than by the stated one, else the stated one; None for too few views.

    Each view has its own offset, and only bright pixels count: over one board, errors by amplitude and range are nearly constant. So
    an offset of the camera is not taken for distance along the ray.
    """
    asked = [r for r in READINGS if not left_out & {e.NAME for e in r.effects()}]
    seen = [s for s in (_about_board(v, scene) for v in views) if s is not None]
    if len(seen) < LEAST_VIEWS:
        return None
    camera = views[0].camera
    mean = {}
    for r in asked:
        ratio = _published(r, camera).ravel()
        mean[r] = float(np.mean([_spread(depth / ratio[at] - ideal) for depth, ideal, at in seen]))
    best = next(r for r in asked if mean[r] <= (1.0 + ALIKE) * min(mean.values()))
    return best if mean[best] < BETTER * mean[READINGS[0]] else READINGS[0]


def converted(views: Sequence[View], found: Reading, limits: LevelLimits) -> tuple[list[View], list[Finding]]:
    """Views with depth converted by the stated lens, and a finding for each effect of the conversion with its metres in each view."""
    effects, findings = found.effects(), list[Finding]()
    out = with_codes(views, limits) if effects else list(views)
    for effect in effects:
        ratio = _ratio(effect, views[0].camera)
        after = [replace(v, depth=(v.depth / ratio).astype(np.float32)) for v in out]
        share = np.stack([v.depth.astype(np.float64) - a.depth for v, a in zip(out, after, strict=True)])
        note = "the depth image holds distance along the ray" if isinstance(effect, RadialDepth) else f"before the board, {effect.stated}"
        findings.append(Finding(effect, CONFIDENT, share=share, corrects=True, note=note))
        out = after
    return out, findings


def _published(found: Reading, camera: Camera) -> Float:
    """(H, W) depth as the driver makes it over z."""
    return np.asarray(np.prod([np.ones(camera.shape), *(_ratio(e, camera) for e in found.effects())], axis=0))


def _ratio(effect: ZConversion | RadialDepth, camera: Camera) -> Float:
    return effect.published(camera) if isinstance(effect, ZConversion) else camera.ray_length().astype(np.float64)


def _about_board(view: View, scene: Scene) -> tuple[Float, Float, Ints] | None:
    """Measured depth, the board's, and flat indices of the bright pixels (n,) that see it; None where they are few."""
    assert view.robot is not None
    corners = np.concatenate([part.vertices for part in scene.parts])[:, :2]
    T = view.robot.T_cell_camera
    rays = view.camera.rays() @ T[:3, :3].T
    ideal = -T[2, 3] / rays[..., 2]
    on_board = T[:2, 3] + ideal[..., None] * rays[..., :2]
    seen = np.isfinite(view.depth) & ((on_board >= corners.min(axis=0)) & (on_board <= corners.max(axis=0))).all(axis=-1)
    if view.amplitude is None or seen.sum() < LEAST_PIXELS:
        return None
    at = np.flatnonzero(seen & (view.amplitude >= np.median(view.amplitude[seen])))
    return view.depth.ravel()[at].astype(np.float64), ideal.ravel()[at], at


def _spread(errors: Float) -> float:
    """Metres: median deviation from the median."""
    return float(np.median(np.abs(errors - np.median(errors))))
