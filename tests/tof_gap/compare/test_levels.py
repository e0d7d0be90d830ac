# SPDX-License-Identifier: Apache-2.0
"""A simulator against a camera where no mean depth shows the difference: noise, lost, wrapped and mixed pixels."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.diagnosed import HELD, LAW, compared, diagnosis, only
from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.compare.against import against
from tof_gap.compare.difference import LACKS, STRONG, SUPERFLUOUS, WEAK
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.fixed_pattern import FixedPattern, packed
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.quantization import Quantization
from tof_sensor.model import SensorModel

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis


@pytest.fixture(scope="module")
def evidence() -> tuple[ViewEvidence, ...]:
    """Views of a plane with photon noise."""
    return views(np.random.default_rng(3))


def noisier(evidence: tuple[ViewEvidence, ...], times: float) -> tuple[ViewEvidence, ...]:
    return tuple(replace(v, sigma=times * v.sigma) for v in evidence)


def test_noise_is_compared_as_it_was_measured_in_either_session(evidence: tuple[ViewEvidence, ...]) -> None:
    real = diagnosis(evidence)
    found = compared(real, diagnosis(noisier(evidence, 2.0)))
    assert (found.verdict, only(found).simulator) == (("noise",), STRONG)
    assert only(found).simulated_mm == pytest.approx(2.0 * only(found).real_mm)
    assert compared(real, diagnosis(noisier(evidence, 1.15))).verdict == ("none",)
    assert compared(diagnosis(noisier(evidence, 2.0)), real).differences[0].simulator == WEAK


def test_offsets_of_a_fixed_pattern_are_no_noise(evidence: tuple[ViewEvidence, ...]) -> None:
    """Differences of neighbours take them for noise; figures hold the noise of the held-out views without the pattern."""
    pattern = FixedPattern(pixels=packed(np.random.default_rng(0).normal(0.0, 0.0030, SHAPE)))
    one, other = diagnosis(evidence, pattern), diagnosis(noisier(evidence, 3.0), pattern)
    assert compared(one, other).verdict == ("noise",)
    object.__setattr__(other.account.figures, "noise2", {v: evidence[v].sigma ** 2 for v in HELD})
    assert compared(one, other).verdict == ("none",)


def test_two_laws_of_one_noise_are_no_difference(evidence: tuple[ViewEvidence, ...]) -> None:
    """Laws fitted at other amplitudes differ where they are extrapolated."""
    other = PhotonLaw(shot_m=0.008, floor_m=0.0, reference=2000.0)
    assert compared(diagnosis(evidence), diagnosis(evidence, law=other)).verdict == ("none",)


def test_more_noise_has_the_name_of_the_noise_that_was_found(evidence: tuple[ViewEvidence, ...]) -> None:
    light = Ambient(uniform_m=0.006, reference=2000.0)
    found = compared(diagnosis(noisier(evidence, 2.0), light), diagnosis(evidence))
    assert (found.verdict, only(found).simulator) == (("ambient",), LACKS)
    assert compared(diagnosis(evidence, light), diagnosis(evidence)).verdict == ("none",)


@pytest.mark.parametrize(
    ("lit", "shares", "verdict", "manner"),
    [((1.20, 1.45), "both", "ambient", STRONG), ((1.20, 1.45), "noise", "none", ""), ((1.35, 1.45), "both", "none", "")],
)
def test_foreign_light_is_compared_beyond_the_law_of_the_cameras_own_noise(
    evidence: tuple[ViewEvidence, ...], lit: tuple[float, float], shares: str, verdict: str, manner: str
) -> None:
    """1.20 and 1.45 times the law differ by less than two noises do; beyond the law the variance is 0.44 and 1.10 of it."""
    light = [Ambient(uniform_m=0.003, reference=2000.0)] if shares == "both" else []
    dim, bright = (diagnosis(noisier(evidence, times), *named) for times, named in zip(lit, ([], light), strict=True))
    found = against(dim, bright, ("panel",), known=SensorModel((LAW,)))
    assert found.verdict == (verdict,)
    assert [d.simulator for d in found.differences] == ([manner] if manner else [])
    assert compared(dim, bright).verdict == ("none",), "no law is stated"


def test_a_session_within_the_law_has_no_foreign_light(evidence: tuple[ViewEvidence, ...]) -> None:
    dark, lit = diagnosis(noisier(evidence, 1.05)), diagnosis(noisier(evidence, 1.28), Ambient(uniform_m=0.003, reference=2000.0))
    found = against(lit, dark, ("panel",), known=SensorModel((LAW,)))
    assert (found.verdict, only(found).simulator) == (("ambient",), LACKS)
    assert "beyond the photon law" in only(found).line()


def test_what_a_displaced_part_leaves_between_neighbours_is_no_noise(evidence: tuple[ViewEvidence, ...]) -> None:
    """Poses could take up the motion of the only part."""
    moved = CadDeviation(values=(0.0, 0.0, 0.005, *(0.0,) * 6))
    assert compared(diagnosis(evidence), diagnosis(noisier(evidence, 2.0), moved)).verdict == ("none",)
    assert compared(diagnosis(evidence), diagnosis(noisier(evidence, 2.0))).verdict == ("noise",)


def losing(evidence: tuple[ViewEvidence, ...], share: float) -> tuple[ViewEvidence, ...]:
    """Dwells of a hundred captures, of which every pixel loses this share."""
    count = np.full(SHAPE, round(100 * (1 - share)), np.uint16)
    # The noise of one capture is that of the mean of a hundred times ten.
    return tuple(replace(v, view=replace(v.view, captures=100, count=count), sigma=v.sigma / 10) for v in evidence)


def test_lost_pixels_are_compared_at_the_cameras_light(evidence: tuple[ViewEvidence, ...]) -> None:
    none, some, more = (losing(evidence, share) for share in (0.0, 0.05, 0.06))
    lossy = compared(diagnosis(some, Dropout(random=0.05)), diagnosis(none))
    assert (lossy.verdict, only(lossy).simulator) == (("dropout",), LACKS)
    assert "5 % of the pixels real, 0 % simulated" in only(lossy).line()
    assert lossy.to_dict()["differences"][0]["real_mm"] is None
    assert compared(diagnosis(more, Dropout(random=0.06)), diagnosis(some, Dropout(random=0.05))).verdict == ("none",)


def test_a_session_that_loses_as_much_unnamed_does_not_differ(evidence: tuple[ViewEvidence, ...]) -> None:
    """One diagnosis names a loss of 5 %, the other does not, and its pixels are lost all the same."""
    some = losing(evidence, 0.05)
    for found in (
        compared(diagnosis(some), diagnosis(some, Dropout(random=0.05))),
        compared(diagnosis(some, Dropout(random=0.05)), diagnosis(some)),
    ):
        assert (found.verdict, found.alike) == (("none",), ("dropout",))


@pytest.mark.parametrize(("share", "verdict", "manner"), [(0.0, "phase_wrap", LACKS), (0.05, "none", ""), (0.10, "phase_wrap", STRONG)])
def test_wrapped_pixels_are_compared_by_their_share(evidence: tuple[ViewEvidence, ...], share: float, verdict: str, manner: str) -> None:
    """No map says which pixels wrap in another session."""
    wraps = [PhaseWrap(start_m=0.1, share=s) for s in (0.05, share)]
    found = compared(diagnosis(evidence, wraps[0]), diagnosis(evidence, *(w for w in wraps[1:] if w.share)))
    assert found.verdict == (verdict,)
    assert [d.simulator for d in found.differences] == ([manner] if manner else [])


def test_mixed_pixels_are_compared_at_the_edges_of_the_cad(evidence: tuple[ViewEvidence, ...]) -> None:
    edge = np.zeros(SHAPE, np.float32)
    edge[:, 50] = 0.5
    seen = tuple(
        replace(v, frame=replace(v.frame, rendering=replace(v.frame.rendering, mixed=edge, second=v.frame.rendering.depth + 0.1)))
        for v in evidence
    )
    whole, half = FlyingPixels(share=1.0), FlyingPixels(share=0.5)
    assert compared(diagnosis(seen, whole), diagnosis(seen, whole)).verdict == ("none",)
    assert [only(compared(diagnosis(seen, whole), diagnosis(seen, *e))).simulator for e in ((), (half,))] == [LACKS, WEAK]
    assert only(compared(diagnosis(seen), diagnosis(seen, whole))).simulator == SUPERFLUOUS


def coarse(evidence: tuple[ViewEvidence, ...], step_m: float) -> tuple[ViewEvidence, ...]:
    return tuple(replace(v, step_m=step_m) for v in evidence)


def test_coarse_steps_are_compared_by_themselves_and_not_by_their_noise(evidence: tuple[ViewEvidence, ...]) -> None:
    """Steps of 6 mm make 1.7 mm of noise, beside 5.5 mm by photons."""
    steps = [diagnosis(coarse(evidence, s), *([Quantization(s)] if s > 0.001 else [])) for s in (0.001, 0.006, 0.012)]
    lacking, twice = only(compared(steps[1], steps[0])), only(compared(steps[1], steps[2]))
    assert [(d.effect, d.simulator) for d in (lacking, twice)] == [("quantization", LACKS), ("quantization", STRONG)]
    assert "steps of 6.0 mm real, 1.0 mm simulated" in lacking.line()
    assert twice.ratio == pytest.approx(0.5)
    assert compared(steps[1], steps[1]).verdict == ("none",)


def test_noise_that_coarser_steps_make_is_stated_as_steps(evidence: tuple[ViewEvidence, ...]) -> None:
    fine, rough = diagnosis(coarse(evidence, 0.001)), diagnosis(coarse(noisier(evidence, 2.0), 0.030), Quantization(0.030))
    assert compared(fine, rough).verdict == ("quantization",)
    assert compared(diagnosis(coarse(noisier(evidence, 4.0), 0.001)), rough).verdict == ("noise", "quantization"), (
        "the finer one is noisier"
    )


def test_noise_that_a_map_of_more_pattern_leaves_is_no_noise_of_its_own(evidence: tuple[ViewEvidence, ...]) -> None:
    """The noisier session decides by its own diagnosis whether it has noise besides."""
    image, light = np.random.default_rng(0).normal(0.0, 0.0030, SHAPE), Ambient(uniform_m=0.006, reference=2000.0)
    one, twice, lit = (
        diagnosis(seen, FixedPattern(pixels=packed(size * image)), *more)
        for seen, size, more in ((evidence, 1.0, ()), (noisier(evidence, 1.6), 2.0, ()), (noisier(evidence, 1.6), 2.0, (light,)))
    )
    assert compared(one, twice).verdict == ("fixed_pattern",)
    assert compared(one, lit).verdict == ("ambient", "fixed_pattern")
    less, more = (FixedPattern(pixels=packed(size * image)) for size in (3.0, 6.0))
    assert compared(diagnosis(noisier(evidence, 1.6), less), diagnosis(evidence, more)).verdict == ("fixed_pattern", "noise")


def lit(evidence: tuple[ViewEvidence, ...], size_m: float, *, named: bool) -> Diagnosis:
    """A session of which another camera's light shifts each view by a slope of its own over the rows; `size_m`: RMS of the slopes."""
    rng = np.random.default_rng(5)
    slope = np.sqrt(12.0) * (np.arange(SHAPE[0]) / SHAPE[0] - 0.5)[:, None]
    seen = tuple(replace(v, residual=v.residual + size_m * rng.choice([-1.0, 1.0]) * slope) for v in evidence)
    found = diagnosis(seen)
    assert found.account.solved.bare is seen
    if named:
        light: Any = SimpleNamespace(
            effect=Interference(burst_m=size_m), name="interference", corrects=False, common=np.zeros(1), expected=False
        )
        found.findings.append(light)  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize(
    ("real", "simulated", "manner"),
    [
        ((0.004, True), (0.0, False), LACKS),
        ((0.0, False), (0.004, True), SUPERFLUOUS),
        ((0.004, True), (0.008, True), STRONG),
        ((0.004, False), (0.008, True), STRONG),  # too little to be named, and in every view
        ((0.004, True), (0.0045, True), None),
        ((0.004, True), (0.008, False), None),  # the diagnosis of the session with more of it calls it otherwise
        ((0.008, False), (0.0, False), None),
    ],
)
def test_foreign_light_is_compared_by_what_differs_from_view_to_view(
    evidence: tuple[ViewEvidence, ...], real: tuple[float, bool], simulated: tuple[float, bool], manner: str | None
) -> None:
    found = compared(*(lit(evidence, size, named=named) for size, named in (real, simulated)))
    assert [(d.effect, d.simulator) for d in found.differences] == ([] if manner is None else [("interference", manner)])
    if manner is not None:
        sizes = (only(found).real_mm, only(found).simulated_mm)
        assert sizes == pytest.approx((1e3 * real[0], 1e3 * simulated[0]), abs=0.3)


def test_wrapped_pixels_that_a_filter_leaves_when_it_is_off_are_no_difference_of_their_own(evidence: tuple[ViewEvidence, ...]) -> None:
    edge = np.zeros(SHAPE, np.float32)
    edge[:, 10:14] = 0.5
    edges = tuple(
        replace(v, frame=replace(v.frame, rendering=replace(v.frame.rendering, mixed=edge, second=v.frame.rendering.depth + 0.1)))
        for v in evidence
    )
    few, many, mixed = PhaseWrap(start_m=0.5, share=0.02), PhaseWrap(start_m=0.5, share=0.08), FlyingPixels(share=1.0)
    off, on = diagnosis(edges, many, mixed), diagnosis(edges, few)
    assert compared(off, on).verdict == ("flying_pixels",)
    assert compared(diagnosis(edges, few, mixed), diagnosis(edges, many)).verdict == ("flying_pixels", "phase_wrap")
    assert compared(diagnosis(edges, many), on).verdict == ("phase_wrap",)
