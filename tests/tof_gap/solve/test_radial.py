# SPDX-License-Identifier: Apache-2.0
"""Depth or distance along the ray: the reading that lies on the CAD is believed, where the difference is one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, chain, rendering, views
from tof_align.config import AlignConfig
from tof_core.config import updated
from tof_gap.config import GapConfig
from tof_gap.limits.evidence import EvidenceLimits
from tof_gap.seen.evidence.residual import gather
from tof_gap.solve import radial
from tof_gap.solve.start import Start

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.capture import View

CONFIG, ALIGN = GapConfig(), AlignConfig()


def recorded(*, along_ray: bool) -> list[View]:
    """Views of a plane at 0.9 m and beyond, their image holding depth or distance along the ray."""
    taken = [v.view for v in views(np.random.default_rng(1))]
    factor = CAMERA.ray_length().astype(np.float32) if along_ray else np.float32(1.0)
    return [replace(v, depth=v.depth * factor) for v in taken]


@pytest.fixture(autouse=True)
def poses_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """First poses are the true ones, so that the gate alone is tested."""
    place = {v.view.stamp_ns: 0.05 * k for k, v in enumerate(views(np.random.default_rng(1)))}

    def start(seen: Sequence[View], *_: Any) -> Start:
        renderings = [rendering(place[v.stamp_ns]) for v in seen]
        return Start(list(seen), chain(), gather(list(seen), renderings, None, EvidenceLimits(edge_px=0)))  # type: ignore[arg-type]

    monkeypatch.setattr(radial, "start", start)


def test_depth_is_left_as_it_is() -> None:
    begun, found = radial.gate(recorded(along_ray=False), None, CONFIG, ALIGN)  # type: ignore[arg-type]
    assert found is None
    assert radial.median_miss(begun.evidence) < 0.004


def test_distance_along_the_ray_is_named_with_what_it_adds() -> None:
    begun, found = radial.gate(recorded(along_ray=True), None, CONFIG, ALIGN)  # type: ignore[arg-type]
    assert found is not None
    assert (found.name, found.confidence, found.corrects) == ("radial_depth", 1.0, True)
    assert found.share is not None
    np.testing.assert_allclose(found.share[0], rendering(0.0).depth * (CAMERA.ray_length() - 1.0), atol=0.02)
    assert radial.median_miss(begun.evidence) < 0.004


@pytest.mark.parametrize(("least_mm", "named"), [(4.0, True), (500.0, False)])
def test_a_small_miss_is_no_reason_to_read_it_otherwise(least_mm: float, *, named: bool) -> None:
    config = updated(CONFIG, {"solve.gate.least_mm": least_mm})
    assert (radial.gate(recorded(along_ray=True), None, config, ALIGN)[1] is not None) is named  # type: ignore[arg-type]


def test_the_other_reading_must_be_clearly_better(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(radial, "_bends", lambda _: False)
    config = updated(CONFIG, {"solve.gate.better": 0.0})
    assert radial.gate(recorded(along_ray=True), None, config, ALIGN)[1] is None  # type: ignore[arg-type]
    monkeypatch.setattr(radial, "_bends", lambda _: True)
    assert radial.gate(recorded(along_ray=True), None, config, ALIGN)[1] is not None, "all wide planes bend"  # type: ignore[arg-type]


def test_the_miss_is_the_median_residual_away_from_edges() -> None:
    (seen, *_) = views(np.random.default_rng(1))
    edge = np.zeros(SHAPE, bool)
    edge[:, :40] = True
    residual = np.where(edge, 1.0, -0.003)
    assert radial.median_miss([replace(seen, residual=residual, edge=edge)]) == pytest.approx(0.003)
    assert radial.median_miss([replace(seen, residual=np.full(SHAPE, np.nan))]) == 0.0


@pytest.mark.parametrize("step_m", [0.001, 0.0])
def test_a_converted_view_keeps_the_camera_s_codes(step_m: float) -> None:
    """Millimetres along the ray are no millimetres of depth, yet the noise lies between them."""
    coded = [
        replace(v, depth=(step_m * np.rint(v.depth / step_m)).astype(np.float32) if step_m else v.depth) for v in recorded(along_ray=True)
    ]
    begun, found = radial.gate(coded, None, CONFIG, ALIGN)  # type: ignore[arg-type]
    assert found is not None
    np.testing.assert_allclose([e.step_m for e in begun.evidence], step_m, atol=1e-6)


def test_the_deviations_of_the_captures_are_converted_with_their_mean() -> None:
    length = CAMERA.ray_length().astype(np.float32)
    taken = [replace(v, sigma=0.002 * length, noise=0.004 * length) for v in recorded(along_ray=True)]
    begun, _ = radial.gate(taken, None, CONFIG, ALIGN)  # type: ignore[arg-type]
    for v in begun.views:
        assert v.noise is not None
        np.testing.assert_allclose(v.sigma, 0.002, rtol=1e-5)
        np.testing.assert_allclose(v.noise, 0.004, rtol=1e-5)
