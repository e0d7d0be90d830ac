# SPDX-License-Identifier: Apache-2.0
"""Which effects are believed: on columns that are drawn, so that the right answer is known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_align.chain import Chain
from tof_align.columns import ColumnSystem
from tof_align.config import Priors
from tof_align.mixed import Normal
from tof_core.config import updated
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose.judge import Selector
from tof_gap.solve.choose.select import _lacking, select
from tof_gap.solve.choose.ties import stand_ins
from tof_gap.solve.hypotheses.candidate import HAND_EYE, Candidate
from tof_gap.solve.hypotheses.columns import Design
from tof_gap.solve.hypotheses.free import UNKNOWN, FreeFunction
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.specular import Specular
from tof_sensor.effects.subsurface import Subsurface
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_sensor.effect import Effect

VIEWS, PIXELS = 12, 400
FREE = FreeFunction("range_m", (0.0, 1.0, 2.0), (0.0, 0.0, 0.0))
"""A candidate that is no effect."""


def design(candidates: list[Candidate], strengths: list[float], *, copies: tuple[int, int] | None = None, seed: int = 0) -> Design:
    """One column per candidate, independent unless `copies` (of, by); the residual is their sum at `strengths` and noise of 1."""
    rng = np.random.default_rng(seed)
    k = len(candidates)
    G = []
    for _ in range(VIEWS):
        pose, C = rng.normal(size=(PIXELS, 18)) * 1e-3, rng.normal(size=(PIXELS, k))
        if copies is not None:
            C[:, copies[1]] = 0.99 * C[:, copies[0]] + 0.14 * C[:, copies[1]]
        r = C @ np.array(strengths) + rng.normal(size=PIXELS)
        G.append(products(pose, C, r))
    system = system_of(G, np.repeat([0.01, 10.0], [12, k]), np.full(6, 0.01))
    return Design(tuple(candidates), tuple(np.array([i]) for i in range(k)), np.full(k, 1e3), system)


def products(pose: np.ndarray, C: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Products of [base, hand-eye | C | arm | residual] from pose columns (n, 18) of base, hand-eye and arm."""
    X = np.concatenate([pose[:, :12], C, pose[:, 12:], r[:, None]], axis=1)
    return np.asarray(X.T @ X)


def system_of(G: list[np.ndarray], sd: np.ndarray, arm_sd: np.ndarray) -> ColumnSystem:
    """One station; sd: prior deviations of base, hand-eye and coefficients."""
    one, many, eye = np.eye(4)[None], np.tile(np.eye(4), (VIEWS, 1, 1)), np.eye(4)
    k, each = len(sd), np.full(VIEWS, float(PIXELS))
    normal = Normal(np.stack(G), np.tile(np.arange(k), (VIEWS, 1)), sd**-2.0, arm_sd**-2.0, np.zeros(k), np.zeros((VIEWS, 6)))
    return ColumnSystem(Chain(np.zeros(VIEWS, int), (0,), one, many, one, many, eye, Priors()), normal, k - 12, each, each, each)


def with_products(d: Design, G: list[np.ndarray]) -> Design:
    """The design with other products."""
    return replace(d, system=replace(d.system, normal=replace(d.system.normal, gram=np.stack(G))))


def plain(*effects: object) -> list[Candidate]:
    return [Candidate(e.NAME, e) for e in effects]  # type: ignore[attr-defined, arg-type]


def names(d: Design, members: tuple[int, ...]) -> list[str]:
    return sorted(d.candidates[m].name for m in members)


def test_what_was_added_is_chosen_and_nothing_else() -> None:
    d = design(plain(RangeOffset(), DepthScale(), TemperatureDrift()), [0.3, 0.0, 0.5])
    found = select(d, SelectLimits())
    assert names(d, found.chosen.members) == ["range_offset", "temperature_drift"]
    assert found.small_together == ()


def test_a_named_effect_goes_before_a_free_form_that_does_as_well() -> None:
    d = design([*plain(RangeOffset()), Candidate(UNKNOWN, None, FREE.quantity, FREE)], [0.0, 0.4], copies=(1, 0))
    # The free form is the truth here, but the named one is nearly it: what it misses is less than the price.
    assert names(d, select(d, SelectLimits()).chosen.members) == ["range_offset"]
    far = design([*plain(RangeOffset()), Candidate(UNKNOWN, None, FREE.quantity, FREE)], [0.0, 0.4])
    assert names(far, select(far, SelectLimits()).chosen.members) == ["unknown"]
    assert select(far, SelectLimits()).unknown == ("range_m",)


