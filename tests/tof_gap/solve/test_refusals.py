# SPDX-License-Identifier: Apache-2.0
"""A session that fits the scene nowhere is refused, and a wrong unit is named."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sensor.plane import plane_frame
from tof_core.capture import Capture, View
from tof_core.errors import RefusedError
from tof_gap.limits.evidence import EvidenceLimits
from tof_gap.limits.solve import StartLimits
from tof_gap.seen.evidence.residual import gather
from tof_gap.solve.start import check_fit

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence


def evidence(factor: float, offset: float = 0.0, repeat: int = 3) -> tuple[ViewEvidence, ...]:
    """Views of a plane measured `factor` times too far, plus an offset in metres."""
    frame = plane_frame()
    depth = (factor * frame.depth + offset).astype(np.float32)
    view = View.of_capture(Capture(0, frame.camera, depth, np.zeros(depth.shape, np.uint8)))
    rendering = replace(frame.rendering)
    return gather([view] * repeat, [rendering] * repeat, None, EvidenceLimits(edge_px=0))  # type: ignore[arg-type]


def test_a_session_on_its_scene_passes() -> None:
    assert 3 * plane_frame().depth.size > StartLimits().pixels
    check_fit(evidence(1.0, 0.004), StartLimits())


def test_a_wrong_unit_is_named() -> None:
    with pytest.raises(RefusedError, match=r"depth is 10 times what the scene expects.*--depth-scale"):
        check_fit(evidence(10.0), StartLimits())


def test_another_scene_is_refused() -> None:
    with pytest.raises(RefusedError, match="fits this scene nowhere"):
        check_fit(evidence(1.0, 0.15), StartLimits())
