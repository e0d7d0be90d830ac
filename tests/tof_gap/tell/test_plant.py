# SPDX-License-Identifier: Apache-2.0
"""The verdict in a plant's words: mechanism, place, size, remedy, cost."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.tell.plant import Words, cost, plant_words, where
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene

SCENE = cast("Scene", SimpleNamespace(parts=[SimpleNamespace(name=n) for n in ("panel", "pipe")]))
MAP = np.broadcast_to(np.linspace(0.0, 0.010, SHAPE[0] * SHAPE[1]).reshape(SHAPE), (VIEWS, *SHAPE))


def diagnosis() -> Diagnosis:
    evidence = views(np.random.default_rng(1))
    wave = Wiggling(sine_m=0.003, cosine_m=0.004, modulation_mhz=100.0)
    cause = SimpleNamespace(named=SimpleNamespace(name="wiggling", effects=(wave,)), size_m=0.004)
    finding = SimpleNamespace(name="dropout", effect=Dropout(threshold=120.0, random=0.02))
    made = {"evidence": evidence, "residual": [v.residual for v in evidence], "shares": {"wiggling": MAP}}
    return cast("Diagnosis", SimpleNamespace(causes=(cause,), findings=(finding,), **made))


def test_each_effect_is_said_with_its_size_place_remedy_and_cost() -> None:
    wiggling, dropout = plant_words(diagnosis(), SCENE)
    assert wiggling.size == "±5.0 mm every 0.37 m of range"
    assert wiggling.where == "on panel"
    assert wiggling.cost == "one pixel in twenty is measured 9.5 mm off or more"
    assert dropout.size == "2% of the pixels at random, most below amplitude 120"
    assert (dropout.where, dropout.cost) == ("", "")
    assert wiggling.sentence() == (
        "Wiggling: range error that swings with distance: harmonics of the modulation (±5.0 mm every 0.37 m of range; on panel). "
        f"To do: {Wiggling.REMEDY}. Left as it is: one pixel in twenty is measured 9.5 mm off or more."
    )


def test_an_effect_of_few_pixels_costs_by_how_many_they_are() -> None:
    few = np.zeros((VIEWS, *SHAPE))
    few[:, :2, :] = 0.005
    share = 100.0 * 2 / SHAPE[0]
    assert cost(diagnosis(), list(few)) == f"{share:.1g} % of the pixels are measured 1 mm off or more"


def test_what_is_not_known_is_not_said() -> None:
    assert Words("noise", "more noise", "", "", "", "").sentence() == "Noise: more noise."


def test_pixels_without_a_measurement_have_no_cost() -> None:
    lost = cast("Diagnosis", SimpleNamespace(residual=[np.full(SHAPE, np.nan)]))
    assert cost(lost, [MAP[0]]) == ""


@pytest.mark.parametrize(("shared", "place"), [(0.0, "on panel"), (1.0, "on panel and pipe")])
def test_the_parts_that_carry_most_of_it_are_named(shared: float, place: str) -> None:
    d = diagnosis()
    for v in d.evidence:
        v.rendering.part[:, : SHAPE[1] // 2] = 1
    size = np.ones((VIEWS, *SHAPE)) * 0.005
    size[:, :, : SHAPE[1] // 2] *= shared
    assert where(d, list(size), SCENE) == place
