# SPDX-License-Identifier: Apache-2.0
"""From messages of one camera to running views: the work of the node, without ROS."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tof_core.builder import FROZEN, LATE, CaptureBuilder
from tof_core.errors import ToftwinError
from tof_core.jump import BackwardJump
from tof_core.motion import MotionConfig, StationTracker, is_slow, is_still
from tof_core.robot import RobotChain
from tof_preproc.preprocessor import Preprocessor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.capture import Capture, View
    from tof_core.tf import TransformBuffer
    from tof_core.topics import Topics
    from tof_preproc.config import PreprocConfig
    from tof_preproc.stream_config import StreamConfig


@dataclass(frozen=True, slots=True, eq=False)
class Processed:
    """Result of one frame: a running view, or (`view` None) the reason why there is none; `unfiltered` where that is wanted."""

    stamp_ns: int
    fate: str
    view: View | None = None
    unfiltered: View | None = None
    capture: Capture | None = None
    why: str = ""


class PreprocStream:
    """One camera's stream. Feed `builder` and `transforms`, then take what is `ready`.

    A frame is ready once no later message can change it: its parts have arrived and TF reaches beyond
    its motion window. So the result does not depend on the order in which topics arrive.
    """

    def __init__(self, config: StreamConfig, topics: Topics, transforms: TransformBuffer, *, need_tf: bool = True) -> None:
        """Nothing received yet."""
        self.config, self.transforms = config, transforms
        self.chain = RobotChain(transforms, config.input.cell_frame, config.input.body_frame)
        self.builder = CaptureBuilder(config.input, self.chain, topics, need_tf=need_tf, wait_s=math.inf, ahead_s=config.still.window_s)
        self.builder.on_skip = self._skipped
        self.preprocessor = Preprocessor(config.preproc)
        self._unfiltered: Preprocessor | None = None
        self._stations = StationTracker(config.station)
        self._ready: deque[Capture] = deque()
        self._fates: deque[Processed] = deque()
        self._jump = BackwardJump()

    def reset(self) -> None:
        """Start afresh: the clock was set back, or the user asked."""
        self.builder.reset()
        self.preprocessor.reset()
        self.want_unfiltered(wanted=self._unfiltered is not None, anew=True)
        self._stations.reset()
        self.transforms.clear_dynamic()
        self._ready.clear()
        self._jump.clear()

    @property
    def jumped_back(self) -> bool:
        """Whether the frames' stamps show that the clock was set back."""
        return bool(self._jump)

    def configure(self, config: PreprocConfig) -> None:
        """Other filters from the next frame on; the dwell begins anew."""
        self.preprocessor = Preprocessor(config)
        self.want_unfiltered(wanted=self._unfiltered is not None, anew=True)

    def want_unfiltered(self, *, wanted: bool, anew: bool = False) -> None:
        """Whether each view is also accumulated without any filter, as a diagnosis of the sensor needs it."""
        if not wanted:
            self._unfiltered = None
        elif self._unfiltered is None or anew:
            self._unfiltered = Preprocessor(replace(self.preprocessor.config, order="accumulate"))

    def end_dwell(self) -> None:
        """The next frame begins a new dwell."""
        self.preprocessor = Preprocessor(self.preprocessor.config)
        self.want_unfiltered(wanted=self._unfiltered is not None, anew=True)

    def give_up(self, stamp_ns: int) -> None:
        """Give out frames up to this stamp without waiting for their missing parts."""
        self.builder.overdue = max(self.builder.overdue, stamp_ns)

    def ready(self, *, final: bool = False) -> Iterator[Processed]:
        """Results of the frames that are ready, oldest first; `final` gives out all that are waiting."""
        self._build(final=final)
        yield from self._drain()
        while self._ready:
            yield self._process(self._ready.popleft())

    def _build(self, *, final: bool) -> None:
        """Captures from the builder; one that cannot be read costs that frame only."""
        while True:
            try:
                for capture in self.builder.ready(final=final):
                    self._ready.append(capture)
                    self._jump.clear()
            except ToftwinError as error:
                reason = type(error).__name__.removesuffix("Error").lower()
                self._fates.append(Processed(self.builder.last_stamp, f"bad {reason}", why=str(error)))
                continue
            return

    def _skipped(self, stamp_ns: int, reason: str) -> None:
        self._fates.append(Processed(stamp_ns, reason, why=self.builder.last_error if reason not in (FROZEN, LATE) else ""))
        if reason == LATE:
            self._jump.late(stamp_ns, self.builder.last_stamp)

    def _drain(self) -> Iterator[Processed]:
        while self._fates:
            yield self._fates.popleft()

    def _process(self, capture: Capture) -> Processed:
        still, station = self.standing(capture)
        frozen = self.preprocessor.events["frozen"]
        view = self.preprocessor.push(capture, still=still, station=station)
        if self.preprocessor.events["frozen"] > frozen:
            return Processed(capture.stamp_ns, FROZEN)
        unfiltered = None if self._unfiltered is None else self._unfiltered.push(capture, still=still, station=station)
        return Processed(capture.stamp_ns, "kept", view, unfiltered, capture)

    def standing(self, capture: Capture) -> tuple[bool, int]:
        """Whether the camera stands still, and at which station."""
        if capture.robot is None:
            return True, 0
        gate = self.config.still
        if gate.window_s == MotionConfig().window_s:  # over which the robot's twist was taken
            still = is_slow(capture.robot.twist, gate)
        else:
            cell, _ = self.chain.resolve(capture.camera.frame_id)
            still = is_still(self.transforms, cell, capture.camera.frame_id, capture.stamp_ns, gate)
        return still, self._stations.push(capture.stamp_ns, capture.robot.T_cell_body)
