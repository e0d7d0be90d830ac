# SPDX-License-Identifier: Apache-2.0
"""Effects that a session tested and does not show."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from tof_gap.solved import Bound
from tof_gap.tell.report.absent import absent, absent_words
from tof_sensor.registry import VOCABULARY


def found() -> Any:
    """An account with `wiggling`, which may be `amplitude_bias`, a small `multipath`, and `noise` as a finding."""
    cause = SimpleNamespace(named=SimpleNamespace(name="wiggling", ties=("amplitude_bias",)))
    return SimpleNamespace(solved=SimpleNamespace(small=("multipath",)), findings=(SimpleNamespace(name="noise"),), causes=(cause,))


def test_every_tested_effect_that_is_not_shown_is_absent_with_its_bound() -> None:
    out = absent(found(), {"lens_scatter": Bound(4e-4), "wiggling": Bound(3e-3)}, {"motion", "z_conversion"})
    assert out["lens_scatter"] == Bound(4e-4)
    assert out["dropout"] is None
    assert set(VOCABULARY) - out.keys() == {"wiggling", "amplitude_bias", "multipath", "noise", "motion", "z_conversion"}


def test_what_could_hide_more_than_a_named_effect_has_is_said_apart() -> None:
    bounds = {
        "lens_scatter": Bound(4e-4),
        "dropout": None,
        "subsurface": Bound(1.5e-3, 1),
        "multipath": Bound(7e-4),
        "emitter_offset": Bound(6.4e-3),
        "range_offset": Bound(0.1),
    }
    assert absent_words(bounds, ("wall", "valve"), 1.0) == [
        (
            "not testable in these views: range offset (poses or the named effects make the same error, whatever its size; "
            "views from other distances, angles and times tell them apart)"
        ),
        "not found, but could hide behind noise, poses or the named effects: emitter offset (up to 6.4 mm), subsurface (up to 1.5 mm on valve)",
        "tested and not found, each below 1 mm RMS: lens scatter, multipath",
        "tested and not found: dropout",
    ]


def test_nothing_is_said_where_everything_is_shown() -> None:
    assert absent_words({}, (), 1.0) == []