@pytest.mark.parametrize(("scale", "expected"), [(0.0, ["amplitude_bias"]), (1.2, ["depth_scale", "range_offset"])])
def test_terms_of_its_own_must_explain_what_an_effect_must(scale: float, expected: list[str]) -> None:
    # The bias of amplitude is an offset but for 2 % of its energy: less than 1.5 % of all that is seen, where depth errs as well.
    d = design(plain(RangeOffset(), AmplitudeBias(), DepthScale()), [0.0, 0.9, scale], copies=(0, 1))
    found = select(d, SelectLimits())
    assert names(d, found.chosen.members) == expected
    assert names(d, found.fullest) == (["amplitude_bias", "depth_scale"] if scale else [])
    assert not any(found.ties)


def test_small_effects_beyond_the_second_are_a_crowd() -> None:
    effects = plain(RangeOffset(), DepthScale(), TemperatureDrift(), Wiggling(), Multipath(), Subsurface(part=0))
    found = select(d := design(effects, [0.6, 0.5, 0.2, 0.2, 0.2, 0.0]), SelectLimits())
    assert names(d, found.chosen.members) == ["depth_scale", "range_offset"]
    assert set(found.small_together) == {"temperature_drift", "wiggling", "multipath"}
    assert found.fullest == (), "much is explained together: these are no errors of a healthy camera"
    # Three of a size are three effects, and one that hardly shows makes up for a map that is not exact.
    three = select(d := design(effects, [0.5, 0.5, 0.5, 0.0, 0.0, 0.0]), SelectLimits())
    assert len(three.chosen.members) == 3
    assert three.small_together == ()
    # A second part that deviates is no effect more.
    parts = plain(RangeOffset(), CadDeviation(part=0), CadDeviation(part=1))
    both = select(d := design(parts, [0.6, 0.5, 0.2]), SelectLimits())
    assert len(both.chosen.members) == 3
    assert both.small_together == ()
    trifle = select(design(effects, [1.5, 1.2, 0.12, 0.0, 0.0, 0.0]), SelectLimits(share=0.0))
    assert len(trifle.chosen.members) == 2
    assert trifle.small_together == ()
    assert len(trifle.fullest) == 3


@pytest.mark.parametrize(
    ("strong", "expected"), [(FixedPattern(), ["depth_scale", "fixed_pattern"]), (TemperatureDrift(), ["temperature_drift"])]
)
def test_what_a_pattern_in_the_image_explains_does_not_hide_an_effect_of_range(strong: Effect, expected: list[str]) -> None:
    """The second effect has 0.5 % of the energy; what the pattern's map leaves is the same in all views, and never like it."""
    d = design(plain(strong, DepthScale()), [4.0, 0.3])
    assert names(d, select(d, SelectLimits()).chosen.members) == expected


def test_a_small_effect_that_takes_much_of_what_is_left_is_no_coincidence() -> None:
    """Beside a centimetre of constant, a millimetre of curve is a small share of the gap and most of what the others leave."""
    effects = plain(RangeOffset(), DepthScale(), Wiggling())
    d = design(effects, [6.0, 3.0, 0.9])
    assert names(d, select(d, SelectLimits()).chosen.members) == ["depth_scale", "range_offset", "wiggling"]
    assert names(d, select(d, SelectLimits(small_left=1e6, small_shared=1.0)).chosen.members) == ["depth_scale", "range_offset"]


def test_who_wins_but_a_little_of_what_could_be_taken_from_others_mends_them_and_is_not_there() -> None:
    near = plain(Wiggling(), Subsurface(part=0), DepthScale())
    # The second is nearly the first: what is missing of it in the residual speaks for it, though little beside all that both could be.
    mended = select(d := design(near, [6.0, 0.9, 0.0], copies=(0, 1)), SelectLimits(share=0.0))
    assert names(d, mended.chosen.members) == ["wiggling"]
    taken = select(d, SelectLimits(share=0.0, absorbed=0.0))
    assert names(d, taken.chosen.members) == ["subsurface", "wiggling"]


