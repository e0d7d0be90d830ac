# SPDX-License-Identifier: Apache-2.0
"""First process: record every case with the virtual robot and seal the answers."""

from __future__ import annotations

import hashlib
import json
import shutil
from typing import TYPE_CHECKING

from benchmarks.gap_check.cases import MOVING, Case
from tof_core.config import from_mapping
from tof_core.progress import progress

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_virtual.config import VirtualConfig

BAGS, SEALED, SEAL = "bags", "sealed", "seal.json"


def record_all(cases: Sequence[Case], folder: Path, size: tuple[int, int]) -> None:
    """Bags and scenes under `bags/`, truth under `sealed/` with a digest of each in `seal.json`; done ones are kept."""
    seals = _read(folder / SEAL)
    for case in progress(cases, "recording cases", len(cases)):
        bag = folder / BAGS / case.name
        if case.name in seals and (bag / "bag").exists():
            continue
        shutil.rmtree(bag, ignore_errors=True)
        _record(case, bag, folder / SEALED / case.name, size)
        seals[case.name] = digest(folder / SEALED / case.name)
        (folder / SEAL).write_text(json.dumps(seals, indent=1))


def config_of(case: Case, size: tuple[int, int]) -> VirtualConfig:
    """12 views from 2 stations over six minutes, so that a camera can warm up."""
    from tof_virtual.config import VirtualConfig

    moving = bool(MOVING & set(case.effects))
    return from_mapping(
        VirtualConfig,
        {
            "seed": case.seed,
            "camera.width": size[0],
            "camera.height": size[1],
            "camera.modulation_mhz": case.modulation_mhz,
            "plan.views": 12,
            "plan.stations": 2,
            "plan.pause_s": 30.0,
            "plan.capture_moving": moving,
        }
        | case.settings,
    )


def _record(case: Case, bag: Path, sealed: Path, size: tuple[int, int]) -> None:
    from benchmarks.gap_check.wide import write_scene
    from tof_scene.builtin import builtin_names, write_builtin
    from tof_scene.scene_file import load_scene
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of

    sealed.mkdir(parents=True, exist_ok=True)
    bag.mkdir(parents=True)
    scene = load_scene(
        write_builtin(case.scene, bag / "scene") if case.scene in builtin_names() else write_scene(case.scene, bag / "scene", case.seed)
    )
    record(bodies_of(scene), bag / "bag", config_of(case, size), effects=case.effects, truth_path=sealed / "truth")
    (sealed / "case.json").write_text(json.dumps(case.to_dict()))
    # The list that the diagnosis may use is no secret; what is in the bag is.
    (bag / "list.json").write_text(json.dumps({"left_out": [case.left_out] if case.left_out else []}))


def digest(sealed: Path) -> str:
    """SHA-256 over the sealed files of a case."""
    h = hashlib.sha256()
    for path in sorted(sealed.iterdir()):
        h.update(path.name.encode())
        h.update(path.read_bytes())
    return h.hexdigest()


def _read(path: Path) -> dict[str, str]:
    return dict(json.loads(path.read_text())) if path.exists() else {}
