# SPDX-License-Identifier: Apache-2.0
"""Why a pixel has no depth: one byte a pixel, kept from the sensor to the label."""

from __future__ import annotations

from enum import IntEnum


class Reason(IntEnum):
    """Codes of the uint8 reason map; 0 is a valid pixel. Published as they stand."""

    VALID = 0
    NO_RETURN = 1
    """The sensor gave 0 or NaN."""
    SATURATED = 2
    """The sensor gave its largest code (65535) or +inf."""
    OUT_OF_RANGE = 3
    """Outside the configured range, or -inf (too close)."""
    IQR = 4
    THREE_SIGMA = 5
    SOR = 6
    FLYING = 7
    """Between two surfaces at a depth edge."""
    GRAZING = 8
    """Seen at too flat an angle."""
    SELF = 9
    """The robot's own gripper."""
    MASKED_AMPLITUDE = 11
    """Amplitude below or above the configured bounds."""
    NOT_CAD = 12
    """On an object that differs from the CAD: at a missing part, on a foreign object."""
    OUT_OF_FIELD = 13
    """Outside of the field that the camera lights: no depth in any view of a session."""
    BETWEEN_POINTS = 14
    """Between the points of a depth image that a driver registered to a camera of more pixels, and left unfilled."""
