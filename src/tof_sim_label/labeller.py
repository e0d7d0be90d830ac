# SPDX-License-Identifier: Apache-2.0
"""Labels of all views of a session; `stream` labels view by view."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tof_align.config import AlignConfig
from tof_core.capture import View
from tof_core.config import section
from tof_sim_label.config import LabelConfig
from tof_sim_label.gate import RadialGate
from tof_sim_label.label import Label, label_view
from tof_sim_label.world import missing_named, session_surprises

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.known import Bias
    from tof_align.session import SessionSolution
    from tof_core.capture import Posed
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True)
class LabellerConfig:
    """Configuration of poses and labels."""

    align: AlignConfig = section(AlignConfig, "pose of the camera")
    label: LabelConfig = section(LabelConfig, "uncertainty and mask of the label")


Labels = Iterator[tuple[View, Label]]
"""Views with their labels, rendered one at a time on demand."""


def label_session(
    views: Sequence[View], caster: Raycaster, config: LabellerConfig | None = None, bias: Bias | None = None
) -> tuple[SessionSolution, Labels]:
    """Final labels of a whole session (batch): its solution, and its views with their labels.

    bias: known bias of the camera, removed before the poses are solved.

    Raises:
        RefusedError: the session fits the CAD nowhere, there is none, or its depth is radial, not z.
        TransformError: a view has no robot pose.
    """
    from tof_align.known import known_removed, through_known
    from tof_align.session import solve_session

    config = config or LabellerConfig()
    gate = RadialGate()
    for view in views:
        gate.check(view)
    clean = views if bias is None else known_removed(views, caster, bias, config.align)
    solution = solve_session(clean, caster, config.align)
    if bias is not None:
        solution = replace(solution, posed=through_known(solution.posed, views, bias))
    return solution, labels_at(views, solution.posed, caster, config)


def labels_at(views: Sequence[View], posed: Sequence[Posed], caster: Raycaster, config: LabellerConfig) -> Labels:
    """The views with their labels from known cameras."""
    world = session_surprises(views, posed, caster, config.label)
    for view, pose, codes in zip(views, missing_named(posed, world, caster.scene.names), world.pixels, strict=True):
        yield view, label_view(view, pose, caster, config.label, codes)