@pytest.mark.parametrize(("strength", "expected"), [(0.6, ["cad_deviation"]), (0.1, [])])
def test_what_nearly_one_view_alone_sees_is_believed_where_the_others_say_enough(strength: float, expected: list[str]) -> None:
    nearer = 6.0  # times as much of it does the first view see
    quiet, seen = (design(plain(CadDeviation(part=0)), [s]) for s in (strength, nearer * strength))
    wider = np.diag([*np.ones(12), nearer, *np.ones(7)])
    d = with_products(quiet, [wider @ seen.system.normal.gram[0] @ wider, *quiet.system.normal.gram[1:]])
    assert names(d, select(d, SelectLimits(share=0.0)).chosen.members) == expected


def test_what_a_rough_map_leaves_is_nobodys() -> None:
    trifle = 0.15  # 4800 pixels: about 110 of chi-square, of which a rough map of 0.65 may leave 120
    beside = select(d := design(plain(Multipath(), DepthScale()), [0.65, trifle]), SelectLimits(share=0.0))
    assert names(d, beside.chosen.members) == ["multipath"]
    exact = select(d := design(plain(TemperatureDrift(), DepthScale()), [0.65, trifle]), SelectLimits(share=0.0))
    assert names(d, exact.chosen.members) == ["depth_scale", "temperature_drift"]


@pytest.mark.parametrize(
    ("first", "second", "lacks"),
    [
        (Multipath(), AmplitudeBias(), 0.12),
        (Multipath(), CadDeviation(part=0), 1.0),
        (Specular(part=0), CadDeviation(part=0), 0.3),
        (Specular(part=0), AmplitudeBias(), 0.0),
        (Wiggling(), AmplitudeBias(), 0.0),
    ],
)
def test_reference_multipath_an_effect_must_win_more_than_its_map_may_lack(first: Effect, second: Effect, lacks: float) -> None:
    """A map of size 3 on 4800 pixels, of which an effect nearly along it could absorb 98 %: the map may be short by a share of that.

    An effect of one part must win more: what the map lacks of a part moves it as a whole.
    """
    d = design(plain(first, second), [3.0, 1.2], copies=(0, 1))
    judge = Selector(d, SelectLimits())
    assert _lacking(judge, judge.score([0, 1], 1.0), 1) == pytest.approx(lacks * 0.98 * 4800 * 3.0**2, rel=0.1)


def test_of_two_that_explain_alike_the_one_tried_at_fewer_shapes_is_chosen() -> None:
    many = [Candidate("wiggling", Wiggling(modulation_mhz=f)) for f in (60.0, 70.0, 80.0, 90.0)]
    d = design([*plain(DepthScale()), *many], [0.4, 0, 0, 0, 0], copies=(0, 1))
    judge = Selector(d, SelectLimits())
    assert judge.score([1], 1.0).price == pytest.approx(2 * np.log(4))
    assert judge.score([0], 1.0).price == 0.0


def test_a_form_without_a_formula_pays_as_a_free_function_does() -> None:
    """Groups of columns of any course fit whatever is a function of the column: they pay for that, and the smooth field does not."""
    d = design(plain(FixedPattern(), FixedPattern(lines=16)), [0.0, 0.0])
    judge = Selector(d, SelectLimits())
    assert judge.score([0], 1.0).price == pytest.approx(2 * np.log(2))
    assert judge.score([1], 1.0).price >= 2 * np.log(2) + SelectLimits().unknown


def test_hand_eye_needs_less_than_what_pixels_speak_for() -> None:
    d = design([Candidate(HAND_EYE, None), *plain(RangeOffset())], [0.0, 0.0])
    judge = Selector(d, SelectLimits())
    assert judge.gain(0) == SelectLimits().hand_gain < judge.gain(1)
    assert judge.share(0) == 0.0


def test_arms_that_all_err_alike_speak_of_their_mount() -> None:
    rng = np.random.default_rng(1)
    quiet = design(plain(RangeOffset()), [0.0])
    G = []
    for _ in range(VIEWS):
        pose, C = rng.normal(size=(PIXELS, 18)), rng.normal(size=(PIXELS, 1))
        # Of base, hand and arm the arm's columns alone carry it: the same step of two prior deviations in every view.
        r = pose[:, 12:] @ np.array([0.02, 0, 0, 0, 0, 0]) + 0.01 * rng.normal(size=PIXELS)
        G.append(products(pose / 0.01, C / 0.01, r / 0.01))
    off = with_products(quiet, G)
    alike = [Selector(d, SelectLimits()).arms_alike(Selector(d, SelectLimits()).score([], 1.0)) for d in (quiet, off)]
    assert alike[0] < 6.0
    assert alike[1] == pytest.approx(VIEWS * 2.0**2, rel=0.1)


