# SPDX-License-Identifier: Apache-2.0
"""Sessions of the emerging camera with one strong error each, recorded once and kept in out/bench; how far their labels are off."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.gap_check.foreign.cases import ForeignCase
from benchmarks.recorded import FOLDER
from tof_core import se3
from tof_core.hashing import digest_config

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_sim_label.label import Label

SIZE = (128, 98)
VIEWS = {"plan.views": 12, "plan.pause_s": 20.0}


def case(name: str, scene: str, robot: str, causes: dict[str, float], seed: int) -> ForeignCase:
    """One session of twelve views."""
    return ForeignCase(name, "strong", scene, robot, causes, "", seed, dict(VIEWS))


def session_folder(one: ForeignCase) -> Path:
    """Folder of a recorded session: `bag`, `scene/scene.yaml`, `truth.npz`, `case.json`; recorded where it is missing."""
    from benchmarks.emerging.record import record
    from benchmarks.emerging.strength import calibrate
    from benchmarks.gap_check.foreign.record import planned

    folder = FOLDER / f"strong-{one.name}-{digest_config(one.to_dict() | {'size': list(SIZE)})}"
    if not (folder / "case.json").exists():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        session = planned(one, folder / "scene", SIZE)
        record(session, folder / "bag", folder / "truth", one.causes, calibrate(session, one.causes))
        (folder / "case.json").write_text(json.dumps(one.to_dict(), indent=1))
    return folder


@dataclass(frozen=True, slots=True, eq=False)
class LabelScore:
    """Label errors of one session against its truth.

    error (n,), sigma (n,): metres of z over all usable pixels; length (n,): metres along the ray per metre of z; pose_mm, pose_deg: median distance of the cameras from the truth; verdicts: count of each.
    """

    error: Float
    sigma: Float
    length: Float
    pose_mm: float
    pose_deg: float
    usable: float
    verdicts: dict[str, int]

    @property
    def shape(self) -> Float:
        """(n,) error less the session's common range offset, which no session can see."""
        return np.asarray(self.error - np.median(self.error * self.length) / self.length)

    @property
    def mae_mm(self) -> float:
        """Mean absolute error less the common range offset, millimetres."""
        return 1e3 * float(np.abs(self.shape).mean())

    @property
    def q90_mm(self) -> float:
        """90 % quantile of the absolute error less the common range offset, millimetres."""
        return 1e3 * float(np.quantile(np.abs(self.shape), 0.9))

    def within(self, sigmas: float) -> float:
        """Per cent of pixels whose error, offset included, is within so many of their own sigmas."""
        return 100.0 * float((np.abs(self.error) <= sigmas * self.sigma).mean())

    def shape_within(self, sigmas: float, offset_m: float) -> float:
        """Per cent of pixels whose error less the common range offset is within so many sigmas less the share of an offset of `offset_m`."""
        own2 = np.maximum(self.sigma**2 - (offset_m / self.length) ** 2, 0.0)
        return 100.0 * float((self.shape**2 <= sigmas**2 * own2).mean())


def score(folder: Path, labelled: Iterable[tuple[View, Label]]) -> LabelScore:
    """Labels of a session against the truth of its views.

    The true label is z, in the camera's frame, of the surface that the pixel sees through the lens that the camera has. A pixel that sees an
    object which the CAD lacks has none, and is left out.
    """
    truth = dict(np.load(folder / "truth.npz"))
    stamps, depth = truth["stamp_ns"], truth["depth"]
    errors, sigmas, lengths, off, usable = [], [], [], [], []
    verdicts: dict[str, int] = {}
    for view, label in labelled:
        v = int(np.argmin(np.abs(stamps - view.stamp_ns)))
        on_cad = np.isfinite(label.depth) & np.isfinite(depth[v]) & (truth["part"][v] >= 0)
        used = on_cad & (label.mask == 1)
        usable.append(used.sum() / max(int(on_cad.sum()), 1))
        errors.append((label.depth - depth[v])[used].astype(float))
        sigmas.append(label.sigma[used].astype(float))
        lengths.append(view.camera.ray_length()[used])
        off.append(se3.distance(label.posed.T_cell_camera, truth["T_cell_camera"][v]))
        verdicts[label.posed.verdict] = verdicts.get(label.posed.verdict, 0) + 1
    error, sigma, length = (np.concatenate(a) for a in (errors, sigmas, lengths))
    metres, degrees = np.median(off, axis=0)
    return LabelScore(error, sigma, length, 1e3 * metres, degrees, float(np.mean(usable)), verdicts)
