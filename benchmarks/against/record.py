# SPDX-License-Identifier: Apache-2.0
"""First process: record the camera's and the simulator's session of every pair, and seal what differs."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.gap_check.examine import DATA_SHEET
from benchmarks.gap_check.record import BAGS, SEAL, SEALED, digest
from tof_core.progress import progress

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from benchmarks.against.pairs import SimulatorPair
    from benchmarks.emerging.device import Device
    from benchmarks.emerging.session import EmergingSession

REAL, SIMULATED = "real", "simulated"


def record_pairs(pairs: Sequence[SimulatorPair], folder: Path, size: tuple[int, int]) -> None:
    """Bags and scene under `bags/`, what differs under `sealed/` with a digest of each in `seal.json`; done ones are kept."""
    path = folder / SEAL
    seals = dict(json.loads(path.read_text())) if path.exists() else {}
    for pair in progress(pairs, "recording pairs", len(pairs)):
        bags, sealed = folder / BAGS / pair.name, folder / SEALED / pair.name
        if pair.name in seals and (bags / SIMULATED).exists():
            continue
        for old in (bags, sealed):
            shutil.rmtree(old, ignore_errors=True)
        record_pair(pair, bags, sealed, size)
        seals[pair.name] = digest(sealed)
        path.write_text(json.dumps(seals, indent=1))


def record_pair(pair: SimulatorPair, bags: Path, sealed: Path, size: tuple[int, int]) -> None:
    """Two bags in one scene, of different poses, errors of the robot and noise; each cause has one size on both sides, or twice that."""
    from benchmarks.emerging.healthy import write_prior
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
    _record(camera, bags / REAL, sealed / REAL, pair.camera, reached_by_camera)
    _record(simulator, bags / SIMULATED, sealed / SIMULATED, pair.simulator, reached)
    write_prior(bags / "scene" / "calibration.yaml")
    write_data_sheet(camera.healthy, bags / "scene" / DATA_SHEET)
    (sealed / "pair.json").write_text(json.dumps(pair.to_dict() | {"reached": [reached_by_camera, reached]}, indent=1))


def rendered(healthy: Device) -> Device:
    """The camera as a simulator has it: mount, lens, albedo and parts as stated, since no simulator knows their errors."""
    return replace(
        healthy,
        optics=replace(healthy.optics, centre_x_px=0.0, centre_y_px=0.0, focal_pct=0.0),
        mount=replace(healthy.mount, hand_eye_mm=0.0, hand_eye_deg=0.0),
        world=replace(healthy.world, albedo_off=0.0, texture=0.0, foreign_m=0.0),
    )


def _record(session: EmergingSession, bag: Path, truth: Path, strengths: Mapping[str, float], reached: Mapping[str, float]) -> None:
    from benchmarks.emerging.record import record

    record(session, bag, truth, strengths, reached)
