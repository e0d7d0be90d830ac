# SPDX-License-Identifier: Apache-2.0
"""Depth as evidence, pixel by pixel: likelihoods against a Gaussian written out, and which pixels are weighed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pytest
from scipy.stats import norm

from tests.tof_inspect.made import SURE, as_built, plate, seen
from tof_inspect.config import InspectConfig
from tof_inspect.evidence import Ratios, _clearest, _log_likelihood, _together, eroded, log_amplitude, render_at, see, weigh
from tof_inspect.shared import PosesAlone
from tof_inspect.without import Split
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_inspect.evidence import Evidence

CONFIG = InspectConfig(outliers=0.05, wide_m=0.3, cell_px=6)


@pytest.mark.parametrize(("error", "sigma"), [(0.0, 1e-3), (2e-3, 1e-3), (-2e-3, 1e-3), (5e-3, 4e-3), (0.2, 1e-3)])
def test_a_pixel_s_likelihood_is_a_gaussian_beside_outliers(error: float, sigma: float) -> None:
    expected = np.log(0.95 * norm.pdf(error, scale=sigma) + 0.05 / 0.3)
    assert _log_likelihood(np.array([error]), np.array([sigma]), CONFIG) == pytest.approx(expected)


def test_pixels_of_a_cell_count_as_the_root_of_their_number() -> None:
    """An image 20 wide: cells of 6 x 6; four pixels in the first, one in each of two others."""
    index = np.array([0, 5, 20, 5 * 20 + 5, 6, 6 * 20])
    ratio = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 7.0])
    assert _together(ratio, index, 20, CONFIG) == pytest.approx(10 / np.sqrt(4) + 5 + 7)
    assert _together(ratio[:0], index[:0], 20, CONFIG) == 0.0


@pytest.mark.parametrize(
    ("depth", "colour", "moved", "expected"), [(3.0, -1.0, -9.0, (3.0, 2.0)), (3.0, -1.0, 2.5, (3.0, 2.5)), (-3.0, 9.0, 1.0, (1.0, 6.0))]
)
def test_colour_is_evidence_for_the_place_in_the_cad_alone(
    depth: float, colour: float, moved: float, expected: tuple[float, float]
) -> None:
    ratios = Ratios.of(depth, colour, moved)
    assert (ratios.depth, ratios.colour, ratios.fused) == (expected[0], colour, expected[1])


def test_the_first_choice_with_twenty_pixels_is_weighed_or_the_last() -> None:
    few, enough, all_ = (np.arange(100).reshape(10, 10) < n for n in (19, 20, 60))
    np.testing.assert_array_equal(_clearest([few, enough, all_]), np.arange(20))
    np.testing.assert_array_equal(_clearest([few, all_]), np.arange(60))
    np.testing.assert_array_equal(_clearest([all_, few]), np.arange(60))
    np.testing.assert_array_equal(_clearest([few, few & False]), [])
    np.testing.assert_array_equal(_clearest([few, few & False, few]), np.arange(19))


def test_the_outermost_ring_is_left_out() -> None:
    mask = np.zeros((6, 6), bool)
    mask[1:5, 1:5] = True
    assert np.argwhere(eroded(mask)).tolist() == [[2, 2], [2, 3], [3, 2], [3, 3]]


def test_amplitude_is_taken_as_its_logarithm_where_it_is_known() -> None:
    view = replace(seen(plate()), amplitude=None)
    assert np.isnan(log_amplitude(view, np.array([3, 4]))).all()
    amplitude = np.zeros(view.depth.shape, np.float32)
    amplitude.flat[:4] = 1.0, 20.0, 0.0, -3.0
    np.testing.assert_allclose(log_amplitude(replace(view, amplitude=amplitude), np.array([1, 0, 2, 3])), [np.log(20), 0, np.nan, np.nan])


def weighed(changes: Any = None, config: InspectConfig = CONFIG, name: str = "block", measured: Any = None) -> tuple[Evidence, Any]:
    """Evidence of one part of the plate in a view that measures what was built (default: the CAD) without noise, and the view."""
    scene = plate()
    caster = Raycaster(scene)
    view = seen(measured or scene, noise_mm=1e-6)
    view = replace(view, sigma=np.full(view.depth.shape, 1e-3, np.float32))
    made = see(view if changes is None else changes(view), SURE, caster, config, 3)
    return weigh(made, Split(scene).without(scene.index(name)), scene.index(name), config, PosesAlone([SURE] * 4)), made


def test_evidence_is_positive_for_a_present_part_and_negative_for_an_absent_one() -> None:
    there, made = weighed()
    gone, _ = weighed(measured=as_built(plate(), gone=("block",)))
    assert there.log_ratio > 20.0
    assert gone.log_ratio < -20.0
    index = plate().index("block")
    assert there.covered == gone.covered == (made.whole.part == index).sum()
    assert 0 < len(there.index) < there.pixels <= there.covered
    assert (made.whole.part.ravel()[there.index] == index).all()
    np.testing.assert_allclose(there.measured, there.present, atol=2e-3)
    np.testing.assert_allclose(gone.measured, gone.absent, atol=2e-3)
    np.testing.assert_array_equal(there.present, made.whole.depth.ravel()[there.index])


def test_the_ratio_is_the_sum_over_cells_of_log_likelihoods() -> None:
    found, made = weighed()
    np.testing.assert_allclose(found.sigma, np.hypot(made.sigma.ravel()[found.index], 1e-3))
    each = [_log_likelihood(found.measured - depth.astype(float), found.sigma, CONFIG) for depth in (found.present, found.absent)]
    assert found.log_ratio == pytest.approx(_together(each[0] - each[1], found.index, 160, CONFIG))


def test_pixels_weighed_are_inner_clear_and_stand_out() -> None:
    found, made = weighed()
    whole = made.whole
    gap = np.abs(found.present - found.absent)
    assert (gap > CONFIG.stand_out * found.sigma).all()
    assert (whole.mixed.ravel()[found.index] <= CONFIG.mixed).all()
    assert (whole.incidence.ravel()[found.index] < np.radians(CONFIG.grazing_deg)).all()
    assert eroded(whole.part == plate().index("block")).ravel()[found.index].all()


def test_the_distinctive_pixels_differ_by_three_of_the_measured_sigmas() -> None:
    """The block stands 30 mm before the wall: with a sigma above a third of the gap along z none is distinctive."""
    found, _ = weighed()
    gap = np.abs(found.present - found.absent)
    for sigma, some in ((gap.min() / 3.05, True), (gap.max() * 2, False)):
        pixels = weighed(lambda v, s=sigma: replace(v, sigma=np.full(v.depth.shape, s, np.float32)))[0].pixels
        assert (pixels >= len(found.index)) is some
        assert (pixels > 0) is some


def test_pixels_without_a_depth_are_no_evidence() -> None:
    def blind(view: Any) -> Any:
        depth = view.depth.copy()
        depth[:, :] = np.nan
        return replace(view, depth=depth, reason=np.ones(depth.shape, np.uint8))

    found, _ = weighed(blind)
    assert (found.pixels, len(found.index), found.log_ratio) == (0, 0, 0.0)
    assert found.covered > 100


class Biased(PosesAlone):
    """The camera is known to measure 5 mm too far along z in view 3; its columns are functions of the distance along the ray."""

    radial: ClassVar[list[Float]] = []

    def columns(self, view: int, radial: Float, log_amplitude: Float, index: Any) -> Float:
        assert np.isnan(log_amplitude).all()
        self.radial.append(radial)
        return np.zeros((len(index), 0))

    def bias(self, view: int, columns: Float) -> Float:
        assert view == 3
        return np.full(len(columns), 5e-3)


def test_the_known_error_of_the_camera_is_taken_off() -> None:
    scene = plate()
    plain, made = weighed()
    index = scene.index("block")
    found = weigh(made, Split(scene).without(index), index, CONFIG, Biased([SURE] * 4))
    np.testing.assert_allclose(Biased.radial[-1], plain.measured * made.view.camera.ray_length().ravel()[plain.index], rtol=1e-6)
    np.testing.assert_allclose(found.measured, plain.measured - 5e-3, atol=1e-9)


def test_the_scene_without_a_part_is_seen_at_its_pixels_alone() -> None:
    scene = plate()
    without, made = Split(scene).without(scene.index("block")), weighed()[1]
    where = made.whole.part == scene.index("block")
    z = render_at(without, made.view.camera, SURE.T_cell_camera, where)
    assert np.isfinite(z[where]).all()
    assert np.isnan(z[~where]).all()
    wall = seen(as_built(scene, gone=("block",)), noise_mm=0.0).depth
    np.testing.assert_allclose(z[where], wall[where], atol=2e-3)
    assert np.isnan(render_at(without, made.view.camera, SURE.T_cell_camera, where & False)).all()


def test_sigma_grows_with_the_footprint_on_slanted_surfaces() -> None:
    """Three tenths of a pixel, tangent of the incidence: beside noise and a pose that is known exactly."""
    scene = plate()
    view = seen(scene)
    made = see(view, replace(SURE, cov=np.zeros((6, 6))), Raycaster(scene), CONFIG)
    footprint = 0.3 * view.camera.pixel_angle * made.whole.depth * np.tan(np.minimum(made.whole.incidence, np.radians(85.0)))
    known = np.isfinite(made.whole.depth) & np.isfinite(made.noise)
    np.testing.assert_allclose(made.sigma[known], np.hypot(made.noise, footprint)[known], rtol=1e-6)
