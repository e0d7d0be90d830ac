# SPDX-License-Identifier: Apache-2.0
"""A strength of 1 is 3 mm RMS over the affected pixels, whatever the effect; 3.3 is 10 mm."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_virtual.made import biases, session
from tests.vocabulary import EFFECT_NAMES
from tof_core.errors import UsageError
from tof_virtual.config import VirtualConfig
from tof_virtual.effect import rms
from tof_virtual.effects import EFFECTS, make_effects

SIZED = [n for n, e in EFFECTS.items() if not e.natural]


def test_every_effect_has_a_name_of_the_vocabulary() -> None:
    assert set(EFFECTS) <= EFFECT_NAMES
    assert len(EFFECTS) >= 24  # an effect to come may be tested on other data, none that is here may go


@pytest.mark.parametrize("name", SIZED)
def test_strength_one_is_three_millimetres(name: str) -> None:
    made = session({name: 1.0})
    error = biases(made, name)
    if EFFECTS[name].geometric or name == "motion":  # depth jumps where an edge moved; the strength is about surfaces
        change = np.abs(error)
        error[change > 8 * np.nanmedian(change[change > 1e-7])] = np.nan
        for k, shutter in enumerate(made.shutters):
            error[k, made.sight(shutter, made.effects).edge] = np.nan
    assert 1e3 * rms(error.ravel(), local=EFFECTS[name].local) == pytest.approx(3.0, rel=0.12)


@pytest.mark.parametrize("name", ["wiggling", "amplitude_bias", "multipath", "hand_eye"])
def test_large_is_ten_times_small(name: str) -> None:
    sizes = {s: rms(biases(session({name: s}), name).ravel(), local=EFFECTS[name].local) for s in (1 / 3, 10 / 3)}
    if name != "hand_eye":
        assert sizes[10 / 3] / sizes[1 / 3] == pytest.approx(10, rel=0.1)
    assert sizes[10 / 3] > 3 * sizes[1 / 3]


def test_zero_is_off_and_unknown_names_are_refused() -> None:
    assert make_effects({"wiggling": 0.0}, VirtualConfig()) == ()
    with pytest.raises(UsageError, match="effect 'wobble' is not known; use one of"):
        make_effects({"wobble": 1.0}, VirtualConfig())
    with pytest.raises(UsageError, match="out of bounds"):
        make_effects({"wiggling": -1.0}, VirtualConfig())


def test_effects_together_keep_the_size_that_each_has_alone() -> None:
    alone = {n: session({n: 1.0}).effects[0].size for n in ("wiggling", "amplitude_bias")}
    both = {e.name: e.size for e in session({"wiggling": 1.0, "amplitude_bias": 1.0}).effects}
    assert both == alone


def test_random_parts_of_an_effect_follow_the_seed() -> None:
    phases = [session({"wiggling": 1.0}, seed=s).effects[0].params()["psi_rad"] for s in (0, 0, 1)]
    assert phases[0] == phases[1] != phases[2]
