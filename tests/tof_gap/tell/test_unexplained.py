# SPDX-License-Identifier: Apache-2.0
"""What no named effect explains: its size, its part, and each condition that makes it `unknown`."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap import two_walls
from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tests.tof_gap.seen.missing import test_filtered
from tests.tof_gap.two_walls import mean
from tof_core.config import updated
from tof_core.reasons import Reason
from tof_gap.limits.missing import MissingLimits
from tof_gap.limits.report import ReportLimits
from tof_gap.seen.finding import Finding
from tof_gap.tell.account import astray2
from tof_gap.tell.block_means import block_means
from tof_gap.tell.diagnosis import doubted
from tof_gap.tell.figures.shrink import Errors, Shrink
from tof_gap.tell.unexplained import Unexplained, gross_share, look, misfit
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.range_offset import RangeOffset

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

NOISE_M = 0.002
FAR_PART = 1203
"""Number of a part of a large assembly."""


def session(part: int = 0) -> tuple[ViewEvidence, ...]:
    """Views whose right half is another part."""
    out = []
    for v in views(np.random.default_rng(1)):
        numbers = np.zeros(SHAPE, np.int16)
        numbers[:, SHAPE[1] // 2 :] = part
        out.append(replace(v, frame=replace(v.frame, rendering=replace(v.rendering, part=numbers))))
    return tuple(out)


def left_over(size_m: float) -> list[np.ndarray]:
    """White noise, and on the right half of every view a constant error."""
    rng = np.random.default_rng(2)
    bias = np.zeros(SHAPE)
    bias[:, SHAPE[1] // 2 :] = size_m
    return [rng.normal(0, NOISE_M, SHAPE) + bias for _ in range(VIEWS)]


def account(seen: tuple[ViewEvidence, ...], left: list[np.ndarray], before_mm: float = 3.0, **changes: Any) -> Any:
    """What `look` reads of an account."""
    figures = SimpleNamespace(
        maps={},
        total=lambda _names, _view: np.zeros(SHAPE),
        left=lambda: left,
        floors=[np.full(SHAPE, NOISE_M**2)] * VIEWS,
        residual=left,
        edge=[v.edge for v in seen],
        alike_m=0.0,
        unsure2=np.zeros(SHAPE),
    )
    solved = SimpleNamespace(
        evidence=seen,
        linearised=seen,
        bare=seen,
        unnamed_m=0.0,
        depends_on=(),
        small_together=(),
        arms_alike=0.0,
        maps={},
        named=(),
        sizes={},
    )
    solved.arms, solved.arms_sd = np.zeros((VIEWS, 6)), np.full((VIEWS, 6), 5e-4)
    error = Errors(before_mm, before_mm, 0.0)
    found: dict[str, Any] = {
        "findings": (),
        "pushed": False,
        "follows": False,
        "sags": False,
        "astray": False,
        "gap": Shrink(error, error, 1e3 * NOISE_M, None, None),
    }
    for name, value in changes.items():
        for owner in (figures, solved):
            if hasattr(owner, name):
                setattr(owner, name, value)
        if name in found:
            found[name] = value
    return SimpleNamespace(figures=figures, solved=solved, **found)


def parts(count: int) -> Any:
    """A scene of so many parts."""
    names = tuple(f"part_{i}" for i in range(count))
    return SimpleNamespace(names=names, parts=names)


def test_a_part_beyond_a_thousand_is_reported_by_its_own_name() -> None:
    found = look(account(session(FAR_PART), left_over(0.003)), parts(FAR_PART + 1), ReportLimits(), MissingLimits())
    assert found.structured
    assert found.where == ("part_1203",)


def test_block_means_are_those_of_one_part_each() -> None:
    means = block_means(session(FAR_PART), left_over(0.003), [np.full(SHAPE, NOISE_M**2)] * VIEWS, 16, 40)
    assert set(means.part.tolist()) == {0, FAR_PART}
    assert means.mean[means.part == FAR_PART].mean() == pytest.approx(0.003, rel=0.01)
    assert means.mean[means.part == 0].mean() == pytest.approx(0.0, abs=2e-5)
    np.testing.assert_allclose(means.white2, NOISE_M**2 / means.pixels)
    assert means.pixels.min() >= 40
    assert means.pixels.max() == 256


@pytest.mark.parametrize(
    ("maps", "structured"),
    [({}, True), ({"range_offset": ()}, True), ({"wiggling": ()}, False), ({"range_offset": (), "wiggling": ()}, False)],
)
def test_less_may_be_left_where_no_map_of_an_effect_is_inexact(maps: dict[str, Any], *, structured: bool) -> None:
    """0.55 mm on half of the pixels of one part, between 0.4 and 0.7 mm on the other."""
    left = left_over(0.00055)
    found = look(account(session(1), left, before_mm=0.8, maps=maps), parts(2), ReportLimits(), MissingLimits())
    assert found.structured is structured


@pytest.mark.parametrize(("removed_mm", "structured"), [(0.0, True), (1.5, True), (5.0, False)])
def test_what_a_removed_bias_leaves_is_no_structure(removed_mm: float, *, structured: bool) -> None:
    """1 mm on half of the pixels: of 5 mm that --sensor removed it is the maps' error, of 1.5 mm it is more."""
    seen = account(session(1), left_over(0.001), before_mm=1.0)
    assert look(seen, parts(2), ReportLimits(), MissingLimits(), (), removed_mm).structured is structured


