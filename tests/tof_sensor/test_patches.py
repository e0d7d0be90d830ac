# SPDX-License-Identifier: Apache-2.0
"""Light between patches: pairs that see each other, and the series of their bounces."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_align.made import box, scene_of
from tof_scene.raycast import Raycaster
from tof_sensor.patches import BOUNCES, Exchange, Patches, emitted, exchange_of


def patches(area: float = 1e-4, lit: tuple[float, float] = (1.0, 0.0)) -> Patches:
    """Two small patches 0.5 m apart that face each other across the y axis, 2 m from the lamp."""
    return Patches(
        point=np.array([[0.0, -0.25, 2.0], [0.0, 0.25, 2.0]]),
        normal=np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]),
        part=np.array([0, 1]),
        solid_angle=np.array(lit) * area / 4.0,
        range_m=np.full(2, 2.0),
        area=np.full(2, area),
    )


def far() -> Raycaster:
    """A scene in which nothing stands between the patches."""
    return Raycaster(scene_of(box("floor", (1.0, 1.0, 0.02), np.eye(4) + np.array([[0, 0, 0, 9.0]] * 3 + [[0] * 4]))))


def test_a_pair_exchanges_what_its_area_and_distance_say() -> None:
    pair = exchange_of(patches(), np.eye(4), far())
    assert (pair.one.tolist(), pair.other.tolist()) == ([0], [1])
    assert pair.length == pytest.approx([0.5])
    assert [*pair.forth, *pair.back] == pytest.approx([1e-4 / (np.pi * 0.25 + 1e-4)] * 2)


def test_a_wall_between_them_ends_the_exchange() -> None:
    wall = np.eye(4)
    wall[2, 3] = 2.0
    assert len(exchange_of(patches(), np.eye(4), Raycaster(scene_of(box("wall", (0.2, 0.02, 0.2), wall)))).length) == 0


def test_no_patch_gets_more_than_all_light() -> None:
    pair = exchange_of(patches(area=100.0), np.eye(4), far())
    assert max(pair.forth.max(), pair.back.max()) <= 1.0


def test_bounces_are_a_series_in_the_albedo() -> None:
    """Light of patch 0 that is lit, of patch 1 that is not: a, a^2 f, a^3 f^2 ... with every way's phase."""
    f, a, waves = 0.3, np.array([0.5, 0.8]), 2.0
    both = Exchange(np.array([0]), np.array([1]), np.array([f]), np.array([f]), np.array([0.5]))
    light = emitted(patches(area=np.pi), both, a, waves)
    first, step = a[0] / 4.0 * np.exp(2.0j * waves), f * np.exp(0.5j * waves)
    assert BOUNCES == 4
    assert light[0] == pytest.approx(first * (1 + a[0] * a[1] * step**2))
    assert light[1] == pytest.approx(first * (a[1] * step + a[0] * a[1] ** 2 * step**3))
