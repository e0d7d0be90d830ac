# SPDX-License-Identifier: Apache-2.0
"""Real captures through the command line: preproc over DDS, label by a first guess, radial depth refused by name."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.primitive_scene import primitive_scene
from benchmarks.primitives import PrimitiveConfig, fit_primitives
from tof_core.bag import BagOptions, open_bag
from tof_scene.scene_file import save_scene
from tof_sim_label.dataset import open_dataset
from toftwin import cli

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.shared
HERE = "0 0 0 0 0 0 1"


@pytest.mark.dds
@pytest.mark.slow
def test_preproc_takes_a_real_frame_without_tf(shared_data: Path, ros_domain: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["replay", str(shared_data / "real/azure_kinect_nfov/bag"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["fates"] == {"kept": 1}


def room_of(bag: Path, folder: Path, depth: str = "z") -> str:
    """Planes and spheres of a bag's first frame as a scene.yaml."""
    config = PrimitiveConfig(stride=4, candidates=150)
    with open_bag(bag, BagOptions(depth=depth)) as reader:
        first = next(iter(reader.captures(need_tf=False)))
    return str(save_scene(primitive_scene(fit_primitives(first.depth, first.camera, config), first.camera, config.stride), folder))


@pytest.mark.slow
def test_a_room_fitted_once_labels_the_other_frame_from_a_first_guess(
    shared_data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag = shared_data / "real/azure_kinect_static/bag"
    room = room_of(bag, tmp_path / "room")
    flags = ["--set", "align.priors.base_mm=30", "--set", "preproc.order=accumulate", "--set", "preproc.accumulate.max_captures=1"]
    assert (
        cli.main(["label", str(bag), "--scene", room, "--initial-pose", "0.01 -0.01 0.01 0 0 0 1", "--out", str(tmp_path / "out"), *flags])
        == 0
    )
    assert "2 captures, 2 views" in capsys.readouterr().out
    dataset = open_dataset(tmp_path / "out" / "dataset.zarr")
    error = np.abs(dataset.frame("views/depth", 1) - dataset.frame("views/label", 1))[dataset.frame("views/mask", 1) > 0]
    assert np.nanmedian(error) < 4e-3


def test_radial_depth_declared_z_is_refused_with_its_cause_and_works_declared_radial(
    shared_data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bag = shared_data / "real/ifm_o3r/bag_radial"
    flags = ["--scene", room_of(bag, tmp_path / "room", "radial"), "--initial-pose", HERE, "--out", str(tmp_path / "out")]
    assert cli.main(["label", str(bag), *flags]) == 1
    said = capsys.readouterr().err
    assert "a plane bends: the depth looks radial" in said
    assert "pass --depth radial" in said
    assert not (tmp_path / "out" / "dataset.zarr").exists()
    assert cli.main(["label", str(bag), *flags, "--depth", "radial"]) == 0
    assert open_dataset(tmp_path / "out" / "dataset.zarr").views == 1
