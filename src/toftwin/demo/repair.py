# SPDX-License-Identifier: Apache-2.0
"""Last step of the demonstration: the sweep of the paper with the camera of the default network, for raw, filtered and repaired depth."""

from __future__ import annotations

from typing import TYPE_CHECKING

from toftwin.inputs import opened
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from pathlib import Path

    from tof_eval.comparison import Comparison
    from tof_eval.methods import Method
    from toftwin.demo.config import DemoConfig


def compare_methods(folder: Path, scene: Path, config: DemoConfig) -> Comparison:
    """Record the sweep as `folder/sweep` and compare each method with the truth beside it."""
    from tof_eval.methods import Model, Raw, Rules
    from tof_infer.session import Session
    from tof_scene.raycast import Raycaster
    from toftwin.evaluating import evaluate_bag

    _record_sweep(folder / "sweep", scene, config)
    pipeline = PipelineConfig()
    methods: list[Method] = [Raw(), Rules(pipeline.preproc), Rules(pipeline.preproc, config.captures), Model(Session())]
    with opened(folder / "sweep", scene, pipeline) as (reader, loaded):
        assert loaded is not None
        return evaluate_bag(reader, Raycaster(loaded), methods, pipeline, truth=folder / "sweep.truth.npz")


def _record_sweep(bag: Path, scene: Path, config: DemoConfig) -> None:
    from tof_core.config import from_mapping
    from tof_scene.scene_file import load_scene
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record_session
    from tof_virtual.session import Session
    from tof_virtual.twin import SWEEP, TwinCamera
    from toftwin.commands.simulate import bodies_of

    settings = {**SWEEP, "plan.views": config.sweep_views, "plan.captures": config.captures, "seed": config.seed}
    session = Session(bodies_of(load_scene(scene)), from_mapping(VirtualConfig, settings), {})
    TwinCamera().mount(session)
    record_session(session, bag)
