# SPDX-License-Identifier: Apache-2.0
"""Views in, labels out: causal while the session runs, final once it is over."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tof_align.config import AlignConfig
from tof_core.config import section
from tof_sim_label.config import LabelConfig
from tof_sim_label.gate import RadialGate
from tof_sim_label.label import Label, label_view

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_align.session import SessionSolution
    from tof_core.capture import View
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


class Labeller:
    """One session. `push` labels with what came before (live); `finish` with all of it (training).

    Views are kept until `finish` and without their colour: 2 MB each at 400 x 300.
    """

    def __init__(self, caster: Raycaster, config: LabellerConfig | None = None) -> None:
        from tof_align.causal import SessionAligner

        self.config = config or LabellerConfig()
        self._caster = caster
        self._aligner = SessionAligner(caster, self.config.align)
        self._gate = RadialGate()
        self._views: list[View] = []

    def push(self, view: View) -> Label:
        """The label of this view from it and the views before it.

        Raises:
            RefusedError: nothing of the view sees the CAD (the session goes on with the next view);
                or its depth is radial, not z.
            TransformError: the view has no robot pose.
        """
        self._gate.check(view)
        view = replace(view, colour=None)
        posed = self._aligner.push(view)
        self._views.append(view)
        return label_view(view, posed, self._caster, self.config.label)

    def finish(self) -> tuple[SessionSolution, Iterator[tuple[View, Label]]]:
        """The solution of the whole session, and its views with their final labels, one at a time.

        Raises:
            RefusedError: the session fits the CAD nowhere, or there is none.
        """
        solution = self._aligner.finish()
        return solution, self._labels(solution)

    def _labels(self, solution: SessionSolution) -> Iterator[tuple[View, Label]]:
        for view, posed in zip(self._views, solution.posed, strict=True):
            yield view, label_view(view, posed, self._caster, self.config.label)
