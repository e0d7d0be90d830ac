# SPDX-License-Identifier: Apache-2.0
"""Labels of a recorded session against its truth: what is kept of pixels that the world makes wrong, and what is lost of good ones."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.emerging.person import reaches
from tof_core import se3
from tof_core.errors import RefusedError
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene_file import load_scene
from tof_scene.world.words import described
from tof_sim_label.label import label_view
from tof_sim_label.labeller import label_session
from tof_sim_label.reasons import WORLD, LabelReason
from tof_sim_label.world import session_surprises
from toftwin.inputs import opened
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.world.surprises import Surprises

WRONG_M = 0.015
"""A label is wrong that is farther from the true surface."""
SHOWS_PX = 20
"""Pixels from which a view shows a thing."""
NEAR_M = 0.1
"""Distance of a named object's middle from that of the true one up to which it is that one; both are of boxes around what views see."""


@dataclass(frozen=True, slots=True)
class Row:
    """Pixel counts of one session.

    wrong: labels made wrong by the world, kept: of those usable, both of pixels with a measurement; wrong_unmeasured, kept_unmeasured: of those
    without; pose: labels wrong without the world's doing (silhouettes); good: right labels that would be usable in a world as its CAD,
    lost: of those not usable because of the world. alone_kept, alone_lost: the same with each view judged by itself, as live.
    things: foreign objects and missing parts that the views show, named: of those named where they are, false: named and not there;
    all of the session, not of pixels.
    """

    name: str
    kind: str
    refused: str = ""
    wrong: int = 0
    kept: int = 0
    wrong_unmeasured: int = 0
    kept_unmeasured: int = 0
    pose: int = 0
    good: int = 0
    lost: int = 0
    alone_kept: int = 0
    alone_lost: int = 0
    things: int = 0
    named: int = 0
    false: int = 0
    world: str = ""


def score(folder: Path) -> Row:
    """Label the session in `folder` (`cases.record_case`) as `toftwin label` does, and count."""
    case = json.loads((folder / "case.json").read_text())
    config, scene_file = PipelineConfig(), folder / "scene" / "scene.yaml"
    with opened(folder / "bag", scene_file, config, "") as (reader, _):
        views = list(ViewStream(reader, config))
    caster = Raycaster(load_scene(scene_file))
    try:
        solution, _ = label_session(views, caster, config.labeller)
    except RefusedError as error:
        return Row(case["name"], case["kind"], refused=str(error))
    world = session_surprises(views, solution.posed, caster, config.label)
    truth, as_cad, counts = np.load(folder / "truth.npz"), np.load(folder / "cad.npz")["depth"], dict[str, int]()
    for number, (view, posed) in enumerate(zip(views, solution.posed, strict=True)):
        label, alone = (label_view(view, posed, caster, config.label, codes) for codes in (world.pixels[number], None))
        true, cad = truth["depth"][number], as_cad[number]
        for name, count in _counted(label.depth, label.reason, alone.reason, true, cad, np.isfinite(view.depth)).items():
            counts[name] = counts.get(name, 0) + count
    counts |= _named(world, true_things(views, truth, as_cad, caster, case), caster.scene.names, arm="arm" in case["kind"])
    return replace(Row(case["name"], case["kind"], world=json.dumps(described(world, caster.scene))), **counts)  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class Things:
    """What the views truly show: names of parts that are gone, the middle (3,) of the box around what is seen of a foreign object, or None."""

    gone: tuple[str, ...]
    middle: Float | None


def true_things(views: Sequence[View], truth: Mapping[str, Any], as_cad: Float, caster: Raycaster, case: Mapping[str, Any]) -> Things:
    """From the truth: a part is gone that no pixel is of, where what is behind it is more than 15 mm away in some; a foreign object shows where no body of the CAD is, and no arm.

    as_cad: (V, H, W) true depth, metres, of a world without surprises (`cases.as_cad`).
    """
    shown, points, covered = np.zeros((2, len(caster.scene.parts)), int), list[Any](), np.zeros(len(caster.scene.parts), int)
    for number, view in enumerate(views):
        T, part, depth = truth["T_cell_camera"][number], truth["part"][number], truth["depth"][number]
        drawn = render(caster, view.camera, T, footprints=False).part
        off = np.abs(as_cad[number] - depth) > WRONG_M
        shown[0] += np.bincount(drawn[(drawn >= 0) & off], minlength=len(covered))
        shown[1] += np.bincount(part[part >= 0], minlength=len(covered))
        foreign = (part < 0) & np.isfinite(depth)
        covered += np.bincount(drawn[foreign & off & (drawn >= 0)], minlength=len(covered))
        if not reaches(int(truth["stop"][number]), case["world"]["world.arm_share"], case["seed"]) and foreign.sum() >= SHOWS_PX:
            points.append(se3.apply(T, view.camera.rays()[foreign] * depth[foreign][:, None]))
    gone = (shown[0] - covered >= 2 * SHOWS_PX) & (shown[1] == 0) & case["world"]["world.missing"]
    middle = _box_middle(np.concatenate(points)) if len(points) > 1 and "foreign" in case["kind"] else None
    return Things(tuple(caster.scene.names[k] for k in np.flatnonzero(gone)), middle)


def _box_middle(points: Float) -> Float:
    """Middle (3,) of the box around points (n, 3); the median would lie on the side that most of them are of."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _named(world: Surprises, true: Things, names: Sequence[str], *, arm: bool) -> dict[str, int]:
    """How many things there are, how many are named at their place, how many are named and not there; with an arm, what moves or one view alone shows is the arm's."""
    parts = {names[m.part] for m in world.missing}
    standing = [f for f in world.foreign if not f.moves and len(f.views) > 1]
    right = [f for f in standing if true.middle is not None and np.linalg.norm(f.centre_m - true.middle) < NEAR_M]
    return {
        "things": len(true.gone) + (true.middle is not None),
        "named": len(parts & set(true.gone)) + bool(right),
        "false": len(parts - set(true.gone)) + len(standing if arm else world.foreign) - len(right),
    }


def _counted(label: Any, reason: Any, alone: Any, true: Any, cad: Any, measured: Any) -> dict[str, int]:
    """The counts of one view, images (H, W); cad: true depth of a world without surprises."""
    judged = np.isin(reason, [LabelReason.USABLE, *WORLD])
    off = judged & (np.abs(label - true) > WRONG_M)
    by_world = off & (np.abs(cad - true) > WRONG_M)
    good = judged & (np.abs(label - true) <= WRONG_M)
    usable, usable_alone = reason == LabelReason.USABLE, alone == LabelReason.USABLE
    sums = {
        "wrong": by_world & measured,
        "kept": by_world & measured & usable,
        "wrong_unmeasured": by_world & ~measured,
        "kept_unmeasured": by_world & ~measured & usable,
        "pose": off & ~by_world,
        "good": good,
        "lost": good & ~usable,
        "alone_kept": by_world & measured & usable_alone,
        "alone_lost": good & ~usable_alone,
    }
    return {name: int(mask.sum()) for name, mask in sums.items()}
