# SPDX-License-Identifier: Apache-2.0
"""Views of a step between two walls, mixed by the pixels, by the lens, or by the firmware."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, rendering
from tof_core.capture import Capture, View
from tof_gap.limits.evidence import EvidenceLimits
from tof_gap.seen.evidence.residual import gather

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float, Image
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.render import Rendering

NOISE_M = 0.002
EDGE = SHAPE[1] // 2
STEP_M = 0.3


def walls(k: int) -> Rendering:
    """A near wall at the left and a far one at the right of the image; the edge between passes through the two middle columns."""
    column = np.arange(SHAPE[1])
    near, far = 0.9 + 0.02 * k, 0.9 + 0.02 * k + STEP_M
    mixed = np.select([column == EDGE - 1, column == EDGE], [0.4, 0.3], 0.0)
    depth = np.where(column < EDGE, near, far)

    def image(row: Float) -> Image:
        return np.broadcast_to(row, SHAPE).astype(np.float32)

    return replace(
        rendering(0.0),
        depth=image(depth),
        normal=np.broadcast_to(np.array([0, 0, -1], np.float32), (*SHAPE, 3)).copy(),
        incidence=np.zeros(SHAPE, np.float32),
        mixed=image(mixed),
        second=image(np.where(mixed > 0, near + far - depth, np.nan)),
    )


def by_light(r: Rendering) -> Float:
    """Each pixel's share of both walls, which return light alike."""
    return np.where(r.mixed > 0, (1 - r.mixed) * r.depth + r.mixed * np.nan_to_num(r.second), r.depth)


def session(light: Callable[[Float], Float] = np.asarray, firmware: Callable[[Float], Float] = np.asarray) -> tuple[ViewEvidence, ...]:
    """Views of the walls: what the pixels see goes through the lens, noise is added, and the firmware makes depth of it."""
    rng, renderings = np.random.default_rng(3), [walls(k) for k in range(VIEWS)]
    made = []
    for k, r in enumerate(renderings):
        depth = firmware(light(by_light(r)) + rng.normal(0, NOISE_M, SHAPE)).astype(np.float32)
        amplitude = np.full(SHAPE, 1000.0, np.float32)
        made.append(View.of_capture(Capture(k, CAMERA, depth, np.zeros(SHAPE, np.uint8), amplitude=amplitude)))
    return gather(made, renderings, None, EvidenceLimits(edge_px=1))  # type: ignore[arg-type]


def mean(depth: Float) -> Float:
    """Over 9 x 9 pixels."""
    return np.asarray(uniform_filter(depth, 9, mode="nearest"))
