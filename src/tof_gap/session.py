# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of a session whose camera is partly known: by a sensor.yaml and by the calibration beside the scene."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from tof_align.known import known_removed
from tof_core.calibration import Calibration, calibration_beside
from tof_gap.diagnose import diagnose
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.known import KnownBias, scene_note
from tof_sensor.origin import check_camera, differences
from tof_sensor.stated import NOTHING_STATED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tof_align.config import AlignConfig
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.seen.finding import Finding
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import SensorModel


def diagnose_session(
    views: Sequence[View],
    caster: Raycaster,
    config: GapConfig,
    align: AlignConfig,
    *,
    known: SensorModel | None = None,
    left_out: frozenset[str] = frozenset(),
    progress: Callable[[str], None] = lambda _: None,
    untestable: Mapping[str, str] = MappingProxyType({}),
    given: Sequence[Finding] = (),
) -> Diagnosis:
    """Remove the bias of the effects in `known` that hold in this scene, diagnose the rest; noise and loss are compared with theirs.

    Arguments as of `diagnose`.

    CameraInfo may state another lens than when `known` was fitted: one of them is wrong, which is what a diagnosis finds out.
    """
    if known is not None and views:
        check_camera(known.camera, views[0].camera, any_lens=True)
        if differs := differences(known.camera, views[0].camera):
            progress(f"sensor.yaml was fitted with another lens in camera_info ({', '.join(differs)}): one of them is wrong")
        if note := scene_note(known, caster.scene.digest):
            progress(note)
        known = replace(known.holding_in(caster.scene.digest), camera=None)
    stated = NOTHING_STATED if known is None else known.stated
    if known is not None and known.names != (PhotonLaw.NAME,):  # the law of the noise has no bias
        progress("removing known effects")
        recorded, views = views, known_removed(views, caster, KnownBias(known), align)
        stated = replace(stated, removed_mm=_apart_mm(recorded, views))
    if config.calibration == Calibration():
        config = replace(config, calibration=calibration_beside(caster.scene.folder))
    return diagnose(views, caster, config, align, left_out, progress, untestable=untestable, stated=stated, given=given)


def _apart_mm(before: Sequence[View], after: Sequence[View]) -> float:
    """Millimetres: RMS difference in depth of the pixels that both have."""
    apart = [(b.depth - a.depth)[np.isfinite(b.depth) & np.isfinite(a.depth)] for b, a in zip(before, after, strict=True)]
    return 1e3 * float(np.sqrt(np.mean(np.concatenate(apart) ** 2))) if sum(map(len, apart)) else 0.0
