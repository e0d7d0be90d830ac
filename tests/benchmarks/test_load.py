# SPDX-License-Identifier: Apache-2.0
"""A load's processes: one a node, or one a camera with the same nodes and parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")

from benchmarks.load import Load
from tof_infer.config import InferConfig

if TYPE_CHECKING:
    from pathlib import Path


def test_each_node_of_each_camera_is_a_process() -> None:
    specs = Load(cameras=2).specs()
    assert [(spec.namespace, spec.nodes) for spec in specs] == [
        (f"camera{number}", (name,)) for number in (0, 1) for name in ("preproc", "sim_label", "infer")
    ]


def test_together_a_camera_is_one_process_with_the_parameters_of_all_its_nodes() -> None:
    apart = Load(cameras=2, label_share=0.05, view_every=0)
    together = Load(cameras=2, label_share=0.05, view_every=0, together=True)
    specs = together.specs()
    assert [(spec.namespace, spec.nodes) for spec in specs] == [(f"camera{n}", ("preproc", "sim_label", "infer")) for n in (0, 1)]
    assert specs[0].parameters == {name: values for spec in apart.specs()[:3] for name, values in spec.parameters.items()}
    assert specs[0].parameters["sim_label"]["live.share"] == 0.05


def test_the_flags_and_the_section_name_the_load() -> None:
    assert Load().flags == ""
    given = Load(cameras=5, label_share=0.05, view_every=0, together=True)
    assert given.flags == " --cameras 5 --size 224x171 --hz 15 --view-every 0 --label-share 0.05 --together"
    assert given.section == "soak_5_224x171_every0_share0.05_together"
    assert str(given) == "5 cameras of 224x171 at 15 Hz, a view a dwell, labels in at most 5% of a core, one process a camera"


def test_a_recipe_gives_infer_a_network_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch", reason="training needs the extra `train`")
    from tof_infer.session import Session

    monkeypatch.setattr("benchmarks.load.FOLDER", tmp_path)
    given = Load(hz=30.0, width=64, height=48, recipe="fast")
    assert given.flags.endswith(" --hz 30 --recipe fast")
    assert given.section == "soak_1_64x48_fast"
    assert str(given) == "64x48 at 30 Hz, network of --recipe fast"
    infer = given.specs()[2].parameters["infer"]
    assert Session(InferConfig(model=str(infer["infer.model"]))).card.config["net"]["separable"]
    assert Load().specs()[2].parameters["infer"]["infer.model"] == "default"
