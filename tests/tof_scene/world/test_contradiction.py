# SPDX-License-Identifier: Apache-2.0
"""Medians over 3 x 3 pixels against their definition, and what a view knows of its noise."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_scene.world.contradiction import _median_of, _medians, strays
from tof_scene.world.limits import WorldLimits
from tof_scene.world.seen import Seen

if TYPE_CHECKING:
    from tof_core.arrays import Float

SHAPES = [(1, 1), (1, 4), (5, 2), (3, 3), (17, 23)]


def around(values: Float, v: int, u: int) -> Float:
    """The finite values among 3 x 3."""
    block = values[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
    return block[np.isfinite(block)]


def medians(values: Float) -> Float:
    """As NumPy has them; 0 where there is no value."""
    some = [around(values, v, u) for v, u in np.ndindex(*values.shape)]
    return np.array([np.median(s) if s.size else 0.0 for s in some]).reshape(values.shape)


def image(shape: tuple[int, int], lost: float, seed: int = 3) -> Float:
    rng = np.random.default_rng(seed)
    values = np.round(rng.normal(1.0, 0.02, shape), 2)  # equal ones among them
    values[rng.random(shape) < lost] = np.nan
    return values


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("lost", [0.0, 0.1, 0.7, 1.0])
def test_medians_are_those_of_the_values_there_are(shape: tuple[int, int], lost: float) -> None:
    values = image(shape, lost)
    np.testing.assert_array_equal(_median_of(values), medians(values))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("lost", [0.0, 0.2])
def test_what_lies_beyond_the_cad_is_counted_from_the_depths_around(shape: tuple[int, int], lost: float) -> None:
    measured, cad = image(shape, lost), image(shape, 0.5 * lost, seed=4)
    beyond = np.full(shape, np.nan)
    for v, u in np.ndindex(*shape):
        if np.isfinite(measured[v, u]) and np.isfinite(cad[v, u]):
            near = around(cad, v, u)
            beyond[v, u] = measured[v, u] - np.clip(measured[v, u], near.min(), near.max())
    found, error = _medians(measured, cad, measured - cad)
    np.testing.assert_array_equal(found, medians(beyond))
    np.testing.assert_array_equal(error, medians(measured - cad))


def seen_of(measured: Float, noise: Float) -> Seen:
    shape, depth = measured.shape, measured.astype(np.float32)
    camera = Camera(shape[1], shape[0], 30.0, 30.0, 8.0, 8.0)
    flat = np.ones(shape, np.float32)
    return Seen(
        camera, np.eye(4), depth, noise.astype(np.float32), flat, 0.001 * flat, np.zeros(shape, np.int64), np.zeros(shape, np.uint8)
    )


def test_noise_that_is_not_known_is_what_the_residual_shows_where_there_is_one() -> None:
    measured = np.random.default_rng(1).normal(1.0, 0.002, (60, 80))
    measured[0, :5] = np.nan
    noise = np.where(np.isfinite(measured), 0.005, np.nan)
    whole = seen_of(measured, noise).noise_or_own
    assert set(whole[np.isfinite(measured)]) == {np.float32(0.005)}
    noise[30, 40] = np.nan
    assert seen_of(measured, noise).noise_or_own[30, 40] == pytest.approx(0.002, rel=0.05)


def test_single_pixels_stray_beside_a_contradiction_alone() -> None:
    measured = np.ones((20, 20))
    measured[5, 5] = measured[15, 15] = 1.1
    seen, limits = seen_of(measured, np.full((20, 20), 0.001)), WorldLimits()
    none, one = np.zeros((20, 20), bool), np.zeros((20, 20), bool)
    one[5, 4] = True
    bias = np.zeros((20, 20))
    assert not strays(seen, bias, none, limits).any()
    assert np.argwhere(strays(seen, bias, one, limits)).tolist() == [[5, 5]]
    assert strays(replace(seen, apart=np.ones((20, 20), np.float32)), bias, none, limits).sum() == 2