@pytest.mark.parametrize(("effect", "expected"), [(Wiggling(), ["hand_eye", "wiggling"]), (Motion(), ["motion"])])
def test_hand_eye_is_not_named_where_motion_shifts_what_poses_are_known_by(effect: Wiggling | Motion, expected: list[str]) -> None:
    rng = np.random.default_rng(1)
    G = []
    for _ in range(VIEWS):
        pose, C = rng.normal(size=(PIXELS, 18)), rng.normal(size=(PIXELS, 1))
        r = 0.002 * pose[:, 6] + 0.02 * C[:, 0] + 0.01 * rng.normal(size=PIXELS)
        G.append(products(pose / 0.01, C / 0.01, r / 0.01))
    quiet = design(plain(effect), [0.0])
    both = (*quiet.candidates, Candidate(HAND_EYE, None))
    system = system_of(G, np.repeat([1e-3, 1e-6, 10.0], [6, 6, 1]), np.full(6, 1e-4))
    d = replace(quiet, candidates=both, groups=(quiet.groups[0], np.zeros(0, int)), system=system)
    assert names(d, select(d, SelectLimits()).chosen.members) == expected


@pytest.mark.parametrize(("alike", "expected"), [(True, [1]), (False, [])])
def test_what_stands_in_for_hand_eye_leaves_nothing_for_it_to_explain(*, alike: bool, expected: list[int]) -> None:
    """An effect that explains as much, of something else, is no tie: beside it, hand-eye wins as much as without it."""
    rng = np.random.default_rng(1)
    G = []
    for _ in range(VIEWS):
        pose = rng.normal(size=(PIXELS, 18))
        C = pose[:, 6:7] if alike else rng.normal(size=(PIXELS, 1))
        r = 0.002 * pose[:, 6] + (0.0 if alike else 0.003) * C[:, 0] + 0.01 * rng.normal(size=PIXELS)
        G.append(products(pose / 0.01, C / 0.01, r / 0.01))
    quiet = design(plain(RangeOffset()), [0.0])
    system = system_of(G, np.repeat([1e-3, 1e-6, 10.0], [6, 6, 1]), np.full(6, 1e-4))
    d = replace(quiet, candidates=(Candidate(HAND_EYE, None), *quiet.candidates), groups=(np.zeros(0, int), quiet.groups[0]), system=system)
    judge = Selector(d, SelectLimits())
    alone = judge.score([0], 1.0)
    assert judge.score([], 1.0).score - alone.score > 100
    assert judge.score([1], 1.0).score < alone.score + SelectLimits().tie_gain
    assert list(stand_ins(judge, alone, 0)) == expected


def test_a_lens_that_the_stated_calibration_half_absorbs_need_not_explain_a_share() -> None:
    """What is left of it beside the free lens is little, also where the lens is off by more than is stated."""
    names = [Candidate("wiggling", Wiggling(), ""), Candidate("intrinsics", Intrinsics(), ""), Candidate("lens", None, "")]
    every = design(names, [3.0, 0.2, 0.0])
    exact = replace(every, candidates=every.candidates[:2], groups=every.groups[:2])
    stated = replace(exact, always=every.groups[2])
    assert [exact.candidates[m].name for m in select(exact, SelectLimits()).chosen.members] == ["wiggling"]
    assert [stated.candidates[m].name for m in select(stated, SelectLimits()).chosen.members] == ["wiggling", "intrinsics"]


def test_a_wrong_lens_beside_a_free_one_wins_against_a_known_prior() -> None:
    every = design([Candidate("intrinsics", Intrinsics(), ""), Candidate("lens", None, "")], [0.0, 0.0])
    exact = replace(every, candidates=every.candidates[:1], groups=every.groups[:1])
    stated = replace(exact, always=every.groups[1])
    limits = SelectLimits()
    assert [Selector(d, limits).gain(0) for d in (exact, stated)] == [limits.gain, limits.hand_gain]


@pytest.mark.parametrize(("own_mm", "expected"), [(0.1, ["amplitude_bias"]), (1e6, ["range_offset"])])
def test_a_bias_with_amplitude_whose_own_terms_explain_little_is_an_offset(own_mm: float, expected: list[str]) -> None:
    """Its column is nearly that of the offset; `own_mm` is below and above what the rest explains."""
    d = design(plain(RangeOffset(), AmplitudeBias()), [0.0, 3.0], copies=(0, 1))
    limits = updated(SelectLimits(), {"own_mm": own_mm})
    assert names(d, select(d, limits).chosen.members) == expected
