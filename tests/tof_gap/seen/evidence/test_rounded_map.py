# SPDX-License-Identifier: Apache-2.0
"""The map of a driver that rectifies by the nearest pixel: its lens is found from slopes and errors of the pixels."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_gap.seen.evidence.rounded_map import Sums, rounding

CAMERA = Camera(width=160, height=120, fx=140.0, fy=140.0, cx=81.0, cy=58.0)
NOISE_PX = 0.8
"""Standard deviation of the shift that each pixel shows by itself: more than that of the rounding."""


def shifts(scale: float, k1: float) -> np.ndarray:
    """(H, W, 2) pixels from each ray to that of the nearest pixel of a sensor behind a lens of this k1."""
    x, y = CAMERA.rays()[..., 0], CAMERA.rays()[..., 1]
    radial = scale * (1.0 + k1 * (x * x + y * y))
    out = []
    for along, focal, centre in ((x, CAMERA.fx, 80.3), (y, CAMERA.fy, 60.6)):
        place = focal * radial * along + centre
        out.append(np.round(place) - place)
    return np.stack(out, axis=-1)


def sums(shift: np.ndarray, rng: np.random.Generator) -> Sums:
    """What pixels of random slopes show of a shift."""
    slopes = rng.normal(size=(len(shift), 2))
    weight = 1.0 / NOISE_PX**2
    error = (slopes * shift).sum(axis=1) + rng.normal(0, NOISE_PX, len(shift))
    x, y = slopes.T
    return Sums(weight * x * x, weight * x * y, weight * y * y, weight * x * error, weight * y * error)


@pytest.mark.parametrize(("scale", "k1"), [(1.04, -0.17), (0.97, -0.05), (1.0, 0.12)])
def test_the_rounding_of_a_barrel_or_pincushion_lens_is_found(scale: float, k1: float) -> None:
    true = shifts(scale, k1)
    found = rounding(sums(true.reshape(-1, 2), np.random.default_rng(1)), CAMERA)
    assert found.shape == (*CAMERA.shape, 2)
    off = np.abs(found - true)
    assert np.median(off) < 0.03, "of 0.25 px in the median"
    assert (off < 0.15).mean() > 0.85, "but where the sawtooth jumps"


def test_a_smooth_shift_beside_it_does_not_hide_the_rounding() -> None:
    """A principal point off by 0.4 px and a focal length by half a percent: larger than the rounding."""
    true = shifts(1.04, -0.17)
    x, y = CAMERA.rays()[..., 0], CAMERA.rays()[..., 1]
    smooth = np.stack([0.4 + 0.7 * x, -0.4 + 0.7 * y], axis=-1)
    found = rounding(sums((true + smooth).reshape(-1, 2), np.random.default_rng(2)), CAMERA)
    assert np.median(np.abs(found - true)) < 0.04
