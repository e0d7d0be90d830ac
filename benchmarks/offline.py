# SPDX-License-Identifier: Apache-2.0
"""The graph without ROS: the messages that its nodes would publish for a bag, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_preproc.stream import PreprocStream
from tof_sim_label.stream import LabelStream

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from tof_core.bag import BagReader
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster
    from tof_sim_label.stream import Labelled
    from toftwin.pipeline import PipelineConfig


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """One output of the graph: its topic, the frame's stamp, its array."""

    topic: str
    stamp_ns: int
    values: NDArray[Any]


def graph_outputs(reader: BagReader, config: PipelineConfig, caster: Raycaster | None) -> Iterator[Output]:
    """What `preproc` and (with a scene) `sim_label` would publish, frame by frame."""
    stream = PreprocStream(config, reader.topics, reader.transforms, need_tf=caster is not None)
    stream.chain, stream.builder.chain = reader.chain, reader.chain
    labels = LabelStream(caster, config.labeller) if caster is not None else None
    for view in _views(reader, stream):
        yield from _view_outputs(view)
        if labels is not None:
            yield from _label_outputs(labels.push(view))
    if labels is not None:
        yield from _label_outputs(labels.flush())


def _views(reader: BagReader, stream: PreprocStream) -> Iterator[View]:
    t, builder = reader.topics, stream.builder
    takes = {t.info: builder.info, t.depth: builder.depth, t.points: builder.points, t.amplitude: builder.amplitude}
    for message in reader.messages(tuple(name for name in takes if name)):
        takes[message.topic](reader.deserialize(message))
        yield from (p.view for p in stream.ready() if p.view is not None)
    yield from (p.view for p in stream.ready(final=True) if p.view is not None)


def _view_outputs(view: View) -> Iterator[Output]:
    for name in ("depth", "sigma", "count", "reason", "amplitude"):
        if (values := getattr(view, name)) is not None:
            yield Output(f"/preproc/{name}", view.stamp_ns, values)


def _label_outputs(labelled: Labelled | None) -> Iterator[Output]:
    if labelled is None or labelled.label is None:
        return
    label, stamp = labelled.label, labelled.view.stamp_ns
    for name in ("depth", "sigma", "mask", "part"):
        yield Output(f"/label/{name}", stamp, getattr(label, name))
    if label.posed.accepted:
        yield Output("/label/pose", stamp, np.concatenate([label.posed.T_cell_camera.ravel(), label.posed.cov.ravel()]))
