# SPDX-License-Identifier: Apache-2.0
"""Why a pixel of a label may not be trained on: one byte a pixel."""

from __future__ import annotations

from enum import IntEnum


class LabelReason(IntEnum):
    """Codes of `views/reason`; 0 is a pixel with mask 1. Of several reasons the first that applies, in the order of the codes, but `ABSENT` goes before `UNCERTAIN`."""

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
    """Of a part that is not there, by all views."""
    FOREIGN = 7
    """Measured before the CAD: an object that the CAD lacks, a hand, a displaced part."""
    BEHIND = 8
    """Measured behind the CAD: something is missing there, or displaced."""
    DISPLACED = 9
    """Of a part that stands elsewhere: something of its size is measured beside its place, which is empty."""


WORLD = (LabelReason.ABSENT, LabelReason.FOREIGN, LabelReason.BEHIND, LabelReason.DISPLACED)
"""Reasons that say that the world is not as the CAD has it."""
