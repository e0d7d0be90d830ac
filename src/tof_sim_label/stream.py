# SPDX-License-Identifier: Apache-2.0
"""Running views in, a label for each dwell that has ended: what the node does, without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_align.causal import SessionAligner
from tof_core.errors import RefusedError
from tof_sim_label.gate import RadialGate
from tof_sim_label.label import Label, label_view
from tof_sim_label.labeller import LabellerConfig

if TYPE_CHECKING:
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True, eq=False)
class Labelled:
    """A view with its label, or (`label` None) why it has none."""

    view: View
    label: Label | None
    why: str = ""


class LabelStream:
    """Labels the last view of each dwell: when the next dwell begins, or when asked.

    Causal, with the numbers of `Labeller.push`; but nothing is kept for a final solution, so that memory stays
    the same however long the node runs.
    """

    def __init__(self, caster: Raycaster, config: LabellerConfig | None = None) -> None:
        """No view yet."""
        self._caster, self._config = caster, config or LabellerConfig()
        self.reset()

    def reset(self) -> None:
        """Forget the session."""
        self._aligner = SessionAligner(self._caster, self._config.align)
        self._gate = RadialGate()
        self._pending: View | None = None

    def push(self, view: View) -> Labelled | None:
        """Take a running view; gives the dwell before it, labelled, if this one begins a new dwell."""
        before, self._pending = self._pending, view
        return self._label(before) if before is not None and before.dwell_ns != view.dwell_ns else None

    def flush(self) -> Labelled | None:
        """Label what has been accumulated so far."""
        view, self._pending = self._pending, None
        return None if view is None else self._label(view)

    def _label(self, view: View) -> Labelled:
        try:
            self._gate.check(view)
            posed = self._aligner.push(view)
        except RefusedError as error:
            return Labelled(view, None, str(error))
        finally:
            self._aligner.samples.clear()
        return Labelled(view, label_view(view, posed, self._caster, self._config.label))
