# SPDX-License-Identifier: Apache-2.0
"""Training on rendered views alone, from the poses of labelled datasets, their scene and a sensor model of the camera."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from tof_core.errors import ConfigError
from tof_scene.raycast import Raycaster
from tof_sensor.model import load_model
from tof_sensor.origin import check_camera
from tof_sim_label.dataset import open_dataset
from toftwin.rendered import RenderedConfig, near_dataset, of_depth, rendered_dataset

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_scene.scene import Scene


def rendered(datasets: Sequence[Path], scene: Scene, sensor: Path, out: Path, views: int, *, fresh: bool = False) -> Path:
    """A labelled dataset beside the network `out`: `views` views, rendered around the poses of `datasets`; an unfinished one is continued.

    Poses, temperatures and stamps of the datasets are read, but no image. The unit of amplitude is that of the sensor model.

    Args:
        datasets: labelled datasets of one camera.
        scene: what they show.
        sensor: sensor.yaml of the camera; its errors of depth are simulated.
        out: the network that will be trained.
        views: how many.
        fresh: begin anew.

    Raises:
        ConfigError: the sensor.yaml states no unit of amplitude.
        RefusedError: it was fitted to another camera, or no view has an accepted pose.
    """
    model, camera = load_model(sensor), open_dataset(datasets[0]).camera
    check_camera(model.camera, camera)
    if model.gain is None:
        raise ConfigError(
            "states no gain, and without it no amplitude can be rendered",
            where=sensor,
            todo="add gain: the amplitude of albedo 1 head-on from 1 m",
        )
    path = out.with_name(f"{out.stem}_rendered") / "dataset.zarr"
    if fresh:
        shutil.rmtree(path, ignore_errors=True)
    caster = Raycaster(scene)
    near = [one for data in datasets for one in near_dataset(data, caster, model.gain)]
    return rendered_dataset(near, camera, of_depth(model), caster, path, RenderedConfig(views=views))
