# SPDX-License-Identifier: Apache-2.0
"""A step between two walls, mixed by light, by a lens out of focus, or by a filter over neighbours."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter

from tests.tof_gap.quiet_views import SHAPE
from tests.tof_gap.two_walls import mean, session
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.missing.effects import missing_effects
from tof_gap.seen.missing.smeared import mixed_afar, smeared

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS = MissingLimits()


def within(depth: Float) -> Float:
    """A mean over 5 x 5 pixels that stops at edges: of what lies within 5 cm of the pixel."""
    padded = np.pad(depth, 2, mode="edge")
    around = np.stack([padded[i : i + SHAPE[0], j : j + SHAPE[1]] for i in range(5) for j in range(5)])
    return np.asarray(np.nanmean(np.where(np.abs(around - depth) < 0.05, around, np.nan), axis=0))


def unfocused(depth: Float) -> Float:
    """Behind a lens whose blur has a deviation of four pixels."""
    return np.asarray(gaussian_filter(depth, (0, 4.0), mode="nearest"))


def names(seen: tuple[ViewEvidence, ...]) -> list[str]:
    return [f.name for f in missing_effects(seen, LIMITS)]


def test_light_that_mixes_in_the_pixels_of_an_edge_is_flying_pixels() -> None:
    seen = session()
    assert mixed_afar(seen, LIMITS) == 0.0
    assert not seen[0].correlation.correlated
    assert names(seen) == ["flying_pixels"]


def test_a_filter_that_smears_edges_is_no_flying_pixels() -> None:
    seen = session(firmware=mean)
    assert mixed_afar(seen, LIMITS) == 1.0, "two pixels from the edge the window holds a whole column of the other wall, and two mixed ones"
    assert seen[0].correlation.growth > 1.5
    assert smeared(seen, LIMITS)
    assert names(seen) == []


def test_a_filter_that_stops_at_edges_leaves_flying_pixels() -> None:
    seen = session(firmware=within)
    assert mixed_afar(seen, LIMITS) == 0.0
    assert seen[0].correlation.correlated
    assert names(seen) == ["flying_pixels"]


def test_a_lens_out_of_focus_mixes_as_far_as_a_filter_and_leaves_the_noise_of_each_pixel_its_own() -> None:
    seen = session(light=unfocused)
    assert mixed_afar(seen, LIMITS) == 1.0
    assert not seen[0].correlation.correlated
    assert names(seen) == ["flying_pixels"]


def test_an_edge_that_is_hardly_seen_says_nothing() -> None:
    seen = session(firmware=mean)[:1]
    few = tuple(replace(v, residual=np.where(np.arange(SHAPE[0])[:, None] < 30, v.residual, np.nan)) for v in seen)
    assert mixed_afar(few, LIMITS) == 0.0
