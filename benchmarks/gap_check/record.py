# SPDX-License-Identifier: Apache-2.0
"""First process: record every case with the virtual robot and seal the answers."""

from __future__ import annotations

import hashlib
import json
import shutil
from typing import TYPE_CHECKING, Protocol, TypeVar

from benchmarks.gap_check.cases import MOVING, Case
from tof_core.config import from_mapping
from tof_core.errors import DatasetError
from tof_core.progress import progress

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from tof_virtual.config import VirtualConfig

BAGS, SEALED, SEAL = "bags", "sealed", "seal.json"


class Named(Protocol):
    """A case, which has a name."""

    @property
    def name(self) -> str:
        """Its folder."""


C = TypeVar("C", bound=Named)


def record_sealed(
    cases: Sequence[C], folder: Path, last: str, record: Callable[[C, Path, Path], None], what: str = "recording cases"
) -> None:
    """Record each case into a folder under `bags/` and one under `sealed/`, with a digest of the latter in `seal.json`; done ones are kept.

    Args:
        cases: what is recorded.
        folder: of all cases.
        last: what a recorded case has under its folder of bags.
        record: records one case into the two folders, neither of which exists.
        what: for the progress line.
    """
    path = folder / SEAL
    seals = dict(json.loads(path.read_text())) if path.exists() else {}
    for case in progress(cases, what, len(cases)):
        bags, sealed = folder / BAGS / case.name, folder / SEALED / case.name
        if case.name in seals and (bags / last).exists():
            continue
        for old in (bags, sealed):
            shutil.rmtree(old, ignore_errors=True)
        record(case, bags, sealed)
        seals[case.name] = digest(sealed)
        path.write_text(json.dumps(seals, indent=1))


def record_all(cases: Sequence[Case], folder: Path, size: tuple[int, int]) -> None:
    """Bags and scenes under `bags/`, truth under `sealed/`; done ones are kept."""
    record_sealed(cases, folder, "bag", lambda case, bag, sealed: _record(case, bag, sealed, size))


def config_of(case: Case, size: tuple[int, int]) -> VirtualConfig:
    """12 views (fewer if the case says so) from 2 stations over six minutes, so that a camera can warm up."""
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

    sealed.mkdir(parents=True)
    bag.mkdir(parents=True)
    scene = load_scene(
        write_builtin(case.scene, bag / "scene") if case.scene in builtin_names() else write_scene(case.scene, bag / "scene", case.seed)
    )
    record(bodies_of(scene), bag / "bag", config_of(case, size), effects=case.effects, truth_path=sealed / "truth")
    (sealed / "case.json").write_text(json.dumps(case.to_dict()))
    # The list that the diagnosis may use is no secret; what is in the bag is.
    (bag / "list.json").write_text(json.dumps({"left_out": [case.left_out] if case.left_out else []}))


def sealed_names(folder: Path) -> list[str]:
    """Names of the sealed cases, sorted."""
    return sorted(json.loads((folder / SEAL).read_text()))


def opened(folder: Path, name: str) -> Path:
    """The folder with the answer of a case.

    Raises:
        DatasetError: the answer was changed after it was sealed.
    """
    sealed = folder / SEALED / name
    if digest(sealed) != json.loads((folder / SEAL).read_text())[name]:
        raise DatasetError("was changed after it was sealed", where=sealed, todo="record the case again")
    return sealed


def digest(sealed: Path) -> str:
    """SHA-256 over the sealed files of a case."""
    h = hashlib.sha256()
    for path in sorted(sealed.iterdir()):
        h.update(path.name.encode())
        h.update(path.read_bytes())
    return h.hexdigest()
