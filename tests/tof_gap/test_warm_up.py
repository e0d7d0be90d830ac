# SPDX-License-Identifier: Apache-2.0
"""Warming up a diagnosis compiles the kernels that its sessions need."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tof_gap import warm_up
from tof_gap.seen.evidence import level
from tof_gap.seen.foreign import lamp_light
from tof_gap.session import diagnose_session
from tof_scene import planes
from tof_scene.world import contradiction
from tof_sensor import interreflection, patches
from tof_sensor.effects import flying_pixels, motion

if TYPE_CHECKING:
    import pytest

    from tof_gap.tell.diagnosis import Diagnosis

KERNELS = (
    contradiction._medians,
    flying_pixels._nearest,
    interreflection._gather,
    lamp_light.gains_at,
    lamp_light.waves_from,
    level._binned,
    level._differences,
    motion._taps,
    patches._bounced,
    patches._exchanged,
    patches.facing_pairs,
    planes.ways_between,
)


def test_it_diagnoses_one_small_session_and_leaves_no_kernel_to_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Diagnosis] = []

    def noted(*args: Any) -> Diagnosis:
        made.append(diagnose_session(*args))
        return made[-1]

    monkeypatch.setattr(warm_up, "diagnose_session", noted)
    warm_up.warm_up()
    assert [len(d.account.solved.evidence) for d in made] == [warm_up.STILL + warm_up.MOVING]
    assert all(kernel.signatures for kernel in KERNELS)
