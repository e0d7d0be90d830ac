# SPDX-License-Identifier: Apache-2.0
"""Light on a part of the cell makes noise at the same places in all views; the camera's own noise follows no place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, SIGMA_M, VIEWS, views
from tof_gap.limits.foreign import LitLimits
from tof_gap.seen.foreign.lit_places import lit_places
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.photon_law import PhotonLaw

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask

LAW = PhotonLaw(floor_m=0.0, shot_m=SIGMA_M, reference=2000.0)
LIMITS = LitLimits()
RIGHT: Mask = np.broadcast_to(np.arange(SHAPE[1]) >= SHAPE[1] // 2, SHAPE)


def noisier(where: Float | Mask) -> Float:
    """(V, H, W) metres along the ray: noise of three times the photons' own at the middle amplitude, where the mask (V, H, W) has it."""
    return np.random.default_rng(7).normal(0, 3 * SIGMA_M, (VIEWS, *SHAPE)) * where


def seen(where: Float | Mask) -> list[str]:
    found = lit_places(views(np.random.default_rng(3), noisier(where)), LAW, LIMITS)
    return [] if found is None else [found.name, found.note]


def test_noise_of_one_half_of_the_cell_is_light_that_falls_there() -> None:
    found = lit_places(views(np.random.default_rng(3), noisier(np.broadcast_to(RIGHT, (VIEWS, *SHAPE)))), LAW, LIMITS)
    assert found is not None
    assert isinstance(found.effect, Ambient)
    assert found.effect.surface_m > 0.0
    assert found.effect.uniform_m == 0.0
    assert found.structure
    assert "at the same places in 12 views" in found.note


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_noise_that_is_alike_everywhere_is_of_no_place(share: float) -> None:
    """Within the law; or beyond it everywhere, which is no matter of places."""
    assert seen(np.full((VIEWS, *SHAPE), share)) == []


def test_noise_of_another_half_in_each_view_is_of_no_place() -> None:
    assert seen(np.stack([RIGHT if k % 2 else ~RIGHT for k in range(VIEWS)])) == []


def test_a_law_that_no_place_keeps_to_says_nothing() -> None:
    half = np.broadcast_to(RIGHT, (VIEWS, *SHAPE))
    lower = PhotonLaw(floor_m=0.0, shot_m=0.5 * SIGMA_M, reference=2000.0)
    assert lit_places(views(np.random.default_rng(3), noisier(half)), lower, LIMITS) is None
