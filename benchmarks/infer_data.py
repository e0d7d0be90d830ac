# SPDX-License-Identifier: Apache-2.0
"""Virtual sessions for training and for the sweep: one camera with its own errors, many scenes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import from_mapping
from tof_virtual.config import VirtualConfig

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from tof_scene.scene import Scene
    from tof_virtual.session import Session
    from tof_virtual.twin import TwinCamera

EXACT_ROBOT = {
    f"robot.{name}": 0.0
    for name in (
        "base_min_mm",
        "base_max_mm",
        "base_deg",
        "base_tilt_deg",
        "base_height_mm",
        "arm_mm",
        "arm_deg",
        "repeat_mm",
        "repeat_deg",
    )
}
"""A robot that stands where it believes to stand: its poses label the training data, and no truth is opened."""


def make_session(scene: Scene, camera: TwinCamera, *, seed: int, settings: Mapping[str, object]) -> Session:
    """A session of this camera before this scene."""
    from tof_virtual.session import Session
    from toftwin.commands.simulate import bodies_of

    session = Session(bodies_of(scene), from_mapping(VirtualConfig, {"seed": seed, **settings}, where="session"), {})
    camera.mount(session)
    return session


def record_bag(scene: Scene, camera: TwinCamera, bag: Path, *, seed: int, settings: Mapping[str, object]) -> Path:
    """Record a session, its truth beside it."""
    from tof_virtual.record import record_session

    record_session(make_session(scene, camera, seed=seed, settings=settings), bag)
    return bag


def label_bag(bag: Path, scene: Scene, dataset: Path) -> None:
    """Label a bag of the exact robot at the robot's own poses, one view per capture, and append it to a dataset."""
    from tof_core.bag import open_bag
    from tof_core.capture import Posed, View
    from tof_core.hashing import digest_config
    from tof_scene.raycast import Raycaster
    from tof_sim_label.config import LabelConfig
    from tof_sim_label.dataset import DatasetWriter
    from tof_sim_label.label import label_view
    from tof_sim_label.schema import Attributes

    config = LabelConfig(unseen_offset_mm=0.0)
    caster = Raycaster(scene)
    attributes = Attributes(
        scene.digest, digest_config(config), "robot", scene.names, {"bag": bag.name, "albedo": [p.material.albedo for p in scene.parts]}
    )
    with open_bag(bag, cell_frame=scene.frame) as reader, DatasetWriter(dataset, reader.camera, attributes) as writer:
        bodies: list[bytes] = []
        for number, capture in enumerate(reader.captures()):
            assert capture.robot is not None
            body = np.round(capture.robot.T_cell_body, 6).tobytes()
            bodies += [] if body in bodies else [body]
            view = View.of_capture(capture, bodies.index(body))
            posed = Posed(capture.robot.T_cell_camera, np.eye(6) * 1e-12)
            writer.append_capture(capture, number)
            writer.append_view(view, label_view(view, posed, caster, config))
