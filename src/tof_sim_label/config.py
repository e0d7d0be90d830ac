# SPDX-License-Identifier: Apache-2.0
"""Configuration of labels: uncertainty beside the pose, and masking."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_scene.world.limits import WorldLimits


@dataclass(frozen=True, slots=True)
class LabelConfig:
    """Parameters of the label at a solved pose."""

    cad_sigma_mm: float = param(0.1, "standard deviation of the real surface from its CAD, along the normal", unit="mm", low=0.0, high=50.0)
    unseen_offset_mm: float = param(
        2.0,
        "standard deviation of the label by a constant range offset of the camera, which a session from one side does not determine "
        "(an offset of 3 mm moves the label of a panel by 2 mm); lower it if a calibration on a reference states less",
        unit="mm",
        low=0.0,
        high=100.0,
    )
    open_mm: float = param(
        2.0,
        "standard deviation of the labels without the unseen offset (median of a session) from which toftwin label prints a warning",
        unit="mm",
        low=0.0,
        high=100.0,
        why="0 to 1.4 mm in sessions whose labels were within 1.2 mm; 3.8 and 7 mm under multipath, whose labels were 3.9 and 5.8 mm off",
    )
    lens_px: float = param(
        0.1,
        "difference of the session's lens from camera_info, anywhere in the image, from which toftwin label prints a note",
        unit="px",
        low=0.0,
        why="corners of a good calibration fit to 0.1 px",
    )
    edge_px: float = param(0.05, "least uncertainty of a silhouette in the image", unit="px", low=0.0, high=5.0)
    max_incidence_deg: float = param(85.0, "labels seen at a flatter angle are masked", unit="deg", low=0.0, high=90.0)
    max_sigma_mm: float = param(
        10.0, "labels with a larger sigma are masked: at silhouettes the pose decides which surface a pixel sees", unit="mm", low=0.01
    )
    world: WorldLimits = section(WorldLimits, "where measurement and CAD contradict each other")
