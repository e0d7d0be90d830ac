# SPDX-License-Identifier: Apache-2.0
"""The albedo of parts as measured amplitude shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_sensor.plane import CAMERA, NORMAL, plane_depth
from tof_scene.render import Rendering
from tof_sensor.frame import lambert_amplitude
from tof_sensor.known import seen_albedo

SIZE = CAMERA.shape


def two_halves(distortion: float) -> Rendering:
    """A tilted plane whose left half is part 0 and whose right half is part 1, both drawn with albedo 0.5."""
    camera = replace(CAMERA, distortion_model="plumb_bob", distortion=(distortion, 0.0, 0.0, 0.0, 0.0))
    rays = camera.rays()
    cosine = -(rays @ NORMAL) / camera.ray_length()
    return Rendering(
        camera=camera,
        T_cell_camera=np.eye(4),
        depth=plane_depth(rays).astype(np.float32),
        part=np.broadcast_to(np.arange(SIZE[1]) >= SIZE[1] // 2, SIZE).astype(np.int16),
        face=np.zeros(SIZE, np.int32),
        normal=np.broadcast_to(NORMAL.astype(np.float32), (*SIZE, 3)).copy(),
        incidence=np.arccos(cosine).astype(np.float32),
        albedo=np.full(SIZE, 0.5, np.float32),
        mixed=np.zeros(SIZE, np.float32),
        second=np.full(SIZE, np.nan, np.float32),
    )


@pytest.mark.parametrize("distortion", [0.0, -1.5])
def test_the_brighter_part_has_the_larger_albedo_though_the_lens_model_folds_over(distortion: float) -> None:
    rendering = two_halves(distortion)
    folds = np.isnan(rendering.camera.rays()).any(axis=-1)
    assert folds.any() == (distortion != 0.0)
    amplitude = 1000.0 * lambert_amplitude(rendering) * np.where(rendering.part == 1, 1.5, 1.0)
    dark, bright = seen_albedo([np.where(folds, np.nan, amplitude).astype(np.float32)] * 4, [rendering] * 4, np.array([0.5, 0.5]))
    assert bright / dark == pytest.approx(1.5, rel=0.05)
