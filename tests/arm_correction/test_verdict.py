# SPDX-License-Identifier: Apache-2.0
"""When a registration is accepted: each bound exactly, on residuals that are given instead of matched."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from arm_correction.bias import bias_covariance
from arm_correction.config import CorrectConfig
from arm_correction.register import Registration, judge
from arm_correction.unknown import Unknown, inflation_of, unknown_directions
from tests.arm_correction.made import twist
from tests.arm_correction.test_unknown import axis_by_axis
from tof_align.robust import tukey
from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float

CONFIG = CorrectConfig()
TRUST = replace(CONFIG.trust, min_pixels=100)
SIGMA_M = 1e-3
STD = np.repeat([SIGMA_M / np.sqrt(40), np.radians(0.03)], 3)
"""Of six axes, each by 40 pixels with `SIGMA_M` (`axis_by_axis`)."""
T = twist((20, -10, 5), (1, 2, -1))


@dataclass
class Given:
    """Stands for a matcher: `seen` points of the view, of which the first 120 meet the reference, with these residuals."""

    e: Float
    seen: int = 240
    std: Float = field(default_factory=lambda: STD)
    config: CorrectConfig = field(default_factory=lambda: replace(CONFIG, trust=TRUST))
    bias: Float | None = None

    @property
    def points(self) -> Float:
        return np.zeros((self.seen, 3))

    def linearise(self, _: Float) -> tuple[Float, Float, Float, Float, Float]:
        _, J, weight, points = axis_by_axis(self.std)
        count = len(self.e)
        return self.e, J[:count], 1.0 / np.sqrt(weight[:count]), np.zeros(count), points[:count]

    def by_bias(self, _: Float) -> Float:
        return np.zeros((len(self.e), 2)) if self.bias is None else self.bias


def said(given: Given, rivalry: float = np.inf) -> Registration:
    matcher: Any = given
    return judge(matcher, T, 1e-3, far=True, rivalry=rivalry)


def residuals(*, off: int = 0, by: float = 0.009, count: int = 120) -> Float:
    """Of `count` residuals of a tenth of a millimetre, `off` that are off by so many metres."""
    e = np.tile([1e-4, -1e-4], 60)[:count].copy()
    e[:off] = by
    return e


def test_what_agrees_is_accepted_with_its_figures() -> None:
    found = said(Given(residuals(off=12)))
    assert found.accepted
    assert found.reason == "ok"
    assert (found.pixels, found.overlap, found.support) == (120, 0.5, 0.9)
    assert found.rms == pytest.approx(1e-4)
    assert found.misfit == 1e-3
    assert found.far
    np.testing.assert_array_equal(found.T_reference_now, T)


def test_the_covariance_is_of_the_pixels_within_the_kernel_and_of_the_bias() -> None:
    e = residuals(off=10, by=5e-3)
    bias = np.stack([np.linspace(0, 1, 120), np.zeros(120)], axis=1)
    given = Given(e, bias=bias)
    _, J, sigma, tilt, points = given.linearise(T)
    weight = tukey(e, 4e-3) / sigma**2
    assert (weight > 0).sum() == 110
    unknown, cov = unknown_directions(e, J, weight, tilt, points, TRUST)
    np.testing.assert_allclose(said(given).cov, cov + bias_covariance(e, J, weight, bias, unknown, inflation_of(e, weight)), rtol=1e-9)
    assert np.trace(said(given).cov) > 1.01 * np.trace(cov)


def test_the_kernel_is_four_robust_scales_where_these_are_large() -> None:
    """Residuals of 2 and of 10 mm: the kernel of 4 x 1.48 x 2 mm keeps both."""
    e = np.tile([2e-3, -2e-3], 60)
    e[:10] *= 5.0
    _, J, sigma, tilt, points = Given(e).linearise(T)
    weight = tukey(e, 4 * 1.4826 * 2e-3) / sigma**2
    np.testing.assert_allclose(said(Given(e)).cov, unknown_directions(e, J, weight, tilt, points, TRUST)[1], rtol=1e-6)


@pytest.mark.parametrize(("count", "accepted"), [(100, True), (99, False)])
def test_pixels_are_enough_or_not(count: int, *, accepted: bool) -> None:
    found = said(Given(residuals(count=count), seen=200))
    assert found.accepted is accepted
    if not accepted:
        assert "only 99 pixels see what the reference sees (at least 100)" in found.reason


@pytest.mark.parametrize(("seen", "accepted"), [(800, True), (801, False)])
def test_overlap_is_enough_or_not(seen: int, *, accepted: bool) -> None:
    found = said(Given(residuals(), seen=seen))
    assert found.overlap == 120 / seen
    assert found.accepted is accepted
    if not accepted:
        assert "15 % of the view lies in the reference (at least 15 %)" in found.reason


@pytest.mark.parametrize(("off", "accepted"), [(30, True), (31, False)])
def test_support_is_enough_or_not(off: int, *, accepted: bool) -> None:
    found = said(Given(residuals(off=off)))
    assert found.support == (120 - off) / 120
    assert found.accepted is accepted
    if not accepted:
        assert "74 % of 120 pixels agree (at least 75 %)" in found.reason


@pytest.mark.parametrize(
    ("sigma_mm", "off_mm", "agrees"),
    [
        (0.1, 2.9, True),
        (0.1, 3.1, False),
        (1.0, 3.9, True),
        (1.0, 4.1, False),
        (5.0, 7.9, True),
        (5.0, -7.9, True),
        (5.0, 8.1, False),
        (5.0, -8.1, False),
    ],
)
def test_agreeing_is_within_four_sigmas_between_three_and_eight_millimetres(sigma_mm: float, off_mm: float, *, agrees: bool) -> None:
    found = said(Given(residuals(off=10, by=1e-3 * off_mm), std=sigma_mm * STD))
    assert found.support == (1.0 if agrees else 110 / 120)


@pytest.mark.parametrize(("by", "support", "overlap"), [(-0.0249, 80 / 120, 0.5), (-0.0251, 1.0, 1 / 3)])
def test_what_was_hidden_neither_agrees_nor_overlaps(by: float, support: float, overlap: float) -> None:
    found = said(Given(residuals(off=40, by=by)))
    assert found.support == pytest.approx(support)
    assert found.overlap == pytest.approx(overlap)


def test_where_all_was_hidden_nothing_is_known() -> None:
    found = said(Given(np.full(120, -0.5)))
    assert found.support == found.overlap == 0.0
    assert np.isnan(found.rms)
    assert not found.accepted


def test_an_open_direction_is_not_moved_along() -> None:
    """Sliding along x is known to 3 mm only (a tenth of the stated variance shows): the motion loses its 20 mm, the other five stay."""
    std = STD.copy()
    std[0] = 10e-3
    found = said(Given(residuals(), std=std))
    assert found.accepted
    assert found.unknown.names == ("slides along camera x",)
    before, after = se3.log(T), se3.log(found.T_reference_now)
    assert after[0] == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(after[1:], before[1:], atol=2e-3)


@pytest.mark.parametrize(("count", "rank"), [(30, 6), (29, 0)])
def test_of_fewer_than_thirty_pixels_nothing_is_determined(count: int, rank: int) -> None:
    """The others are beyond the kernel, and agree: 3.9 mm with a sigma of 1 mm, where neighbours are 0.1 mm off."""
    config = replace(CONFIG, trust=replace(TRUST, known_mm=1e4, known_deg=180.0, min_support=0.0))
    e = np.full(120, 0.5)
    e[np.linspace(0, 119, count).astype(int)] = 1e-4
    found = said(Given(e, config=replace(config, register=replace(config.register, kernel=1e-3))))
    assert found.unknown.rank == rank
    assert found.accepted is (rank == 6)
    if rank == 0:
        assert found.reason == "no direction is determined"
        np.testing.assert_array_equal(found.cov, np.eye(6))
        assert found.unknown.names == Unknown.all_().names


@pytest.mark.parametrize(("rivalry", "open_mm", "accepted"), [(1.15, 0.2, True), (1.149, 0.2, False), (1.149, 10.0, True)])
def test_another_pose_that_fits_as_well_makes_it_ambiguous_where_all_is_determined(
    rivalry: float, open_mm: float, *, accepted: bool
) -> None:
    std = STD.copy()
    std[0] = 1e-3 * open_mm
    found = said(Given(residuals(), std=std), rivalry)
    assert found.accepted is accepted
    if not accepted:
        assert "ambiguous: another pose fits nearly as well (its misfit is 1.15 times as large" in found.reason
