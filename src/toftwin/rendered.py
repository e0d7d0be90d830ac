# SPDX-License-Identifier: Apache-2.0
"""Labelled views of a scene, simulated with a sensor model around the poses of a session: training data without a measured frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.capture import Capture, Posed, RobotPose, View
from tof_core.config import param, to_mapping
from tof_core.errors import RefusedError
from tof_core.hashing import digest_config
from tof_core.progress import progress
from tof_scene.render import render
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.frame import Context, ideal_frame
from tof_sensor.model import simulate

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import SensorModel
    from tof_sim_label.label import Label

VIEWS_OF_A_STATION = 3
POSE_COV = np.diag(np.repeat([1e-5, 1e-5], 3) ** 2)
"""The pose of a simulated camera is known."""

ACCEPTED = ("ok", "robot")
"""Verdicts of poses around which views are rendered: solved and accepted, or given by TF or a board's corners."""
MOVING = frozenset({CadDeviation.NAME, HandEye.NAME, Intrinsics.NAME, TimeSync.NAME})
"""Effects that move a part, the camera or its rays, and thereby the true depth of a pixel."""


@dataclass(frozen=True, slots=True)
class RenderedConfig:
    """Settings of the rendered views."""

    views: int = param(60, "views simulated around those of the session", low=6, high=100_000)
    spread_m: float = param(0.06, "largest distance from a camera of the session", unit="m", low=0.0, high=2.0)
    spread_deg: float = param(6.0, "largest rotation against that camera", unit="deg", low=0.0, high=90.0)
    seed: int = param(0, "seed of poses and noise", low=0)


@dataclass(frozen=True, slots=True, eq=False)
class Near:
    """A pose of a session, around which views are rendered.

    T_cell_camera (4, 4); context: temperature, time and scene of its capture; gain: amplitude of albedo 1 head-on from 1 m, in the camera's unit.
    """

    T_cell_camera: Float
    context: Context
    gain: float


def near_dataset(path: Path, caster: Raycaster, gain: float) -> list[Near]:
    """The accepted poses of a labelled dataset, with temperature and time and without images.

    Raises:
        RefusedError: no pose was accepted.
    """
    from tof_sim_label.dataset import open_dataset  # loads slowly, and every diagnosis loads the settings of this module

    data = open_dataset(path)
    of_view, warmth = data.column("captures/view"), data.column("captures/temperature")
    stamps, poses = data.column("views/stamp_ns"), data.column("views/T_cell_camera")
    out = []
    for v in (v for v, verdict in enumerate(data.verdicts) if verdict in ACCEPTED):
        seen = warmth[(of_view == v) & np.isfinite(warmth)]
        temperature = float(np.median(seen)) if len(seen) else float("nan")
        time_s = float(stamps[v] - stamps.min()) * 1e-9
        out.append(Near(poses[v], Context(temperature=temperature, time_s=time_s, caster=caster), gain))
    if not out:
        raise RefusedError("no view has an accepted pose to render from", where=path, todo="label again, and look at its verdicts")
    return out


def of_depth(model: SensorModel) -> SensorModel:
    """The model without `MOVING`: the remaining errors of depth are those that a network can repair."""
    return replace(model, effects=tuple(e for e in model.effects if e.NAME not in MOVING))


def rendered_dataset(
    near: Sequence[Near], camera: Camera, model: SensorModel, caster: Raycaster, path: Path, config: RenderedConfig
) -> Path:
    """A labelled dataset of `config.views` views around the poses, simulated with the model; an interrupted run continues.

    Poses and noise follow from the number of the view alone, so that they are the same with any model.
    """
    from tof_sim_label.dataset import DatasetWriter
    from tof_sim_label.schema import Attributes

    path.parent.mkdir(parents=True, exist_ok=True)
    digest = digest_config({"rendered": to_mapping(config), "effects": [repr(e) for e in model.effects]})
    attributes = Attributes("simulated", digest, "simulated", tuple(p.name for p in caster.scene.parts))
    with DatasetWriter(path, camera, attributes, resume=True) as writer:
        for number in progress(range(writer.views, config.views), f"simulating {path.stem}", config.views - writer.views):
            view, label = _view(near, camera, model, caster, number, config)
            if writer.captures == number:
                writer.append_capture(as_capture(view), number)
            writer.append_view(view, label)
    return path


def as_capture(view: View) -> Capture:
    """The input of a network for one view."""
    return Capture(view.stamp_ns, view.camera, view.depth, view.reason, view.robot, view.amplitude, temperature=view.temperature)


def _view(
    near: Sequence[Near], camera: Camera, model: SensorModel, caster: Raycaster, number: int, config: RenderedConfig
) -> tuple[View, Label]:
    from tof_sim_label.label import label_view

    rng = np.random.default_rng([config.seed, number])
    one = near[int(rng.integers(len(near)))]
    spread = np.repeat([config.spread_m, np.radians(config.spread_deg)], 3)
    T = np.asarray(one.T_cell_camera @ se3.exp(rng.uniform(-1, 1, 6) * spread))
    rendering = render(caster, camera, T)
    amplitude = ideal_frame(rendering, gain=one.gain).amplitude
    made = simulate(rendering, model, np.random.default_rng([config.seed, number, 1]), context=one.context, amplitude=amplitude)
    depth = made.depth.astype(np.float32)
    capture = Capture(
        1_000_000_000 + number,
        camera,
        depth,
        np.isnan(depth).astype(np.uint8),
        RobotPose(np.eye(4), T),
        made.amplitude.astype(np.float32),
        temperature=one.context.temperature,
    )
    view = replace(View.of_capture(capture), station=number // VIEWS_OF_A_STATION)
    as_drawn = np.zeros(camera.shape, np.uint8)  # Large errors are the camera's: nothing foreign is in a rendered world.
    return view, label_view(view, Posed(T, POSE_COV), caster, world=as_drawn, rendering=rendering)
