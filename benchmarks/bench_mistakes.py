# SPDX-License-Identifier: Apache-2.0
"""Usual mistakes in bag and scene: twenty on three sessions, and whether twelve sessions without one get advice."""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure, at_most
from benchmarks.surprises.cases import draw, record_case
from benchmarks.surprises.mistakes import TWENTY, Made, edited
from tof_core.options import BagOptions
from tof_scene.raycast import Raycaster
from tof_scene.scene_file import load_scene
from toftwin.inputs import opened
from toftwin.mistakes.find import find_mistake
from toftwin.mistakes.parts import suspicious
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from tof_core.capture import View

LONG = True
HEALTHY, SEED, SIZE, VIEWS = 12, 5, (128, 98), 6
WITH_MISTAKES = 3
SECONDS = 20.0


def run() -> list[Figure]:
    """Mistakes that are not named, advice that is false, and the longest time."""
    folder = Path(tempfile.mkdtemp(prefix="toftwin-mistakes-"))
    try:
        sessions = []
        for case in draw(HEALTHY, SEED, VIEWS):
            record_case(case, folder / case.name, SIZE)
            sessions.append(folder / case.name)
        return _figures(sessions, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _figures(sessions: list[Path], folder: Path) -> list[Figure]:
    false, slowest, missed = list[str](), 0.0, list[str]()
    for session in sessions:
        advice, seconds = advised(views_of(session), session / "scene" / "scene.yaml")
        slowest = max(slowest, seconds)
        false += [f"{session.name}: {advice}"] if advice else []
    some = sessions[:WITH_MISTAKES]
    for number, session in enumerate(some):
        views, other = views_of(session), some[number - 1] / "scene"
        for made in TWENTY:
            advice, seconds = with_mistake(views, session / "scene", made, folder / "edited", other)
            slowest = max(slowest, seconds)
            missed += [] if made.words in advice else [f"{session.name} {made.name}: {advice or 'nothing'}"]
            print(f"{session.name} {made.name}: {advice} ({seconds:.1f} s)", file=sys.stderr, flush=True)
    tried = len(TWENTY) * len(some)
    return [
        at_most(f"mistakes: of {tried} (twenty on three sessions), not named", len(missed), 0, "", remark="; ".join(missed)[:300]),
        at_most(
            f"mistakes: of {len(sessions)} sessions without one, those that get advice", len(false), 0, "", remark="; ".join(false)[:300]
        ),
        at_most("mistakes: longest time to look for one, reading aside", slowest, SECONDS, "s", remark="processor time of one core"),
    ]


def views_of(session: Path) -> list[View]:
    """The views of a recorded session."""
    config = PipelineConfig()
    with opened(session / "bag", session / "scene" / "scene.yaml", config, "") as (reader, _):
        return list(ViewStream(reader, config))


def with_mistake(views: list[View], scene: Path, made: Made, out: Path, other: Path) -> tuple[str, float]:
    """Advice and seconds for a session with a mistake; mistakes of one part are made in the largest that is no floor or wall."""
    path = scene / "scene.yaml" if made.scene is None else edited(scene, out, made, _part(scene), other)
    return advised([made.view(v) for v in views], path)


def _part(scene: Path) -> str:
    parts = [p for p in load_scene(scene).parts if np.ptp(p.vertices, axis=0).max() < 1.0]
    return max(parts, key=lambda p: float(np.prod(np.sort(np.ptp(p.vertices, axis=0))[1:]))).name


def advised(views: list[View], path: Path) -> tuple[str, float]:
    """What `toftwin doctor` says of scene and fit where something must be fixed, empty where nothing; processor seconds."""
    started, scene = time.process_time(), load_scene(path)
    out = [what for must, what, _ in suspicious(scene, path) if must]
    found = find_mistake(views, Raycaster(scene), BagOptions())
    if found.mistake is not None:
        out.append(found.mistake.what)
    elif found.nowhere:
        out.append("another scene, or another place")
    return "; ".join(out), time.process_time() - started
