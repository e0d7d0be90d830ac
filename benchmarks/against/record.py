# SPDX-License-Identifier: Apache-2.0
"""First process: record the camera's and the simulator's session of every pair, and seal what differs."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.gap_check.examine import DATA_SHEET
from benchmarks.gap_check.record import record_sealed

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from benchmarks.against.pairs import SimulatorPair
    from benchmarks.emerging.device import Device

REAL, SIMULATED = "real", "simulated"


def record_pairs(pairs: Sequence[SimulatorPair], folder: Path, size: tuple[int, int]) -> None:
    """Bags and scene under `bags/`, what differs under `sealed/`; done ones are kept."""
    record_sealed(pairs, folder, SIMULATED, lambda pair, bags, sealed: record_pair(pair, bags, sealed, size), "recording pairs")


def record_pair(pair: SimulatorPair, bags: Path, sealed: Path, size: tuple[int, int]) -> None:
    """Two bags in one scene, of different poses, errors of the robot and noise; each cause has one size on both sides, or twice that."""
    from benchmarks.emerging.healthy import write_prior
    from benchmarks.emerging.record import record
    from benchmarks.emerging.strength import calibrate
    from benchmarks.gap_check.foreign.data_sheet import write_data_sheet
    from benchmarks.gap_check.foreign.record import planned

    bags.mkdir(parents=True)
    sealed.mkdir(parents=True)
    camera = planned(pair.case(), bags / "scene", size)
    simulator = planned(pair.case(), bags / "scene", size, again=1)
    simulator.healthy = rendered(simulator.healthy)
    reached = calibrate(camera, pair.simulator)
    simulator.sizes = dict(camera.sizes)
    reached_by_camera = calibrate(camera, pair.camera)
    record(camera, bags / REAL, sealed / REAL, pair.camera, reached_by_camera)
    record(simulator, bags / SIMULATED, sealed / SIMULATED, pair.simulator, reached)
    write_prior(bags / "scene" / "calibration.yaml")
    write_data_sheet(camera.healthy, camera.camera, bags / "scene" / DATA_SHEET)
    (sealed / "pair.json").write_text(json.dumps(pair.to_dict() | {"reached": [reached_by_camera, reached]}, indent=1))


def rendered(healthy: Device) -> Device:
    """The camera as a simulator has it: mount, lens, albedo and parts as stated, since no simulator knows their errors."""
    return replace(
        healthy,
        optics=replace(healthy.optics, centre_x_px=0.0, centre_y_px=0.0, focal_pct=0.0),
        mount=replace(healthy.mount, hand_eye_mm=0.0, hand_eye_deg=0.0),
        world=replace(healthy.world, albedo_off=0.0, texture=0.0, foreign_m=0.0),
    )
