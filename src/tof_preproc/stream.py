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
from tof_preproc.lag import LagMonitor
from tof_preproc.preprocessor import Preprocessor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tof_core.capture import Capture, View
    from tof_core.tf import TransformBuffer
    from tof_core.topics import Topics
    from tof_preproc.config import PreprocConfig
    from tof_preproc.dwell import Dwell
    from tof_preproc.stream_config import StreamConfig


KEPT, ACCUMULATED = "kept", "accumulated"
"""Fates of a frame: it has a view of its own, or it is part of a later view of its dwell."""


@dataclass(frozen=True, slots=True, eq=False)
class Processed:
    """Result of one frame: a running view, or (`view` None) why there is none of its own; `unfiltered` where that is wanted.

    A frame that is kept has no view while nobody hears it (`PreprocStream.heard`).

    `last`: no later view belongs to its dwell. Where that shows after the view was given out, `PreprocStream.on_ended` says so.
    """

    stamp_ns: int
    fate: str
    view: View | None = None
    unfiltered: View | None = None
    capture: Capture | None = None
    why: str = ""
    last: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A capture that may be the last of its dwell: it has no view as long as that is open."""

    capture: Capture
    dwell: Dwell
    unfiltered: Dwell | None


class PreprocStream:
    """One camera's stream. Feed `builder` and `transforms`, then take what is `ready`.

    A frame is ready once no later message can change it: its parts have arrived and TF reaches beyond
    its motion window. So the result does not depend on the order in which topics arrive.
    """

    def __init__(
        self, config: StreamConfig, topics: Topics, transforms: TransformBuffer, *, need_tf: bool = True, view_every: int = 1
    ) -> None:
        """Nothing received yet; `view_every`: captures of a dwell from one view to the next, 0 for its last view alone."""
        self._view_every = view_every
        self.heard = True
        """Whether anybody hears the views: while nobody does, none is computed, and the fates of the frames are the same."""
        self._held: Held | None = None
        self._open: View | None = None
        self.on_ended: Callable[[View], None] = lambda _view: None
        """Called with the last view of a dwell once another has begun, unless the view was given out as the last."""
        self.config, self.transforms = config, transforms
        self.chain = RobotChain(transforms, config.input.cell_frame, config.input.body_frame)
        self.builder = CaptureBuilder(config.input, self.chain, topics, need_tf=need_tf, wait_s=math.inf, ahead_s=config.still.window_s)
        self.builder.on_skip = self._skipped
        self.preprocessor = Preprocessor(config.preproc)
        self._unfiltered: Preprocessor | None = None
        self._stations = StationTracker(config.station)
        self.lag = LagMonitor()
        """Whether images and TF move together."""
        self._ready: deque[Capture] = deque()
        self._fates: deque[Processed] = deque()
        self._jump = BackwardJump()

    def reset(self) -> None:
        """Start afresh: the clock was set back, or the user asked."""
        self._held = self._open = None
        self.builder.reset()
        self.preprocessor.reset()
        self.want_unfiltered(wanted=self._unfiltered is not None, anew=True)
        self._stations.reset()
        self.lag.reset()
        self.transforms.clear_dynamic()
        self._ready.clear()
        self._jump.clear()

    @property
    def jumped_back(self) -> bool:
        """Whether the frames' stamps show that the clock was set back."""
        return bool(self._jump)

    def configure(self, config: PreprocConfig) -> None:
        """Other filters from the next frame on; the dwell begins anew."""
        self.release(last=True)
        self._end_open()
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
        self.configure(self.preprocessor.config)

    @property
    def held_ns(self) -> int | None:
        """Stamp of the capture that has no view yet because others of its dwell may follow."""
        return None if self._held is None else self._held.capture.stamp_ns

    @property
    def waiting(self) -> set[int]:
        """Stamps of frames without a fate yet."""
        held = () if self._held is None else (self._held.capture,)
        return self.builder.waiting | {capture.stamp_ns for capture in (*self._ready, *held)}

    def release(self, *, last: bool = False) -> None:
        """The capture that is held gets its view: nothing follows (`last`), or not soon."""
        if self._held is not None:
            self._fates.append(self._viewed(self._held, last=last))
            self._held = None

    def _end_open(self) -> None:
        """The dwell whose views were given out has ended."""
        view, self._open = self._open, None
        if view is not None:
            self.on_ended(view)

    def give_up(self, stamp_ns: int) -> None:
        """Give out frames up to this stamp without waiting for their missing parts."""
        self.builder.overdue = max(self.builder.overdue, stamp_ns)

    def ready(self, *, final: bool = False) -> Iterator[Processed]:
        """Results of the frames that are ready, oldest first; `final` gives out all that are waiting."""
        self._build(final=final)
        yield from self._drain()
        while self._ready:
            yield from self._process(self._ready.popleft())
        if final:
            self.release()
            yield from self._drain()

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

    def _process(self, capture: Capture) -> list[Processed]:
        """What follows from a capture: the fate of the one before that was held, and its own unless it is held now."""
        still, station = self.standing(capture)
        if capture.robot is not None:
            self.lag.push(capture.stamp_ns, capture.depth, capture.robot.twist)
        dwell = self.preprocessor.add(capture, still=still, station=station)
        if dwell is None:
            return [Processed(capture.stamp_ns, FROZEN)]
        before, out = self._held, []
        if before is not None:
            goes_on = before.dwell is dwell
            out.append(Processed(before.capture.stamp_ns, ACCUMULATED) if goes_on else self._viewed(before, last=True))
        if self._open is not None and self._open.dwell_ns != dwell.first.stamp_ns:
            self._end_open()
        unfiltered = None if self._unfiltered is None else self._unfiltered.add(capture, still=still, station=station)
        held = Held(capture, dwell, unfiltered)
        if dwell.ended or (self._view_every and dwell.captures % self._view_every == 0):
            self._held = None
            return [*out, self._viewed(held, last=dwell.ended)]
        self._held = held
        return out

    def _viewed(self, held: Held, *, last: bool) -> Processed:
        if not self.heard:
            self._open = None
            return Processed(held.capture.stamp_ns, KEPT, capture=held.capture, last=last)
        view = self.preprocessor.view(held.dwell)
        self._open = None if last else view
        unfiltered = None if held.unfiltered is None else held.unfiltered.view()[0]
        return Processed(held.capture.stamp_ns, KEPT, view, unfiltered, held.capture, last=last)

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
        return still, self._stations.push(capture.robot.T_cell_body)
