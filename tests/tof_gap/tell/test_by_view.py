# SPDX-License-Identifier: Apache-2.0
"""An effect of the camera has one size in all views; what differs from view to view is something else."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.config import GapConfig
from tof_gap.limits.report import UnexplainedLimits
from tof_gap.seen.finding import Finding
from tof_gap.tell.by_view import spread, uneven
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.noise import Noise

LIMIT, NOISE = UnexplainedLimits(), GapConfig().noise
MAP = np.broadcast_to(0.004 * np.linspace(-1.0, 1.0, SHAPE[1]), SHAPE)
"""Metres that an effect adds to each view, from -4 mm at the left to 4 mm at the right."""
WAVE = np.broadcast_to(0.004 * np.sin(np.linspace(0.0, 25.0, SHAPE[1])), SHAPE)
"""Four waves of 4 mm across each view, which no pose can make."""
BY_TURNS = np.where(np.arange(VIEWS) % 2, 1.0, -1.0)


def of(sizes: np.ndarray, seed: int = 1, of_map: np.ndarray = MAP) -> Any:
    """Views whose error is the map times these sizes (V,), less the map: what the solution leaves."""
    quiet = views(np.random.default_rng(seed))
    return [replace(v, residual=v.residual + (s - 1.0) * of_map) for v, s in zip(quiet, sizes, strict=True)]


def solved(bare: Any, maps: dict[str, Any], arm_m: float = 1e-6) -> Any:
    """The parts of a solution that are asked for: views, maps, and how far the arm may be off, in metres and in half as many radians."""
    return SimpleNamespace(bare=bare, maps=maps, arms_sd=np.tile([arm_m] * 3 + [0.5 * arm_m] * 3, (VIEWS, 1)))


def test_the_spread_is_the_standard_deviation_of_the_sizes_over_their_mean() -> None:
    """Sizes of 0.7 and 1.3 by turns: 0.3 times the root of 12 / 11, and 0.71 times that with 39 chances in 40."""
    sizes = 1.0 + 0.3 * BY_TURNS
    certain = replace(LIMIT, uneven_chance=0.5)
    assert spread(of(sizes), [MAP] * VIEWS, certain) == pytest.approx(0.3, rel=0.1)
    assert spread(of(sizes), [MAP] * VIEWS, LIMIT) == pytest.approx(0.3 * np.sqrt(12 / 11) * 0.71, rel=0.1)


def test_a_wrong_mean_size_is_no_spread() -> None:
    assert spread(of(np.full(VIEWS, 1.3)), [MAP] * VIEWS, LIMIT) < 0.03


def test_noise_is_no_spread() -> None:
    """A map of 0.1 mm in noise of 4 mm: a view knows its size to 70 %, and the sizes differ by no more than that."""
    small = 0.025 * MAP
    for seed in range(5):
        quiet = views(np.random.default_rng(seed))
        sizes = [1.0 + float((small * v.residual)[v.smooth].sum() / (small**2)[v.smooth].sum()) for v in quiet]
        assert np.std(sizes) > 0.15
        assert spread(quiet, [small] * VIEWS, LIMIT) < 0.1


def test_noise_of_whole_lines_is_no_spread_once_it_is_named() -> None:
    """Columns of 4 mm noise: 112 of them leave the size of the map, which varies along the rows, uncertain by a sixth."""
    rng = np.random.default_rng(3)
    noisy = views(rng, np.broadcast_to(rng.normal(0, 0.004, (VIEWS, 1, SHAPE[1])), (VIEWS, *SHAPE)))
    assert spread(noisy, [MAP] * VIEWS, LIMIT) > 0.08
    assert spread(noisy, [MAP] * VIEWS, LIMIT, [(0, np.full(VIEWS, 0.004))]) < 0.03
    named = Finding(Noise(extra_m=0.004), 0.95, common=np.zeros((VIEWS, *SHAPE)))
    for findings, taken in (((), "wiggling"), ((named,), None)):
        found: Any = SimpleNamespace(solved=solved(noisy, {"wiggling": [MAP] * VIEWS}), findings=findings)
        assert uneven(found, replace(LIMIT, uneven_chance=0.5), NOISE) == taken


def test_views_without_the_effect_do_not_count() -> None:
    maps = [MAP if k % 2 else np.full(SHAPE, np.nan) for k in range(VIEWS)]
    sizes = np.where(np.arange(VIEWS) % 2, 1.0, 9.0)
    assert spread(of(sizes), maps, LIMIT) < 0.03


def test_few_views_tell_nothing() -> None:
    """Four views of an effect, of which two have none of it."""
    maps = [MAP if k < 4 else np.zeros(SHAPE) for k in range(VIEWS)]
    sizes = np.where(np.arange(VIEWS) < 2, 0.0, 1.0)
    assert spread(of(sizes), maps, LIMIT) == 0.0
    assert spread(of(sizes), maps, replace(LIMIT, uneven_views=3.0)) > 0.3
    assert spread(of(sizes), [np.zeros(SHAPE)] * VIEWS, LIMIT) == 0.0


@pytest.mark.parametrize(
    ("name", "off", "taken"),
    [
        ("lens_scatter", 0.1, False),
        ("lens_scatter", 0.18, True),
        ("subsurface", 0.18, False),  # a map of the scene is known less well
        ("subsurface", 0.3, True),
        ("motion", 1.0, False),  # acts at edges, which are not judged
    ],
)
def test_an_effect_is_taken_out_beyond_what_its_size_may_differ(name: str, off: float, *, taken: bool) -> None:
    found: Any = SimpleNamespace(solved=solved(of(1.0 + off * BY_TURNS), {name: [MAP] * VIEWS}), findings=())
    assert uneven(found, LIMIT, NOISE) == (name if taken else None)


@pytest.mark.parametrize(
    ("structure", "taken"), [(False, None), (True, "wiggling")], ids=["fringes of a placed lamp", "a field of each view"]
)
def test_fringes_of_a_lamp_are_no_unevenness_and_a_free_field_of_each_view_hides_none(*, structure: bool, taken: str | None) -> None:
    sizes = 1.0 + 0.5 * BY_TURNS
    light = Finding(Interference(burst_m=0.002), 0.95, common=(sizes - 1.0)[:, None, None] * MAP, structure=structure)
    found: Any = SimpleNamespace(solved=solved(of(sizes), {"wiggling": [MAP] * VIEWS}), findings=(light,))
    assert uneven(found, LIMIT, NOISE) == taken


def test_of_several_effects_the_one_that_differs_most_is_taken_out() -> None:
    """Waves along and across the image, of which one differs by half and the other by a tenth more than it may."""
    across = np.broadcast_to(0.004 * np.sin(np.linspace(0.0, 20.0, SHAPE[0]))[:, None], SHAPE)
    for worst, sizes in (("wiggling", (0.5, 0.3)), ("subsurface", (0.2, 0.8))):
        error = [sizes[0] * turn * WAVE + sizes[1] * turn * across for turn in BY_TURNS]
        bare = [replace(v, residual=v.residual + e) for v, e in zip(views(np.random.default_rng(1)), error, strict=True)]
        found: Any = SimpleNamespace(solved=solved(bare, {"wiggling": [WAVE] * VIEWS, "subsurface": [across] * VIEWS}), findings=())
        assert uneven(found, LIMIT, NOISE) == worst


def test_what_the_arm_may_have_taken_of_an_effect_is_no_unevenness() -> None:
    """A wave about 3 mm, of which the poses of every other view have taken 2 mm."""
    bare = [replace(v, residual=v.residual + 0.001 * turn) for v, turn in zip(views(np.random.default_rng(1)), BY_TURNS, strict=True)]
    of_scene = {"subsurface": [0.003 + WAVE] * VIEWS}
    for arm_m, taken in ((1e-6, "subsurface"), (0.001, None)):
        found: Any = SimpleNamespace(solved=solved(bare, of_scene, arm_m), findings=())
        assert uneven(found, replace(LIMIT, uneven_chance=0.5), NOISE) == taken


def test_a_wave_whose_size_differs_is_uneven_however_far_the_arm_is_off() -> None:
    found: Any = SimpleNamespace(solved=solved(of(1.0 + 0.3 * BY_TURNS, of_map=WAVE), {"wiggling": [WAVE] * VIEWS}, 0.003), findings=())
    assert uneven(found, LIMIT, NOISE) == "wiggling"


def test_what_another_effect_may_add_is_no_unevenness() -> None:
    """A map twice as large as a like one, whose size may differ by a tenth: a fifth of the smaller one's size."""
    bare = of(1.0 + 0.18 * BY_TURNS, of_map=WAVE)
    alone: Any = SimpleNamespace(solved=solved(bare, {"amplitude_bias": [WAVE] * VIEWS}), findings=())
    beside: Any = SimpleNamespace(solved=solved(bare, {"amplitude_bias": [WAVE] * VIEWS, "wiggling": [2.0 * WAVE] * VIEWS}), findings=())
    assert uneven(alone, LIMIT, NOISE) == "amplitude_bias"
    assert uneven(beside, LIMIT, NOISE) is None
