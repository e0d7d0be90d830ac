# SPDX-License-Identifier: Apache-2.0
"""A bag of ideal depth through a sensor model into another bag: `sensor/depth`, `sensor/amplitude`, `sensor/camera_info`."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass, field
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.bag_writer import BagWriter
from tof_core.config import section
from tof_core.errors import RefusedError
from tof_core.options import BagOptions
from tof_core.progress import progress
from tof_sensor.normals import NORMALS_KIND, Normals
from tof_sensor.simulator import Simulator, SimulatorConfig
from toftwin.inputs import must_have_frames

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.arrays import Image
    from tof_core.bag import BagReader
    from tof_core.capture import Capture
    from tof_scene.raycast import Raycaster

DEPTH, AMPLITUDE, INFO = "/sensor/depth", "/sensor/amplitude", "/sensor/camera_info"


@dataclass(frozen=True, slots=True)
class SensingConfig:
    """Topics of the ideal bag, and the camera."""

    input: BagOptions = section(BagOptions, "topics, frames and units")
    sensor: SimulatorConfig = section(SimulatorConfig, "the simulated camera")


@dataclass(slots=True)
class Tally:
    """Counts of a bag's frames and pixels; notes: what the ideal bag lacks, and what is done instead."""

    effects: tuple[str, ...]
    without_effect: tuple[str, ...]
    notes: list[str] = field(default_factory=list)
    frames: int = 0
    pixels: int = 0
    lost: int = 0
    change2_m2: float = 0.0
    seconds: list[float] = field(default_factory=list)

    def add(self, ideal: Capture, measured: Capture, seconds: float) -> None:
        """Count one frame."""
        seen, change = np.isfinite(ideal.depth), measured.depth - ideal.depth
        self.frames += 1
        self.pixels += int(seen.sum())
        self.lost += int((seen & np.isnan(measured.depth)).sum())
        self.change2_m2 += float(np.nansum(np.square(change.astype(np.float64))))
        self.seconds.append(seconds)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        kept = max(self.pixels - self.lost, 1)
        return {
            "frames": self.frames,
            "effects": list(self.effects),
            "without_effect": list(self.without_effect),
            "notes": self.notes,
            "lost": self.lost / max(self.pixels, 1),
            "rms_mm": 1e3 * float(np.sqrt(self.change2_m2 / kept)),
            "ms_per_frame": 1e3 * median(self.seconds) if self.seconds else None,
        }


def sense_bag(reader: BagReader, out: Path, config: SimulatorConfig, caster: Raycaster | None = None, *, normals_topic: str = "") -> Tally:
    """Pass every frame of a bag through the simulated camera; the new bag holds the other messages unchanged.

    Args:
        reader: ideal depth; its amplitude topic holds what `config.light` says.
        out: folder of the new bag.
        config: the camera.
        caster: the scene, where the bag's TF reaches it.
        normals_topic: images of unit normals (32FC3, camera frame); empty finds them from the depth.

    Raises:
        RefusedError: no frame can be read, the camera is not that of the model, or its unit of amplitude is not known. Then no bag is written.
    """
    camera = Simulator.load(config, caster)
    tally = Tally(camera.model.names, camera.without_effect)
    ideal = {reader.topics.depth, reader.topics.points, reader.topics.amplitude, normals_topic}
    try:
        with BagWriter(out) as bag:
            for m in reader.messages():
                if m.topic not in ideal:
                    bag.raw(m.topic, m.type, m.cdr, m.stamp_ns)
            captures = reader.captures(need_tf=caster is not None, repeats=True)
            for capture, normal in _with_normals(progress(captures, "sensor", reader.frame_count), reader, normals_topic):
                tally.notes = tally.notes or camera.notes(capture)
                started = time.process_time()
                measured = camera.measured(capture, normal)
                tally.add(capture, measured, time.process_time() - started)
                write_measured(bag, measured)
        must_have_frames(tally.frames, reader, "sensor")
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise
    return tally


def _with_normals(captures: Iterator[Capture], reader: BagReader, topic: str) -> Iterator[tuple[Capture, Image | None]]:
    """Captures with the normals of their stamp, None where the bag has none for it."""
    if not topic:
        yield from ((c, None) for c in captures)
        return
    if reader.types.get(topic) != NORMALS_KIND:
        raise RefusedError(f"has no images on {topic}", where="--normals-topic", todo=f"its topics: {', '.join(sorted(reader.types))}")
    normals, coming = Normals(reader.options.join_s), reader.messages((topic,))
    for capture in captures:
        while not normals.settled(capture.stamp_ns) and (message := next(coming, None)) is not None:
            normals.put(reader.deserialize(message))
        yield capture, normals.at(capture)


def write_measured(bag: BagWriter, measured: Capture) -> None:
    """Write one frame, as the node `sensor` publishes it."""
    frame, stamp = measured.camera.frame_id, measured.stamp_ns
    bag.image(DEPTH, measured.depth, "32FC1", frame, stamp)
    assert measured.amplitude is not None
    bag.image(AMPLITUDE, measured.amplitude, "32FC1", frame, stamp)
    bag.camera_info(INFO, measured.camera, stamp)
