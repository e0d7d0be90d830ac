# SPDX-License-Identifier: Apache-2.0
"""The running views of `preproc`, received by another node: joined by stamp, with the robot's pose from TF."""

from __future__ import annotations

import math
import time
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import CameraInfo, Image, TimeReference

from tof_core.builder import LATE
from tof_core.decode import stamp_ns
from tof_core.errors import ToftwinError, TransformError
from tof_core.jump import BackwardJump
from tof_core.live import has_amplitude, view_of
from tof_ros import qos
from tof_ros.base import LEFT_OVER
from tof_ros.interfaces import own_message
from tof_ros.joiner import StampJoiner
from tof_ros.overrun import OVERRUN, Numbered, Overrun, waited_s
from tof_ros.patience import NEVER, Patience
from tof_ros.ticker import Ticker
from tof_ros.transforms import IDLE_REST_S, TransformListener

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from tof_core.capture import View
    from tof_core.robot import RobotChain
    from tof_ros.managed import ManagedNode

TYPED_DWELL = own_message("Dwell")
DWELL = "dwell" if TYPED_DWELL is None else "dwell_info"
"""The topic of the dwell; without toftwin_msgs the one that ends with the next release."""
REQUIRED = ("depth", "sigma", "count", "reason", "camera_info", DWELL)
KINDS = {**dict.fromkeys((*REQUIRED, "amplitude"), Image), "camera_info": CameraInfo, DWELL: TYPED_DWELL or TimeReference}
VIEW_A_DWELL = "Let preproc send the last view of each dwell alone (--param preproc.live.view_every=0; ros2 run: -p live.view_every:=0), or lower the camera's rate."
"""What makes fewer views, for a node that is slower than they come."""
UNFILTERED = {name: f"unfiltered_{name}" for name in ("depth", "sigma", "count", "reason", "noise")}
"""Topics of a view without filters, by part."""


