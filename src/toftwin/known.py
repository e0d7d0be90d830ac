# SPDX-License-Identifier: Apache-2.0
"""The source of the labels' poses: the mode, the known effects of the camera, and the effects that a diagnosis finds."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path  # noqa: TC003 (a field of a setting that other processes read)
from typing import TYPE_CHECKING

from tof_core.config import to_mapping
from tof_core.errors import UsageError
from tof_core.hashing import digest_config, digest_file

if TYPE_CHECKING:
    from tof_scene.scene import Scene
    from tof_sensor.known import KnownBias
    from tof_sensor.model import SensorModel
    from toftwin.pipeline import PipelineConfig

MODES = {"final": "session", "causal": "session", "per_view": "per_view", "robot": "robot"}
"""Modes of labelling and the alignment mode of each."""
POSE_SOURCES = {"final": "session, final", "causal": "session, causal", "per_view": "per view", "robot": "robot"}


def bias_in(scene: Scene | None, path: Path | str | None) -> KnownBias | None:
    """The bias of a `sensor.yaml`; a line on stderr states the effects that are not removed in this scene."""
    from tof_sensor.known import known_bias, scene_note

    bias = known_bias(path)
    note = "" if bias is None or scene is None else scene_note(bias.model, scene.digest)
    if note:
        print(note, file=sys.stderr)
    return bias


@dataclass(frozen=True, slots=True)
class Known:
    """Prior knowledge of the camera.

    sensor: its `sensor.yaml`, None where nothing is known; joint: whether the session is diagnosed, and the poses solved together
    with the effects that the diagnosis names.
    """

    sensor: Path | None = None
    joint: bool = False

    @property
    def model(self) -> SensorModel | None:
        """The effects of `sensor`."""
        if self.sensor is None:
            return None
        from tof_sensor.model import load_model

        return load_model(self.sensor)

    @property
    def bias(self) -> KnownBias | None:
        """The bias of these effects."""
        model = self.model
        if model is None:
            return None
        from tof_sensor.known import KnownBias

        return KnownBias(model)

    def scene_note(self, scene: str) -> str:
        """The effects that are not removed in the scene of this digest, in a sentence; empty without any."""
        model = self.model
        if model is None:
            return ""
        from tof_sensor.known import scene_note

        return scene_note(model, scene)

    def check(self, mode: str) -> None:
        """Refuse a joint solution of anything but a whole session, and poses of the robot alone with a sensor model."""
        if self.joint and mode != "final":
            raise UsageError(f"a joint solution needs the whole session, not mode {mode}", where="--joint", todo="leave out --mode")
        if self.sensor is not None and mode == "robot":
            raise UsageError("mode robot takes poses from TF alone and uses no sensor model", where="--sensor", todo="leave it out")

    def digest(self, config: PipelineConfig) -> str:
        """Digest of the settings and of the sensor model's content."""
        if self.sensor is None:
            return digest_config(config)
        return digest_config({"config": to_mapping(config), "sensor": digest_file(self.sensor)})

    def source(self, mode: str) -> str:
        """Source of the poses, as the dataset records it."""
        return POSE_SOURCES[mode] + (", with the effects of the diagnosis" if self.joint else "")
