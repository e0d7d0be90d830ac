# SPDX-License-Identifier: Apache-2.0
"""The map of an effect that moves the camera: rendered from there, to first order where another surface comes into view."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from tests.tof_gap.quiet_views import SHAPE, chain, views
from tof_gap.seen.rendered import rendered_bias
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.hand_eye import HandEye

if TYPE_CHECKING:
    import pytest

MOVED, RENDERED_M, OTHER_M = HandEye(z_m=0.010), -0.012, 0.020
SURFACE, PART = (slice(0, 9), slice(None)), (slice(9, 20), slice(None))
"""Where another surface, 0.3 m nearer, and where another part is seen from there."""
BESIDE = 2
"""Pixels at either side of an edge where half a pixel of a fit decides."""


def test_a_camera_off_its_mount_is_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    view, asked = views(np.random.default_rng(0))[2], list[np.ndarray]()

    def render(_caster: object, _camera: object, T: np.ndarray, *, footprints: bool) -> object:
        assert not footprints
        asked.append(T)
        depth, part = view.frame.depth + RENDERED_M, view.rendering.part.copy()
        depth[SURFACE] -= 0.3
        part[PART] = 1
        return SimpleNamespace(depth=depth, part=part)

    monkeypatch.setattr("tof_gap.seen.rendered.render", render)
    linear = MOVED.bias(view.frame)
    found = rendered_bias(MOVED, view, 2, chain(), cast("Any", None), OTHER_M)
    np.testing.assert_allclose(asked[0][:3, 3], [0.0, 0.0, 0.010], atol=1e-12)
    for beside in (slice(9 - BESIDE, 9 + BESIDE), slice(20 - BESIDE, 20)):
        np.testing.assert_array_equal(found[beside], linear[beside])
    np.testing.assert_allclose(found[: 9 - BESIDE], RENDERED_M - 0.3, atol=1e-6)  # Away from edges, the other surface is what is measured.
    np.testing.assert_allclose(found[9 + BESIDE : 20 - BESIDE], RENDERED_M, atol=1e-6)
    np.testing.assert_allclose(found[20:], RENDERED_M, atol=1e-6)


def test_an_effect_that_leaves_the_camera_where_it_is_needs_no_rendering() -> None:
    view = views(np.random.default_rng(0))[0]
    found = rendered_bias(DepthScale(0.01), view, 0, chain(), cast("Any", None), OTHER_M)
    np.testing.assert_array_equal(found, DepthScale(0.01).bias(view.frame))
    assert found.shape == SHAPE