class ViewFeed:
    """Hears `preproc/*` and TF for a node, and hands it each view in the order of stamps.

    A view waits for its transform; one that never gets it is skipped and counted. The node's tally and its `done` topic are served here.
    It ends with what else the node's `start` began.
    """

    def __init__(
        self,
        node: ManagedNode[Any],
        chain: RobotChain,
        patience_s: float,
        take: Callable[[View], None],
        camera: Callable[[str], None],
        *,
        unfiltered: bool = False,
        relief: str = "",
    ) -> None:
        """Subscribe.

        Args:
            node: whose inputs these are.
            chain: frames and transforms of the session.
            patience_s: longest wait of a view for its parts and its transform, seconds.
            take: called with each view, in the node's thread.
            camera: receives the frame of each view, also of a view without a transform.
            unfiltered: take the views that `preproc` accumulates without its filters, with their noise.
            relief: what else helps where the node is slower than views come, as an imperative sentence.
        """
        self._node, self._chain, self._take, self._camera = node, chain, take, camera
        # Patience is counted in this node's own turns: one that was held up finds the missing parts in its queues.
        topics = UNFILTERED if unfiltered else {}
        parts = dict.fromkeys((*KINDS, *topics))
        self._joiner = StampJoiner([part for part in parts if part != "amplitude"], patience_s=math.inf)
        self._joiner.on_incomplete = self._incomplete
        self._jump = BackwardJump()
        self._waiting: deque[tuple[int, dict[str, Any]]] = deque()
        self._arrivals: dict[int, float] = {}
        self._patience, self._overdue = Patience(patience_s), NEVER
        self._transforms = TransformListener(node, chain.transforms, self.advance, lambda: self._patience.oldest, idle_rest_s=IDLE_REST_S)
        self._overrun = Overrun(qos.OUTPUT.depth, f"{VIEW_A_DWELL} {relief}".strip())
        node.warns.append(self._overrun.warning)
        node.at_stop.append(self.close)
        self._numbered: dict[str, Numbered] = {}
        for part in parts:
            topic = f"preproc/{topics.get(part, part)}"
            frames = "" if part == "depth" else None
            heard = node.input(
                topic, KINDS.get(part, Image), partial(self._part, part), qos.OUTPUT, frames=frames, about=partial(self._number, part)
            )
            self._numbered[part] = Numbered(partial(node.count_publishers, heard.topic_name))
        self._ticker = Ticker(node, self._tick)

    def _number(self, part: str, message: Any, info: Mapping[str, Any]) -> None:
        """Count the views whose messages were pushed out of the queue before this one."""
        missing = self._numbered[part].take(info.get("publication_sequence_number"), stamp_ns(message))
        if missing and part == "depth":
            self._node.tally.lose(OVERRUN, missing)
            self._overrun.lose(missing, waited_s(info))

    def _part(self, part: str, message: Any) -> None:
        stamp = stamp_ns(message)
        if self._node.left_over(stamp):
            if part == "depth":
                self._node.tally.arrived()
                self._node.skip(stamp, LEFT_OVER)
            return
        if part == "depth":
            self._camera(message.header.frame_id)
            self._arrivals[stamp] = self._node.tally.arrived()
            self._patience.start(stamp)
            self._ticker.start()
        if part == DWELL and has_amplitude(message):
            self._joiner.expect("amplitude")
        if self._joiner.add(part, stamp, message):
            self.advance()
        elif part == "depth":
            self._late(stamp)

    def _late(self, stamp: int) -> None:
        self._arrivals.pop(stamp, None)
        self._patience.end(stamp)
        self._node.skip(stamp, LATE)
        self._jump.late(stamp, self._joiner.newest)
        if self._jump:
            self._node.jumped()

    def _incomplete(self, stamp: int, lacking: frozenset[str]) -> None:
        self._patience.end(stamp)
        if self._arrivals.pop(stamp, None) is None:  # its depth never came: counted as lost where a later one shows it
            return
        if any(self._numbered[part].lacks(stamp) for part in lacking):
            self._node.skip(stamp, OVERRUN)
            self._overrun.lose(1, 0.0)
        else:
            self._node.skip(stamp, "incomplete", f"no {', '.join(f'preproc/{part}' for part in sorted(lacking))} came with its stamp")

    def _tick(self) -> bool:
        """Give up waiting for what does not come; whether a view still waits."""
        self._overdue = max(self._overdue, self._patience.tick())
        self.advance()
        return bool(self._patience)

    def advance(self) -> None:
        """Take every view whose transform is there."""
        self._waiting.extend(self._joiner.take(overdue=self._overdue))
        while self._waiting:
            stamp, parts = self._waiting[0]
            try:
                view = view_of(stamp, parts, self._chain)
            except TransformError as error:
                if stamp > self._overdue and not self._chain.settled(parts["depth"].header.frame_id, stamp):
                    return
                self._skip(stamp, "no transform", error)
                continue
            except ToftwinError as error:
                self._skip(stamp, "bad view", error)
                continue
            self._leave(stamp)
            self._jump.clear()
            self._take(view)
            self._node.done(stamp, self._arrivals.pop(stamp, time.monotonic()))

    def _skip(self, stamp: int, reason: str, why: ToftwinError) -> None:
        self._leave(stamp)
        self._arrivals.pop(stamp, None)
        self._node.skip(stamp, reason, str(why))

    def _leave(self, stamp: int) -> None:
        self._waiting.popleft()
        self._patience.end(stamp)

    def reset(self) -> None:
        """Forget what waits, and where everything was."""
        self._joiner.clear()
        self._waiting.clear()
        self._node.forget_frames(self._arrivals)
        self._patience.clear()
        self._jump.clear()
        self._overdue = NEVER
        self._chain.transforms.clear_dynamic()

    def close(self) -> None:
        """Listen to TF no more; the subscriptions are the node's."""
        self._node.warns.remove(self._overrun.warning)
        self._node.forget_frames(self._arrivals)
        self._transforms.close()

    def figures(self) -> dict[str, str]:
        """How old TF is, and how many views lacked a part."""
        return {"tf_age_s": f"{self._transforms.age:.2f}", "incomplete": str(self._joiner.incomplete)}
