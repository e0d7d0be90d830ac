# SPDX-License-Identifier: Apache-2.0
"""Why a pixel of a label may not be trained on: one byte a pixel."""

from __future__ import annotations

from enum import IntEnum


class LabelReason(IntEnum):
    """Codes of `views/reason`; 0 is a pixel with mask 1. If several apply, the lowest code is stored, but `ABSENT` before `UNCERTAIN`."""

    USABLE = 0
    POSE = 1
    """The pose of the view was refused."""
    NO_CAD = 2
    """The ray misses the CAD."""
    ROBOT = 3
    """The robot's own gripper."""
    GRAZING = 4
    """The CAD is seen at too flat an angle."""
    UNCERTAIN = 5
    """The label's sigma is too large: a silhouette."""
    ABSENT = 6
    """Pixel of a part that is absent by all views."""
    FOREIGN = 7
    """Measured before the CAD: an object that the CAD lacks, a hand, a displaced part."""
    BEHIND = 8
    """Measured behind the CAD: something is missing there, or displaced."""
    DISPLACED = 9
    """Pixel of a displaced part: its place is empty, and an object of its size is measured beside."""


WORLD = (LabelReason.ABSENT, LabelReason.FOREIGN, LabelReason.BEHIND, LabelReason.DISPLACED)
"""Reasons by which measurement and CAD contradict each other."""
