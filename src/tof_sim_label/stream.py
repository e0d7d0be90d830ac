# SPDX-License-Identifier: Apache-2.0
"""From running views to a label for each dwell that has ended: the work of the node, without ROS."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_align.causal import SessionAligner
from tof_core.camera import Camera
from tof_core.capture import Capture, RobotPose, View
from tof_core.errors import RefusedError, ToftwinError
from tof_scene.builtin.shapes import box
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene import Part, Scene
from tof_sim_label.gate import RadialGate
from tof_sim_label.label import Label, label_view
from tof_sim_label.labeller import LabellerConfig

if TYPE_CHECKING:
    from tof_align.known import Bias


@dataclass(frozen=True, slots=True, eq=False)
class Labelled:
    """A view with its label, or (`label` None) the reason why it has none."""

    view: View
    label: Label | None
    why: str = ""


class LabelStream:
    """Labels the last view of each dwell: when the next dwell begins, or on request.

    Each pose is computed from this view and those before it. No views are kept for a final solution, so memory does
    not grow with time.
    """

    def __init__(self, caster: Raycaster, config: LabellerConfig | None = None, bias: Bias | None = None) -> None:
        """No view yet; `bias`: what is known of the camera, removed before a pose is solved."""
        self._caster, self._config, self._bias = caster, config or LabellerConfig(), bias
        self.reset()

    def reset(self) -> None:
        """Forget the session."""
        self._aligner = SessionAligner(self._caster, self._config.align, bias=self._bias)
        self._gate = RadialGate()
        self._pending: View | None = None

    def push(self, view: View) -> Labelled | None:
        """Take a running view. If it begins a new dwell, return the previous dwell, labelled."""
        ended = self.ended(view)
        return None if ended is None else self.label(ended)

    def flush(self) -> Labelled | None:
        """Label the current view."""
        view = self.current()
        return None if view is None else self.label(view)

    def ended(self, view: View) -> View | None:
        """Take a running view. If it begins a new dwell, return the last view of the previous one."""
        before, self._pending = self._pending, view
        return before if before is not None and before.dwell_ns != view.dwell_ns else None

    def current(self) -> View | None:
        """The view that waits for the end of its dwell; it waits no longer."""
        view, self._pending = self._pending, None
        return view

    def label(self, view: View) -> Labelled:
        """Label a view that was taken; while one thread does so, another may take views."""
        try:
            self._gate.check(view)
            posed = self._aligner.push(view)
        except RefusedError as error:
            return Labelled(view, None, str(error))
        finally:
            self._aligner.samples.clear()
        return Labelled(view, label_view(view, posed, self._caster, self._config.label))


def warm_up(caster: Raycaster) -> None:
    """Before frames arrive: the kernels of alignment and labels, by a view of two boxes, and the tables of the scene.

    The first time the kernels are compiled. A view of a large scene would take several times as long as loading them does.
    """
    boxes = Raycaster(_two_boxes())
    camera, T = Camera(40, 30, 37.5, 37.5, 19.5, 14.5), np.eye(4)
    T[:3, :3] = [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]  # along -x of the cell
    T[0, 3] = 0.9
    depth = render(boxes, camera, T).depth
    view = View.of_capture(Capture(1, camera, depth, np.zeros(depth.shape, np.uint8), RobotPose(np.eye(4), T)))
    with suppress(ToftwinError):
        stream = LabelStream(boxes)
        stream.push(view)
        stream.flush()
    _ = caster.outline, caster.curvature
    caster.cast(np.zeros((1, 3)), np.ones((1, 3)))


def _two_boxes() -> Scene:
    vertices, faces = box((0.6, 0.5, 0.4))
    return Scene("cell", (Part("large", vertices, faces), Part("small", 0.3 * vertices + [0.35, 0.0, 0.1], faces)))
