# SPDX-License-Identifier: Apache-2.0
"""Pixels that no point of the camera falls on, since a driver registered its depth to another camera: no pixels that the camera lost."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.reasons import Reason
from tof_core.registered_holes import holed, holes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.capture import View
    from tof_gap.seen.evidence.view import ViewEvidence


HIDDEN = "a driver registered depth to another camera and left holes, which hide what the camera loses: record the depth camera's own image"
"""Why the loss of pixels is not testable."""


def between_points(views: Sequence[View]) -> list[View]:
    """The views, holes of registered depth with a reason of their own; as they are where their holes make no grid."""
    if not holed([v.valid for v in views]):
        return list(views)
    return [replace(v, reason=np.where(holes(v.valid), np.uint8(Reason.BETWEEN_POINTS), v.reason)) for v in views]


def hides_loss(views: Sequence[ViewEvidence]) -> bool:
    """Whether holes of registered depth hide what the camera loses."""
    return any((v.view.reason == Reason.BETWEEN_POINTS).any() for v in views)
