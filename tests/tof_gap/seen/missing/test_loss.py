# SPDX-License-Identifier: Apache-2.0
"""Lost pixels go with weak light, with a limit of range, with parts, or with none of these; the remedy is that of each."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest

from tof_gap.limits.missing import LossLimits
from tof_gap.seen.missing.loss import REMEDY, GoesWith, Loss, balanced, curve, loss_of, lower

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints, Mask

N, PARTS = 20_000, 5
THRESHOLD = 60.0


class Pixels(NamedTuple):
    """Pixels of a session: amplitude of the image, the CAD's light and range, and the part."""

    amplitude: Float
    light: Float
    radial: Float
    part: Ints

    def loss(self, lost: Mask | Float) -> Loss:
        """What `lost` (n,) goes with."""
        return loss_of(np.asarray(lost, float), self.amplitude, self.light, self.radial, self.part, LossLimits())


@pytest.fixture(scope="module")
def pixels() -> Pixels:
    """Five parts of different albedo at 0.5 to 3 m; the image's amplitude is the CAD's light times 0.8 to 1.2."""
    rng = np.random.default_rng(2)
    part, radial = rng.integers(0, PARTS, N), rng.uniform(0.5, 3.0, N)
    light = 1000.0 * np.linspace(0.3, 0.9, PARTS)[part] * rng.uniform(0.5, 1.0, N) / radial**2
    return Pixels(light * rng.uniform(0.8, 1.2, N), light, radial, part)


def test_a_threshold_of_amplitude_is_found_with_its_value(pixels: Pixels) -> None:
    lost = pixels.amplitude < THRESHOLD
    found = pixels.loss(lost)
    assert found.goes_with is GoesWith.LIGHT
    assert found.amplitude == pytest.approx(THRESHOLD, rel=0.01)
    assert found.of_median == pytest.approx(THRESHOLD / np.median(pixels.amplitude), rel=0.01)
    assert found.share == pytest.approx(lost.mean())
    assert f"below amplitude {found.amplitude:.3g}" in found.size
    assert "by design" in found.remedy


def test_pixels_that_are_too_bright_are_told_from_those_of_weak_light(pixels: Pixels) -> None:
    limit = float(np.quantile(pixels.light, 0.96))
    found = pixels.loss(pixels.light > limit)
    assert found.goes_with is GoesWith.STRONG_LIGHT
    assert found.of_median == pytest.approx(limit / np.median(pixels.light), rel=0.01)
    assert found.size == f"4 % of the pixels, those of strong light: above {found.of_median:.2g} times the median light"
    assert found.remedy.startswith("shorten the exposure")


@pytest.mark.parametrize("of_lost", [np.nan, 0.0], ids=["no image", "0 where lost"])
def test_where_lost_pixels_have_no_amplitude_the_light_of_the_cad_decides(pixels: Pixels, of_lost: float) -> None:
    lost = pixels.amplitude < THRESHOLD
    found = pixels._replace(amplitude=np.where(lost, of_lost, pixels.amplitude)).loss(lost)
    assert found.goes_with is GoesWith.LIGHT
    assert np.isnan(found.amplitude)
    assert found.of_median == pytest.approx(THRESHOLD / np.median(pixels.light), rel=0.05)
    assert found.size.endswith("% of the median light")


@pytest.mark.parametrize(("beyond", "at_m", "words"), [(True, 2.5, "farther than 2.5"), (False, 0.7, "nearer than 0.7")])
def test_a_measuring_range_that_ends_is_found_with_its_limit(pixels: Pixels, at_m: float, words: str, *, beyond: bool) -> None:
    bright = pixels._replace(amplitude=np.full(N, np.nan))
    found = bright.loss(pixels.radial > at_m if beyond else pixels.radial < at_m)
    assert found.goes_with is GoesWith.RANGE
    assert found.beyond is beyond
    assert found.range_m == pytest.approx(at_m, abs=0.01)
    assert words in found.size
    assert "measuring range" in found.remedy


def test_a_part_that_is_lost_though_its_light_would_do_is_named(pixels: Pixels) -> None:
    lost = (pixels.part == 3) & (np.random.default_rng(4).random(N) < 0.4)
    found = pixels.loss(lost)
    assert (found.goes_with, found.parts, found.weak) == (GoesWith.PARTS, (3,), False)
    assert found.size == "40 % of the pixels of these parts, 8 % of all"
    assert "look at the surface" in found.remedy
    dark = pixels._replace(amplitude=np.where(lost, 1.0, pixels.amplitude)).loss(lost)
    assert (dark.goes_with, dark.weak) == (GoesWith.PARTS, True)
    assert dark.size.endswith(", which return less light than their albedo in scene.yaml says")
    assert 1.0 < dark.amplitude < pixels.amplitude.min(), "all lost pixels are darker than all measured ones"


def test_what_is_lost_at_random_goes_with_nothing(pixels: Pixels) -> None:
    found = pixels.loss(np.random.default_rng(5).random(N) < 0.05)
    assert found.goes_with is GoesWith.NOTHING
    assert (found.size, found.remedy) == ("", "")


def test_some_captures_of_a_dwell_count_by_their_share(pixels: Pixels) -> None:
    lost = np.random.default_rng(6).binomial(6, np.where(pixels.amplitude < THRESHOLD, 1.0, 0.0)) / 6
    assert pixels.loss(lost).goes_with is GoesWith.LIGHT


def test_the_chance_is_that_of_a_pair_of_one_lost_and_one_measured_pixel() -> None:
    values, gone = np.array([1.0, 2.0, 2.0, 4.0]), np.array([1.0, 1.0, 0.0, 0.0])
    assert lower(values, gone) == pytest.approx((1 + 1 + 0.5 + 1) / 4)
    assert balanced(np.arange(101.0), np.r_[np.ones(25), np.zeros(75)]) == pytest.approx(25.0)


def test_every_remedy_is_of_a_cause_and_each_is_different() -> None:
    assert set(REMEDY) == set(GoesWith) - {GoesWith.NOTHING}
    assert len(set(REMEDY.values())) == len(REMEDY)


@pytest.mark.parametrize("steepness", [4.0, 13.0, 50.0])
def test_the_curve_of_loss_is_that_of_which_the_pixels_were_drawn(pixels: Pixels, steepness: float) -> None:
    lost = np.random.default_rng(7).random(N) < 1 / (1 + (pixels.light / THRESHOLD) ** steepness)
    threshold, found = curve(pixels.light, lost.astype(float))
    assert threshold == pytest.approx(THRESHOLD, rel=0.03)
    assert found == steepness
    assert np.mean(1 / (1 + (pixels.light / threshold) ** found)) == pytest.approx(lost.mean(), rel=0.02)


def test_a_curve_loses_as_many_pixels_as_were_lost_though_the_light_of_the_cad_is_rough(pixels: Pixels) -> None:
    lost = (pixels.amplitude < THRESHOLD).astype(float)
    threshold, steepness = curve(pixels.light, lost)
    assert np.mean(1 / (1 + (pixels.light / threshold) ** steepness)) == pytest.approx(lost.mean(), rel=0.02)


@pytest.mark.parametrize(("of_median", "limit"), [(0.07, "7 % of the median light"), (7.11, "7.1 times the median light")])
def test_a_limit_above_the_median_is_stated_as_a_multiple(of_median: float, limit: str) -> None:
    assert Loss(GoesWith.LIGHT, 0.3, of_median=of_median).size == f"30 % of the pixels, those of weak light: below {limit}"
