# SPDX-License-Identifier: Apache-2.0
"""The node `preproc`: subscribes to depth images or clouds, publishes the running view of each dwell."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, Temperature, TimeReference
from tf2_msgs.msg import TFMessage

from tof_core.builder import FROZEN, NO_TRANSFORM
from tof_core.decode import stamp_ns
from tof_core.options import NOT_WANTED
from tof_core.tf import TransformBuffer
from tof_preproc.config import stages_of
from tof_preproc.live import PreprocNodeConfig, colour_topics, input_topics
from tof_preproc.preprocessor import warm_up
from tof_preproc.stream import ACCUMULATED, KEPT, PreprocStream, Processed
from tof_ros import messages, qos
from tof_ros.base import LEFT_OVER, RoomNode
from tof_ros.depth_output import DepthOutput
from tof_ros.patience import NEVER, Patience
from tof_ros.recorder import RecordService
from tof_ros.ticker import Ticker
from tof_ros.transforms import TransformListener

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.capture import View

NAME = "preproc"
OUTPUTS = {
    "depth": Image,
    "sigma": Image,
    "count": Image,
    "reason": Image,
    "amplitude": Image,
    "camera_info": CameraInfo,
    "points": PointCloud2,
    "dwell": TimeReference,
}
"""Topics under `preproc/`. `dwell` names the view: time_ref is its first capture's stamp, source the rest of what it is."""
IMAGES = {"depth": "32FC1", "sigma": "32FC1", "count": "16UC1", "reason": "8UC1", "noise": "32FC1", "amplitude": "32FC1"}
"""Rasters of a view with their encoding."""
FILTERED_TOPICS = {name: name for name in ("sigma", "count", "reason", "amplitude")}
UNFILTERED_TOPICS = {name: f"unfiltered_{name}" for name in ("depth", "sigma", "count", "reason", "noise")}
"""The topic of each raster; depth itself also goes out compressed."""
UNFILTERED = dict.fromkeys(UNFILTERED_TOPICS.values(), Image)
"""The same view accumulated without any filter, which the node `gap` diagnoses; computed only while subscribed."""
TYPED = {"dwell_info": "Dwell"}
"""The dwell with typed fields (toftwin_msgs)."""
CONFIG = PreprocNodeConfig


