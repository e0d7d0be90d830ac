# SPDX-License-Identifier: Apache-2.0
"""Noise of two sessions of which one has no amplitude image: it is compared as the captures of dwells differ, or not at all."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from tests.tof_gap.diagnosed import compared, diagnosis, only
from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.compare.difference import LACKS, STRONG, WEAK
from tof_gap.compare.levels import Level
from tof_gap.compare.noise import made_by
from tof_sensor.effects.photon_law import PhotonLaw

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence

CAPTURES = 5


@pytest.fixture(scope="module")
def evidence() -> tuple[ViewEvidence, ...]:
    """Views of a plane with photon noise."""
    return views(np.random.default_rng(3))


def dwells(evidence: tuple[ViewEvidence, ...], noise_m: float, *, light: bool = True) -> tuple[ViewEvidence, ...]:
    """Five captures of each stop whose depths along the ray differ by `noise_m`; without `light` there is no amplitude image."""
    out = []
    for v in evidence:
        sigma = (noise_m / np.sqrt(CAPTURES) / v.frame.length).astype(np.float32)
        count = np.full(SHAPE, CAPTURES, np.uint16)
        seen = replace(v.view, sigma=sigma, count=count, captures=CAPTURES, amplitude=v.view.amplitude if light else None)
        amplitude = v.frame.amplitude if light else v.frame.amplitude / 2000.0  # Of the CAD's albedo, in a unit of its own.
        out.append(replace(v, view=seen, sigma=sigma, frame=replace(v.frame, amplitude=cast("Any", amplitude))))
    return tuple(out)


@pytest.mark.parametrize(
    ("noise_m", "verdict", "manner"), [(0.004, "noise", STRONG), (0.0029, "none", ""), (0.0015, "noise", WEAK), (0.0001, "noise", LACKS)]
)
def test_noise_without_an_amplitude_image_is_compared_by_captures(
    evidence: tuple[ViewEvidence, ...], noise_m: float, verdict: str, manner: str
) -> None:
    """The law of the camera's amplitude would give a simulator of albedo 1 a noise of zero."""
    law = PhotonLaw(floor_m=0.0, shot_m=0.0028, reference=2000.0)
    found = compared(diagnosis(dwells(evidence, 0.0028), law=law), diagnosis(dwells(evidence, noise_m, light=False)))
    assert found.verdict == (verdict,)
    assert [d.simulator for d in found.differences] == ([manner] if manner else [])
    if manner:
        assert (only(found).real_mm, only(found).simulated_mm) == pytest.approx((2.8, 1e3 * noise_m), rel=0.01)
    if manner == STRONG:
        assert only(found).todo == "give noise 0.7 times its size in the simulator"


def test_noise_of_single_captures_without_an_amplitude_image_is_not_comparable(evidence: tuple[ViewEvidence, ...]) -> None:
    """A simulator whose physics stand still gives one frame a stop."""
    still = tuple(replace(v, view=replace(v.view, amplitude=None)) for v in evidence)
    found = compared(diagnosis(dwells(evidence, 0.0028)), diagnosis(still))
    assert found.verdict == ("none",)
    assert "noise" in found.to_dict()["not_testable"]
    assert found.lines()[-1].startswith(
        "not testable in the simulator's bag: noise (no amplitude image in the simulator's bag, and one capture a stop in the simulator's: two captures"
    )


def test_noise_of_two_bags_without_amplitude_images_shares_the_law_of_the_albedo(evidence: tuple[ViewEvidence, ...]) -> None:
    dark = tuple(replace(v, view=replace(v.view, amplitude=None)) for v in evidence)
    found = compared(diagnosis(dark), diagnosis(tuple(replace(v, sigma=2.0 * v.sigma) for v in dark)))
    assert (found.verdict, only(found).simulator, found.not_testable) == (("noise",), STRONG, {})


@pytest.mark.parametrize(
    ("noise_mm", "wave_mm", "light", "made"),
    [
        ((1.67, 2.65), (0.0, 3.8), 0.56, True),
        ((3.61, 2.11), (4.7, 0.0), 2.0, True),
        ((1.67, 2.65), (0.0, 3.8), 0.7, False),
        ((1.67, 2.65), (0.0, 3.8), 1.8, False),
        ((2.65, 1.67), (0.0, 3.8), 0.56, False),
    ],
    ids=[
        "simulator's wave",
        "camera's wave",
        "noise grows by more than amplitude falls",
        "noisier and brighter",
        "noisier without the wave",
    ],
)
def test_a_wave_whose_camera_has_less_amplitude_makes_as_much_more_noise(
    noise_mm: tuple[float, float], wave_mm: tuple[float, float], light: float, *, made: bool
) -> None:
    """A lamp that is on for too long weakens the modulation of its light: less amplitude, and noise in proportion."""
    noise = Level("noise", *noise_mm, {}, (True, True))
    wave = cast("Any", SimpleNamespace(effect="wiggling", real_mm=wave_mm[0], simulated_mm=wave_mm[1]))
    session = cast("Any", SimpleNamespace(findings=()))
    pair = cast("Any", SimpleNamespace(real=session, light=light))
    assert made_by(noise, pair, session, [wave]) is made
    assert not made_by(noise, pair, session, []), "without a wave, amplitude says nothing about noise"
