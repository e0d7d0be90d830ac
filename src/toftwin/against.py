# SPDX-License-Identifier: Apache-2.0
"""Diagnosis of a simulator's bag in the scene of the real session."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.bag import open_bag
from tof_core.errors import UsageError
from tof_core.options import BagOptions
from tof_scene.board import FRAME
from toftwin.diagnosis import diagnose_bag

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.camera import Camera
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import SensorModel
    from toftwin.diagnosis import GapPipelineConfig


def diagnose_simulated(
    bag: str,
    caster: Raycaster,
    camera: Camera,
    config: GapPipelineConfig,
    *,
    known: SensorModel | None = None,
    left_out: frozenset[str] = frozenset(),
    progress: Callable[[str], None],
) -> Diagnosis:
    """The diagnosis of a simulator's session at its own poses; its topics are found by type and name, independent of the real bag's.

    `camera`: the real session's. Lenses may differ, since each session is diagnosed with its own CameraInfo; maps of pixels need one size.
    `known`: the sensor with which the real session is diagnosed. The simulator's is diagnosed with the same one, so that an effect of
    this sensor that the simulator has too is no difference.

    Raises:
        UsageError: the scene is a calibration board, or the simulator's images have another size.
        RefusedError: the session supports no diagnosis.
    """
    scene = caster.scene
    if scene.frame == FRAME:
        raise UsageError(
            "a simulator's bag cannot be compared before a board", where="--against", todo="compare sessions of a CAD scene (--scene)"
        )
    with open_bag(bag, BagOptions(), cell_frame=scene.frame, placed=scene.placed_in) as reader:
        if reader.camera.shape != camera.shape:
            sizes = [f"{c.width}x{c.height}" for c in (reader.camera, camera)]
            raise UsageError(
                f"the simulator's images have {sizes[0]} pixels, and the camera's {sizes[1]}",
                where="--against",
                todo="simulate the camera at its own resolution",
            )
        return diagnose_bag(reader, scene, config, known=known, left_out=left_out, progress=progress)[0]