class PreprocNode(RoomNode[PreprocNodeConfig]):
    """Accumulates and filters one camera's stream (docs/nodes/preproc.md)."""

    rest_s = 0.005

    def __init__(self, **options: Any) -> None:
        """Subscribe; topics are relative and remappable, spot_ros2's names by default."""
        super().__init__(NAME, "preproc", PreprocNodeConfig, fixed=("input.", "still.", "station.", "live."), **options)
        self._topics = input_topics(self.config.input)
        self._arrivals: dict[int, float] = {}
        self._patience, self._hold = Patience(self.config.live.patience_s), Patience(self.config.preproc.motion.max_gap_s)
        self._accumulated = 0
        self._ticker = Ticker(self, self._tick)
        self._last_info, self._since_info = float("-inf"), 0
        self._stream = PreprocStream(
            self.config,
            replace(self._topics, amplitude=self.config.input.amplitude_topic.removesuffix(NOT_WANTED)),
            TransformBuffer(self.config.input.max_gap_s, keep_s=self.config.live.keep_tf_s),
            need_tf=self.config.live.need_tf,
            view_every=self.config.live.view_every,
        )
        self._stream.on_ended = partial(self._publish_dwell, ended=True)
        ahead_ns = round(self.config.still.window_s * 1e9)
        self._tf = TransformListener(self, self._stream.transforms, self._advance, lambda: self._patience.oldest + ahead_ns)
        self._outputs = {name: self.output(name, kind) for name, kind in (OUTPUTS | UNFILTERED).items()}
        self._depth = DepthOutput(self, "depth", self._outputs["depth"], lambda: self.config.live.depth_code)
        self._dwell_info = self.typed("dwell_info", TYPED["dwell_info"])
        warm_up()  # the first time this compiles for some 20 s: before frames arrive, not while they wait
        self._subscribe()
        self._say_stages()
        self.service("capture", self._end_dwell)
        self.service("flush", self.flush)
        self._recordings = RecordService(
            self, lambda: self.config.live.record, "session", self._raw_topics(), qos.sensor(reliable=self.config.live.reliable, depth=64)
        )

    def _raw_topics(self) -> list[tuple[str, type[Any]]]:
        t = self._topics
        colour, colour_info = colour_topics(self.config.input)
        images = [(name, messages.image_class(name)) for name in (t.depth, t.amplitude, colour)]
        raw = [*images, (t.points, PointCloud2), (t.info, CameraInfo), (colour_info, CameraInfo), (t.temperature, Temperature)]
        return [(name, kind) for name, kind in raw if name] + [("/tf", TFMessage), ("/tf_static", TFMessage)]

    def _subscribe(self) -> None:
        t, sensor = self._topics, qos.sensor(reliable=self.config.live.reliable, depth=32)
        builder = self._stream.builder
        if t.depth:
            self.input(t.depth, messages.image_class(t.depth), lambda m: self._frame(m, builder.depth), sensor, frames="input.depth_topic")
        else:
            self.input(t.points, PointCloud2, lambda m: self._frame(m, builder.points), sensor, frames="input.points_topic")
        self.input(t.info, CameraInfo, self._info, sensor)
        if t.amplitude:
            self.input(t.amplitude, messages.image_class(t.amplitude), self._amplitude, sensor)
        if t.temperature:
            self.input(t.temperature, Temperature, builder.temperature, sensor)
        self.hearing.begin()

    def _frame(self, message: Any, take: Any) -> None:
        arrived = self.tally.arrived()
        if self.left_over(stamp_ns(message)):
            self.skip(stamp_ns(message), LEFT_OVER)
            return
        self._since_info += 1
        self._arrivals[stamp_ns(message)] = arrived
        self._patience.start(stamp_ns(message))
        self._ticker.start()
        self._look_who_hears()
        take(message)
        self._advance()

    def _look_who_hears(self) -> None:
        """What nobody is subscribed to is not computed."""
        self._stream.want_unfiltered(wanted=any(self._outputs[name].get_subscription_count() for name in UNFILTERED))
        outputs = [*self._outputs.values(), *([self._dwell_info] if self._dwell_info else [])]
        self._stream.heard = self._depth.heard or any(output.get_subscription_count() for output in outputs)

    def _info(self, message: CameraInfo) -> None:
        self._stream.builder.info(message)
        self._last_info, self._since_info = time.monotonic(), 0
        self._advance()

    def _amplitude(self, message: Any) -> None:
        builder = self._stream.builder
        if not builder.topics.amplitude:  # seen for the first time: from now on it is waited for
            builder.topics = replace(builder.topics, amplitude=self._topics.amplitude)
        builder.amplitude(message)
        self._advance()

    def _advance(self, *, final: bool = False) -> None:
        """Publish what has become ready."""
        for processed in self._stream.ready(final=final):
            self._publish(processed)
        if self._hold.oldest != (held := self._stream.held_ns):
            self._hold.clear()
            if held is not None:
                self._patience.end(held)
                self._hold.start(held)
        if self._stream.jumped_back:
            self.jumped()

    def _tick(self) -> bool:
        """Give out frames whose missing parts, or the rest of whose dwell, did not arrive in time; whether a frame still waits."""
        self._stream.give_up(self._patience.tick())
        if self._hold.tick() != NEVER:
            self._stream.release()
        self._advance()
        return bool(self._patience or self._hold)

    def _publish(self, processed: Processed) -> None:
        if processed.fate == FROZEN and processed.stamp_ns in self._stream.waiting:
            self.skip(processed.stamp_ns, FROZEN)  # the second of a stamp; the first one still waits
            return
        arrived = self._arrivals.pop(processed.stamp_ns, time.monotonic())
        self._patience.end(processed.stamp_ns)
        if processed.fate == ACCUMULATED:
            self._accumulated += 1
            self.answer(processed.stamp_ns, ACCUMULATED)
            return
        if processed.view is None and processed.fate != KEPT:
            self.skip(processed.stamp_ns, processed.fate, processed.why)
            return
        if processed.unfiltered is not None:
            self._publish_images(processed.unfiltered, UNFILTERED_TOPICS)
        if processed.view is not None:
            self._publish_view(processed.view, last=processed.last)
        self.done(processed.stamp_ns, arrived)

    def _publish_images(self, view: View, topics: Mapping[str, str]) -> None:
        """Rasters of a view, each on its topic."""
        head = messages.header(view.stamp_ns, view.camera.frame_id)
        for name, topic in topics.items():
            if (array := getattr(view, name)) is not None:
                self.offer(self._outputs[topic], partial(messages.image, array, IMAGES[name], head))

    def _publish_view(self, view: View, *, last: bool) -> None:
        head = messages.header(view.stamp_ns, view.camera.frame_id)
        self._depth.offer(view.depth, head)
        self._publish_images(view, FILTERED_TOPICS)
        self.offer(self._outputs["camera_info"], lambda: messages.camera_info(view.camera, head))
        self.offer(
            self._outputs["points"], lambda: messages.points(view.camera.points(view.depth).astype(np.float32), head, view.amplitude)
        )
        about = f"station={view.station} captures={view.captures} amplitude={int(view.amplitude is not None)}"
        self.offer(
            self._outputs["dwell"],
            lambda: messages.time_reference(view.stamp_ns, view.dwell_ns, about, view.camera.frame_id),
            now="dwell_info",
        )
        self._publish_dwell(view, ended=last)

    def _publish_dwell(self, view: View, *, ended: bool) -> None:
        """The dwell of a view; once more where its end shows after the view was published."""
        if self._dwell_info is not None and self._dwell_info.get_subscription_count():
            from tof_ros.results import dwell

            self._dwell_info.publish(dwell(view, messages.header(view.stamp_ns, view.camera.frame_id), ended=ended))

    def on_config(self, config: PreprocNodeConfig) -> None:
        """New filters take effect with the next frame."""
        self._stream.configure(config.preproc)
        self._hold = Patience(config.preproc.motion.max_gap_s)
        self._say_stages()

    def destroy_node(self) -> None:
        """Stop listening to TF, then go."""
        self._tf.close()
        super().destroy_node()

    def reset(self) -> str:
        """Discard the running dwell, and forget stations and transforms."""
        if hasattr(self, "_stream"):
            self._stream.reset()
            self.forget_frames(self._arrivals)
            self._patience.clear()
            self._hold.clear()
        return "dwell, stations and transforms are forgotten"

    def flush(self) -> str:
        """Give out every frame that waits, as at the end of a bag."""
        waiting = len(self._arrivals)
        self._advance(final=True)
        return f"{waiting} frames waited"

    def _end_dwell(self) -> str:
        self._stream.end_dwell()
        self._advance()
        return "the next frame begins a new dwell"

    def _stages(self) -> list[str]:
        """The stages that are on, in their order."""
        config = self.config.preproc.resolved
        return [s for s in stages_of(config.order) if getattr(getattr(config, s, None), "enable", True)]

    def _say_stages(self) -> None:
        every = self.config.live.view_every
        views = "a view of each dwell" if every == 0 else "a view after each capture" if every == 1 else f"a view after {every} captures"
        self.get_logger().info(f"stages in their order: {', '.join(self._stages())}; {views}")

    def figures(self) -> Mapping[str, str]:
        """What the stages removed from the latest view, how old TF is, frames that are part of a later view alone."""
        stages = " ".join(self._stages())
        removed = {f"removed.{stage}": str(count) for stage, count in sorted(self._stream.preprocessor.counts.items())}
        waits = {"waiting": str(len(self._arrivals)), "accumulated": str(self._accumulated)}
        return {"stages": stages, "tf_age_s": f"{self._tf.age:.2f}", **waits, **removed}

    def warnings(self) -> list[str]:
        """Frames without camera_info or without TF; images and TF by different clocks."""
        out, t = [], self._topics
        if self._since_info >= 10 and self.tally.last_arrival - max(self._last_info, self.tally.first_arrival) > 2.0:
            frames, info = self.resolve_topic_name(t.depth or t.points), self.resolve_topic_name(t.info)
            out.append(f"{frames} is seen, but no {info} for 2 s: is it published, and does its QoS match?")
        if self._stream.builder.skipped[NO_TRANSFORM]:
            out.append(f"transform: {self._stream.builder.last_error}")
        if (lag := self._stream.lag.lag()) is not None:
            out.append(str(lag))
        return out


def make_node(**options: Any) -> PreprocNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return PreprocNode(**options)
