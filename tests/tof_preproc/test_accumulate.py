# SPDX-License-Identifier: Apache-2.0
"""Equation 1 as printed, the outlier filters over time, and averages with a correct standard error."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tof_core.reasons import Reason
from tof_preproc.accumulate import Accumulated, accumulate
from tof_preproc.config import AccumulateConfig, IqrConfig, PreprocConfig, Sigma3Config
from tof_preproc.stack import Stack

if TYPE_CHECKING:
    from tof_core.arrays import Image

LAW = 0.002
DEPTHS = arrays(np.float32, (7, 2, 3), elements=st.one_of(st.just(np.nan), st.floats(0.25, 4.0, width=32)))


def run(frames: Image, *stages: str, config: PreprocConfig | None = None, quantum: float = 0.0) -> Accumulated:
    config = (config or PreprocConfig()).resolved
    stack = Stack((frames.shape[1], frames.shape[2]), len(frames), in_time=config.accumulate.method == "paper")
    for frame in frames:
        stack.add(frame, np.where(np.isnan(frame), Reason.NO_RETURN, Reason.VALID).astype(np.uint8))
    return accumulate(stack, np.full(frames.shape[1:], LAW, np.float32), quantum, config, stages)


def one_pixel(*depths: float) -> Image:
    return np.array(depths, np.float32)[:, None, None]


def keeping_all(method: str) -> PreprocConfig:
    return PreprocConfig(accumulate=AccumulateConfig(method=method, min_share=0.0))


def equation_1(values: list[float]) -> float:
    """As printed: 0 is data lost."""
    last = 0.0
    for now in values:
        if last == 0 and now != 0:
            last = now
        elif last != 0 and now != 0:
            last = (last + now) / 2
    return last


@given(DEPTHS)
def test_equation_1_as_printed(frames: Image) -> None:
    result = run(frames, config=keeping_all("paper"))
    printed = np.apply_along_axis(lambda t: equation_1(list(np.nan_to_num(t).astype(float))), 0, frames)
    np.testing.assert_allclose(np.nan_to_num(result.depth), printed, rtol=1e-6)


def test_equation_1_keeps_the_last_value_through_lost_ones() -> None:
    assert run(one_pixel(np.nan, 1.0, np.nan, 2.0, np.nan), config=keeping_all("paper")).depth[0, 0] == 1.5


def test_equation_1_never_falls_below_a_third_of_one_captures_variance() -> None:
    rng = np.random.default_rng(0)
    for n, share in ((1, 1.0), (2, 0.5), (3, 0.375), (12, 1 / 3)):
        frames = (1 + LAW * rng.standard_normal((n, 120, 160))).astype(np.float32)
        result = run(frames, config=keeping_all("paper"))
        assert np.var(result.depth) / LAW**2 == pytest.approx(share, rel=0.04)
        assert np.mean(result.sigma**2) / LAW**2 == pytest.approx(share, rel=0.04)


@given(DEPTHS, st.sampled_from(["mean", "median"]), st.permutations(range(7)))
def test_the_order_of_captures_does_not_matter(frames: Image, method: str, order: list[int]) -> None:
    one, other = (run(f, "iqr", "sigma3", config=keeping_all(method)) for f in (frames, frames[order]))
    for name in ("depth", "sigma", "noise", "count", "reason"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.rejected == other.rejected


@given(DEPTHS, st.sampled_from(["mean", "median", "paper"]))
def test_no_pixel_appears_and_depth_stays_between_its_captures(frames: Image, method: str) -> None:
    result = run(frames, "iqr", "sigma3", config=keeping_all(method))
    valid = np.isfinite(result.depth)
    seen = np.isfinite(frames).any(axis=0)
    np.testing.assert_array_equal(valid, seen)  # min_share 0: and none is lost
    np.testing.assert_array_equal(valid, result.reason == Reason.VALID)
    np.testing.assert_array_equal(valid, result.count > 0)
    for name in ("sigma", "noise"):
        np.testing.assert_array_equal(valid, np.isfinite(getattr(result, name)))
    assert (result.depth[valid] >= np.nanmin(np.where(valid, frames, 9.0), axis=0)[valid] - 1e-6).all()
    assert (result.depth[valid] <= np.nanmax(np.where(valid, frames, 0.0), axis=0)[valid] + 1e-6).all()


@given(arrays(np.float32, (9, 2, 3), elements=st.floats(0.25, 4.0, width=32)))
def test_the_papers_band_keeps_the_20_to_80_percent_quantiles(frames: Image) -> None:
    config = replace(keeping_all("mean"), iqr=IqrConfig(method="paper"))
    low, high = np.quantile(frames.astype(float), [0.2, 0.8], axis=0)
    kept = (frames >= low) & (frames <= high)
    result = run(frames, "iqr", config=config)
    np.testing.assert_array_equal(result.count, kept.sum(axis=0))
    np.testing.assert_allclose(result.depth, np.where(kept, frames, 0).sum(axis=0, dtype=float) / kept.sum(axis=0), rtol=1e-6)
    assert result.rejected == {"iqr": int((~kept).sum())}


@given(arrays(np.float32, (9, 2, 3), elements=st.floats(0.25, 4.0, width=32)))
def test_the_default_rejects_outside_tukeys_fences_on_those_quantiles(frames: Image) -> None:
    low, high = np.quantile(frames.astype(float), [0.2, 0.8], axis=0)
    fence = 1.5 * (high - low)
    count = run(frames, "iqr", config=keeping_all("mean")).count
    for rounding, bound in ((-1e-9, np.greater_equal), (1e-9, np.less_equal)):  # a value on its fence may go either way
        kept = (frames >= low - fence - rounding) & (frames <= high + fence + rounding)
        assert bound(count, kept.sum(axis=0)).all()


def test_fences_never_split_neighbouring_codes() -> None:
    frames = one_pixel(*[1.000] * 8, *[1.001] * 2)
    assert run(frames, "iqr", "sigma3", quantum=0.001).depth[0, 0] == pytest.approx(1.0002, abs=1e-6)
    assert run(frames, "iqr", quantum=0.0).depth[0, 0] == 1.0


def test_iqr_is_skipped_with_fewer_than_five_captures_and_reports_it() -> None:
    four = run(one_pixel(1.0, 1.0, 1.0, 3.0), "iqr")
    assert four.passed == {"iqr": "4 of the 5 captures it needs"}
    assert (four.depth[0, 0], four.rejected) == (1.5, {})
    five = run(one_pixel(1.0, 1.0, 1.0, 1.0, 3.0), "iqr")
    assert (five.depth[0, 0], five.passed, five.rejected) == (1.0, {}, {"iqr": 1})


def test_the_papers_three_sigma_cannot_reject_one_of_ten_but_one_of_twelve() -> None:
    config = replace(keeping_all("mean"), sigma3=Sigma3Config(method="paper"))
    assert run(one_pixel(*[1.0] * 9, 3.0), "sigma3", config=config).rejected == {"sigma3": 0}
    assert run(one_pixel(*[1.0] * 11, 3.0), "sigma3", config=config).rejected == {"sigma3": 1}


def test_the_robust_three_sigma_rejects_one_of_three_and_spares_the_expected_noise() -> None:
    assert run(one_pixel(1.0, 1.0, 1.5), "sigma3").depth[0, 0] == 1.0
    assert run(one_pixel(1.0, 1.0, 1.0 + 2.9 * LAW), "sigma3").rejected == {"sigma3": 0}


def test_a_pixel_seen_too_seldom_is_lost_for_the_commonest_reason() -> None:
    frames = one_pixel(*[np.nan] * 8, 1.0, 1.0)
    result = run(frames)
    assert np.isnan(result.depth[0, 0])
    assert (result.reason[0, 0], result.count[0, 0]) == (Reason.NO_RETURN, 0)
    assert run(frames, config=keeping_all("mean")).depth[0, 0] == 1.0


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 15])
@pytest.mark.parametrize(
    ("method", "stages"), [("mean", ("iqr", "sigma3")), ("mean", ()), ("median", ()), ("paper", ()), ("band", ("iqr",))]
)
def test_sigma_is_the_error_that_simulation_finds(n: int, method: str, stages: tuple[str, ...]) -> None:
    config = keeping_all("paper" if method == "band" else method)
    if method == "band":
        config = replace(config, iqr=IqrConfig(method="paper"))
    frames = (1 + LAW * np.random.default_rng(n).standard_normal((n, 100, 160))).astype(np.float32)
    result = run(frames, *stages, config=config)
    score = np.sqrt(np.mean(((result.depth - 1) / result.sigma) ** 2))
    assert 0.88 < score < 1.13
    assert np.sqrt(np.mean(result.noise**2)) == pytest.approx(LAW, rel=0.13)


def test_the_default_beats_equation_1_with_and_without_outliers() -> None:
    rng = np.random.default_rng(3)
    clean = (1 + LAW * rng.standard_normal((10, 100, 160))).astype(np.float32)
    soiled = np.where(rng.random(clean.shape) < 0.05, rng.uniform(0.5, 2.0, clean.shape).astype(np.float32), clean)
    for frames, bar in ((clean, 0.62), (soiled, 0.1)):
        ours, paper = (
            np.sqrt(np.mean((run(frames, *s, config=c).depth - 1) ** 2))
            for c, s in ((PreprocConfig(), ("iqr", "sigma3")), (keeping_all("paper"), ()))
        )
        assert ours < bar * paper
