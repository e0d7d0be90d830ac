# SPDX-License-Identifier: Apache-2.0
"""The field that a camera measures: wide cameras light a circle or a hexagon, and no pixel outside of it ever returns."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import label

from tof_core.reasons import Reason

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Mask
    from tof_core.capture import View

LEAST_VIEWS = 8
"""Fewest views that tell a field: what fewer look at may lie in the dark at the same corner of the image."""
LEAST_SHARE = 0.01
"""Least share of the image outside of the field. In 120 sessions of a camera that measures its whole image, weak light leaves at most 0.1 %
at the image's border without a return in twenty views."""


def within_field(views: Sequence[View]) -> list[View]:
    """The views, pixels outside of the camera's field with a reason of their own: they are no lost pixels."""
    outside = outside_field(views)
    if outside is None:
        return list(views)
    return [replace(v, reason=np.where(outside & ~v.valid, np.uint8(Reason.OUT_OF_FIELD), v.reason)) for v in views]


def outside_field(views: Sequence[View]) -> Mask | None:
    """(H, W) pixels that no view has a depth of, joined to the image's border by such pixels; None where they are few, or the views are."""
    if len(views) < LEAST_VIEWS:
        return None
    areas, _ = label(~np.logical_or.reduce([v.valid for v in views]))
    at_border = np.unique(np.concatenate([areas[0], areas[-1], areas[:, 0], areas[:, -1]]))
    outside = np.isin(areas, at_border[at_border > 0])
    return outside if outside.mean() >= LEAST_SHARE else None
