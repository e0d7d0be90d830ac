# SPDX-License-Identifier: Apache-2.0
"""Views in, labels out: causal while the session runs, final once it is over."""

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

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.session import SessionSolution
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True)
class LabellerConfig:
    """How views are posed and labelled."""

    align: AlignConfig = section(AlignConfig, "where the camera was")
    label: LabelConfig = section(LabelConfig, "what its label holds")

    @property
    def pose_source(self) -> str:
        """What the dataset says of its poses, when they come from `finish`."""
        return {"session": "session, final", "per_view": "per view", "robot": "robot"}[self.align.mode]


Labels = Iterator[tuple[View, Label]]
"""Views with their labels, rendered one at a time as they are asked for."""


def label_session(views: Sequence[View], caster: Raycaster, config: LabellerConfig | None = None) -> tuple[SessionSolution, Labels]:
    """Final labels of a whole session (batch): its solution, and its views with their labels.

    Raises:
        RefusedError: the session fits the CAD nowhere, there is none, or its depth is radial, not z.
        TransformError: a view has no robot pose.
    """
    from tof_align.session import solve_session

    config = config or LabellerConfig()
    gate = RadialGate()
    for view in views:
        gate.check(view)
    solution = solve_session(views, caster, config.align)
    return solution, _labels(views, solution, caster, config)


class Labeller:
    """One session as it runs. `push` labels with what came before (live); `finish` with all of it (training).

    Views are kept until `finish`, without their colour: 2 MB each at 400 x 300.
    """

    def __init__(self, caster: Raycaster, config: LabellerConfig | None = None) -> None:
        from tof_align.causal import SessionAligner

        self.config = config or LabellerConfig()
        self._caster = caster
        self._aligner = SessionAligner(caster, self.config.align)
        self._gate = RadialGate()
        self._views: list[View] = []

    def push(self, view: View) -> Label:
        """The causal label of this view, from it and the views before it.

        A view that does not fit the CAD is labelled where the robot and the views before it say,
        with nothing in its mask.

        Raises:
            RefusedError: its depth is radial, not z.
            TransformError: it has no robot pose.
        """
        self._gate.check(view)
        view = replace(view, colour=None)
        posed = self._aligner.push(view)
        self._views.append(view)
        return label_view(view, posed, self._caster, self.config.label)

    def finish(self) -> tuple[SessionSolution, Labels]:
        """The solution of the whole session, and its views with their final labels.

        Raises:
            RefusedError: the session fits the CAD nowhere, or there is none.
        """
        solution = self._aligner.finish()
        return solution, _labels(self._views, solution, self._caster, self.config)


def _labels(views: Sequence[View], solution: SessionSolution, caster: Raycaster, config: LabellerConfig) -> Labels:
    for view, posed in zip(views, solution.posed, strict=True):
        yield view, label_view(view, posed, caster, config.label)