@pytest.mark.parametrize(("noise_m", "structured"), [(0.002, True), (0.004, False)])
def test_a_part_is_not_judged_by_a_fraction_of_its_noise(noise_m: float, *, structured: bool) -> None:
    """0.6 mm are left on it, of pixels with 2 and 4 mm of noise."""
    rng = np.random.default_rng(2)
    left = [rng.normal(0, noise_m, SHAPE) + left_over(0.0006)[0] - left_over(0.0)[0] for _ in range(VIEWS)]
    seen = account(session(1), left, before_mm=10.0, floors=[np.full(SHAPE, noise_m**2)] * VIEWS)
    assert look(seen, parts(2), ReportLimits(), MissingLimits()).structured is structured


def test_pixels_of_weak_light_count_by_what_they_know() -> None:
    """Half of the pixels have ten times the noise: there 6 mm are left of a far wall, of which their camera says little."""
    dark = np.zeros(SHAPE, bool)
    dark[:, SHAPE[1] // 2 :] = True
    noisy, rng = np.where(dark, 10 * NOISE_M, NOISE_M), np.random.default_rng(2)
    errors = [rng.normal(0, noisy) + np.where(dark, 0.006, 0.0) for _ in range(VIEWS)]
    left = look(account(session(1), errors, floors=[noisy**2] * VIEWS), parts(2), ReportLimits(), MissingLimits())
    assert left.rmse_mm == pytest.approx(6.0 / np.sqrt(1 + 10**2), rel=0.1)  # each dark pixel knows a hundredth
    assert left.where == ("part_1",), "the part by itself is off, by a third of its noise"


def test_the_size_is_that_of_the_block_means_above_the_floor() -> None:
    found = look(account(session(), left_over(0.003)), parts(1), ReportLimits(), MissingLimits())
    # Seven blocks lie side by side: three without the error, one half in it, three in it.
    assert found.rmse_mm == pytest.approx(np.sqrt((1.5**2 + 3 * 3.0**2) / 7), rel=0.02)
    assert look(account(session(), left_over(0.0)), parts(1), ReportLimits(), MissingLimits()).rmse_mm < 0.05


@pytest.mark.parametrize(
    ("changes", "structured"),
    [
        ({}, False),
        ({"depends_on": ("row",)}, True),
        ({"small_together": ("wiggling",)}, True),
        ({"arms_alike": 22.4}, False),
        ({"arms_alike": 22.6}, True),
        ({"pushed": True}, True),
        ({"follows": True}, True),
        ({"sags": True}, True),
    ],
)
def test_what_the_solution_states_makes_it_unknown(changes: dict[str, Any], *, structured: bool) -> None:
    found = look(account(session(), left_over(0.0), **changes), parts(1), ReportLimits(), MissingLimits())
    assert found.structured is structured
    if {"arms_alike", "pushed"} & changes.keys():
        assert found.depends_on == (("hand",) if structured else ())
    for sign, quantity in (("follows", "viewed"), ("sags", "attitude"), ("astray", "arm")):
        assert sign not in changes or found.depends_on == (quantity,)


@pytest.mark.parametrize(("pushed", "steps2"), [(True, 9.0), (False, 0.0)])
def test_an_error_that_steps_of_the_camera_absorb_is_unexplained_too(*, pushed: bool, steps2: float) -> None:
    """Steps of 3 mm along the optical axis beyond the robot's prior, beside a gap of 4 mm that named effects explain."""
    arms = np.zeros((VIEWS, 6))
    arms[:, 2] = np.hypot(3e-3, 5e-4)
    seen = account(session(), left_over(0.0), 4.0, arms=arms, pushed=pushed, sags=True)
    share = steps2 / (steps2 + seen.gap.shown_mm[0] ** 2)
    assert look(seen, parts(1), ReportLimits(), MissingLimits()).share == pytest.approx(share, abs=0.01)


def test_all_that_the_errors_of_an_arm_beyond_its_prior_make_is_unexplained() -> None:
    """Steps of 3 mm along the optical axis, which change z by a little more before a surface that is tilted."""
    arms = np.zeros((VIEWS, 6))
    arms[:, 2] = 3e-3
    seen = account(session(), left_over(0.0), 4.0, arms=arms, astray=True)
    made = 1e6 * float(np.mean(astray2(seen.solved)))
    assert made == pytest.approx(9.0, rel=0.05)
    assert look(seen, parts(1), ReportLimits(), MissingLimits()).share == pytest.approx(made / (made + seen.gap.shown_mm[0] ** 2), abs=0.01)


@pytest.mark.parametrize(("size_mm", "before_mm", "structured"), [(0.9, 2.1, False), (1.1, 2.1, True), (1.1, 4.0, False)])
def test_block_means_must_exceed_a_size_and_a_share_of_the_gap(size_mm: float, before_mm: float, *, structured: bool) -> None:
    limits = updated(ReportLimits(), {"unexplained.mm": 0.7, "unexplained.share": 0.12, "unexplained.misfit": 1.0})
    residual = [np.full(SHAPE, 1e-3 * before_mm)] * VIEWS
    seen = account(session(), left_over(1e-3 * size_mm), before_mm, residual=residual, maps={"wiggling": ()})
    assert look(seen, parts(1), limits, MissingLimits()).structured is structured


@pytest.mark.parametrize(
    ("views_off", "before_mm", "structured"),
    [
        (VIEWS, 0.0, True),
        (1, 0.0, False),  # One view may be another kind of scene.
        (VIEWS, 9.0, False),  # A named effect took a part's 9 mm but for 1 mm.
    ],
)
def test_a_part_that_is_off_by_itself_is_unknown_though_the_whole_is_not(views_off: int, before_mm: float, *, structured: bool) -> None:
    """A part of a seventh of the image, off by 1 mm: 0.4 mm RMS of all."""
    limits = updated(ReportLimits(), {"unexplained.misfit": 1.0})
    numbers = np.zeros(SHAPE, np.int16)
    numbers[:, :16] = 1
    seen = tuple(replace(v, frame=replace(v.frame, rendering=replace(v.rendering, part=numbers))) for v in session())
    left = [x + 1e-3 * (numbers == 1) * (k < views_off) for k, x in enumerate(left_over(0.0))]
    residual = [x + 1e-3 * before_mm * (numbers == 1) for x in left]
    found = look(account(seen, left, residual=residual), parts(2), limits, MissingLimits())
    assert found.rmse_mm < 0.5
    assert (found.structured, found.where) == (structured, ("part_1",) if structured else ())


@pytest.mark.parametrize(("size_m", "structured"), [(0.003, True), (0.006, False)])
def test_what_a_coarse_map_leaves_on_a_part_is_its_error(size_m: float, *, structured: bool) -> None:
    """Beside multipath, whose map errs by 6 % in energy: 0.7 mm of 3 mm, 1.5 mm of 6 mm. The part is off by 1.4 mm."""
    limits = updated(ReportLimits(), {"unexplained.misfit": 1.0})
    numbers = np.zeros(SHAPE, np.int16)
    numbers[:, :16] = 1
    seen = tuple(replace(v, frame=replace(v.frame, rendering=replace(v.rendering, part=numbers))) for v in session())
    left = [x + 1.4e-3 * (numbers == 1) for x in left_over(0.0)]
    named = (SimpleNamespace(name="multipath", effects=(Multipath(),)),)
    beside = account(seen, left, 10.0, maps={"multipath": ()}, named=named, sizes={"multipath": size_m})
    assert look(beside, parts(2), limits, MissingLimits()).structured is structured


def test_structure_of_a_named_noise_is_its_own() -> None:
    limits = updated(ReportLimits(), {"unexplained.misfit": 1.0})
    assert look(account(session(), left_over(0.0015)), parts(1), limits, MissingLimits()).structured
    assert not look(account(session(), left_over(0.0015), alike_m=0.002), parts(1), limits, MissingLimits()).structured


def test_gross_pixels_count_unless_they_are_wrapped_phase() -> None:
    seen = session()
    gross = np.zeros(SHAPE, bool)
    gross[20:30, 20:30] = True
    far = np.where(gross, 0.2, 0.0)
    off = tuple(replace(v, gross=gross, residual=v.residual + far) for v in seen)
    nothing = [np.zeros(SHAPE)] * len(off)
    share = float(np.mean([100 / (np.isfinite(v.residual) & ~v.edge).sum() for v in seen]))
    assert gross_share(off, nothing) == pytest.approx(share)
    assert gross_share(off, [far] * len(off)) == 0.0, "what a named effect explains is not gross"
    found = look(account(off, left_over(0.0)), parts(1), ReportLimits(), MissingLimits())
    assert found.structured
    assert found.gross == pytest.approx(share)
    wrapped = Finding(PhaseWrap(), 1.0)
    assert not look(account(off, left_over(0.0), findings=(wrapped,)), parts(1), ReportLimits(), MissingLimits()).structured
    assert not look(account(off, left_over(0.0), linearised=seen), parts(1), ReportLimits(), MissingLimits()).structured, (
        "gross at both poses or not at all"
    )


@pytest.mark.parametrize(
    ("left_m", "before_mm", "taken_out", "structured"),
    [
        (3e-4, 0.4, ["lens_scatter"], True),
        (3e-4, 0.4, [], False),
        (1e-4, 0.4, ["lens_scatter"], False),
        (3e-4, 3.0, ["lens_scatter"], False),  # Beside 3 mm of named effects: their maps are not exact.
    ],
)
def test_an_effect_that_was_contradicted_leaves_something_unknown(
    left_m: float, before_mm: float, taken_out: list[str], *, structured: bool
) -> None:
    """0.3 mm on half of the pixels are 0.21 mm RMS: unknown only where an effect was taken out, and more than 0.15 mm."""
    found = look(account(session(), left_over(left_m), before_mm), parts(1), ReportLimits(), MissingLimits(), taken_out)
    assert found.structured is structured
    assert found.resembles == (("lens_scatter",) if structured else ())


def test_lost_pixels_that_nothing_names_are_unexplained_where_they_are() -> None:
    seen = session(7)
    gone = np.zeros(SHAPE, bool)
    gone[10:20, SHAPE[1] // 2 + 5 : SHAPE[1] // 2 + 15] = True
    lacking = tuple(
        replace(
            v,
            view=replace(
                v.view, depth=np.where(gone, np.float32(np.nan), v.view.depth), reason=np.where(gone, Reason.NO_RETURN, v.view.reason)
            ),
        )
        for v in seen
    )
    found = look(account(lacking, left_over(0.0)), parts(8), ReportLimits(), MissingLimits())
    assert found.structured
    assert found.depends_on[0] == "lost pixels"
    assert found.where == ("part_7",)
    named = Finding(Dropout(random=0.1), 1.0)
    assert not look(account(lacking, left_over(0.0), findings=(named,)), parts(8), ReportLimits(), MissingLimits()).structured
    # The same pixels in every view: a filter in the camera stops at the steps of a pattern that is named.
    beside_pattern = account(lacking, left_over(0.0), maps={"fixed_pattern": ()})
    assert not look(beside_pattern, parts(8), ReportLimits(), MissingLimits()).structured


def test_holes_of_a_filter_beside_wrapped_pixels_are_explained() -> None:
    """Outliers in weak light that a filter removed with their neighbours; beside another effect, they are lost pixels without a name."""
    lossy = tuple(test_filtered.session(test_filtered.outliers_in_weak_light))
    wraps, other = Finding(PhaseWrap(start_m=1.0, share=1.0), 1.0), Finding(RangeOffset(), 1.0)
    structured = [
        look(account(lossy, left_over(0.0), findings=(named,)), parts(1), ReportLimits(), MissingLimits()).structured
        for named in (wraps, other)
    ]
    assert structured == [False, True]


@pytest.mark.parametrize(("firmware", "depends_on"), [(mean, ("edge_px",)), (np.asarray, ())])
def test_edges_that_a_filter_smears_are_unexplained(firmware: Callable[[Float], Float], depends_on: tuple[str, ...]) -> None:
    seen = two_walls.session(firmware=firmware)
    found = look(account(seen, left_over(0.0)), parts(1), ReportLimits(), MissingLimits())
    assert found.structured == bool(depends_on)
    assert found.depends_on == depends_on


def test_misfit_is_the_share_of_the_chi_square_above_the_floor() -> None:
    floor2 = [np.full(SHAPE, 1e-6)] * VIEWS
    ones = [np.full(SHAPE, 1e-3)] * VIEWS
    assert misfit([np.sqrt(5) * e for e in ones], [np.sqrt(2) * e for e in ones], floor2, 0.03) == pytest.approx(0.25)
    assert misfit([np.sqrt(5) * e for e in ones], [np.sqrt(1.02) * e for e in ones], floor2, 0.03) == 0.0
    assert misfit(ones, [2.0 * e for e in ones], floor2, 0.03) == 1.0, "more than there was is all of it"


def test_pixels_noisier_than_the_floor_are_unexplained_unless_a_noise_is_named() -> None:
    rng = np.random.default_rng(8)
    errors = [1.3 * NOISE_M * rng.standard_normal(SHAPE) for _ in range(VIEWS)]
    assert look(account(session(), errors, 4.0), parts(8), ReportLimits(), MissingLimits()).structured
    for named, structured in ((Noise(extra_m=0.001), False), (RangeOffset(0.001), True)):
        found = account(session(), errors, 4.0, findings=(Finding(named, 1.0),))
        assert look(found, parts(8), ReportLimits(), MissingLimits()).structured == structured


def test_what_is_left_at_edges_makes_nothing_unknown() -> None:
    half = np.zeros(SHAPE, bool)
    half[:, SHAPE[1] // 2 :] = True
    away, beside = session(), tuple(replace(v, edge=v.edge | half) for v in session())
    assert look(account(away, left_over(0.003)), parts(1), ReportLimits(), MissingLimits()).structured
    assert not look(account(beside, left_over(0.003)), parts(1), ReportLimits(), MissingLimits()).structured


def test_nothing_measured_leaves_nothing() -> None:
    empty = [np.full(SHAPE, np.nan)] * VIEWS
    found = look(account(session(), empty), parts(1), ReportLimits(), MissingLimits())
    assert (found.rmse_mm, found.structured) == (0.0, False)
    assert found.where == ()


def test_what_is_left_and_what_free_functions_take_count_as_unexplained() -> None:
    half = look(account(session(), left_over(2e-3), before_mm=3.0), parts(1), ReportLimits(), MissingLimits())
    gap2 = 9.0 - (1e3 * NOISE_M) ** 2
    assert half.share == pytest.approx(half.rmse_mm**2 / gap2, rel=1e-6)
    free = look(account(session(), left_over(0.0), depends_on=("range_m",), unnamed_m=2e-3), parts(1), ReportLimits(), MissingLimits())
    assert free.share == pytest.approx(4.0 / (gap2 + 4.0), rel=0.01)


def test_effects_are_only_suspected_where_much_stays_unexplained() -> None:
    limits = ReportLimits()
    assert doubted(Unexplained(1.0, structured=True, depends_on=(), where=(), share=0.055), limits)
    assert not doubted(Unexplained(1.0, structured=True, depends_on=(), where=(), share=0.045), limits)
    assert not doubted(Unexplained(1.0, structured=False, depends_on=(), where=(), share=0.5), limits)
