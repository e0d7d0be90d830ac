# SPDX-License-Identifier: Apache-2.0
"""Part views: one part in one view of the virtual robot, what is true of it and what was said."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.kept import kept
from benchmarks.parts import as_built, fates, furnished
from tof_align.config import WeightConfig
from tof_align.pixels import view_sigma
from tof_align.single import align_view
from tof_core.config import from_mapping
from tof_core.errors import RefusedError
from tof_inspect.judge import Inspector
from tof_inspect.picture import Picture
from tof_inspect.without import Split
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import accumulate_views
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_virtual.config import VirtualConfig
from tof_virtual.live import VirtualRobot
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from benchmarks.parts import Fate
    from tof_core.arrays import Float
    from tof_core.capture import Posed, View
    from tof_inspect.judge import PartVerdict
    from tof_inspect.without import Without
    from tof_scene.rendering import Rendering
    from tof_scene.scene import Scene

CAPTURES = 5
SAID = ("state", "pixels", "log_depth", "log_colour", "log_ratio", "displaced_mm", "std_mm", "tolerance_mm")
PRIOR = np.diag(np.repeat([0.05, np.radians(2.0)], 3) ** 2)


@dataclass(frozen=True, slots=True)
class PartView:
    """One part in one view.

    truth: present, absent, displaced (by moved_mm); rule: rule 2 calls it observable, with the CAD where it stands; shown: as built, it
    stands out in 30 pixels (a displaced part may have slid out of sight); state and what follows: the verdict.
    """

    part: str
    size_mm: float
    same_colour: bool
    truth: str
    moved_mm: float
    rule: bool
    shown: bool
    coloured: bool
    state: str
    pixels: int
    log_depth: float
    log_colour: float
    log_ratio: float
    displaced_mm: float
    std_mm: float
    tolerance_mm: float


def part_views(build: int, views: int, *, colour: bool, scene: Scene | None = None, wide: bool = False) -> list[PartView]:
    """All inspected parts of one build that its views have in sight; with `colour` a first picture of the complete scene is at hand."""
    key = f"parts-{build}-{views}-{colour}-{wide}" + (f"-{scene.folder.name}" if scene else "")
    return [PartView(**row) for row in kept(key, lambda: [asdict(v) for v in _made(build, views, colour, scene or furnished(build), wide)])]


def _made(build: int, views: int, colour: bool, scene: Scene, wide: bool) -> Iterator[PartView]:  # noqa: FBT001
    camera = {"width": 400, "height": 300} if wide else {}
    plan = {"views": views, "stations": 1, "range_max_m": 0.8}
    config = from_mapping(VirtualConfig, {"plan": plan, "camera": camera, "seed": 1000 + build})
    fate = fates(scene, build)
    built = as_built(scene, fate)
    inspector, caster_built = Inspector(Raycaster(scene)), Raycaster(built)
    split = Split(built)
    complete, robot = VirtualRobot(bodies_of(scene), config), VirtualRobot(bodies_of(built), config)
    for _, T_body_hand in complete.views:
        robot.drive(robot.T_cell_body)
        robot.goto(T_body_hand)
        shots = [robot.capture(colour=colour and k == 0) for k in range(CAPTURES)]
        view = replace(list(accumulate_views(shots, PreprocConfig()))[-1], colour=shots[0].colour)
        posed = _posed(view, inspector.caster, robot.T_cell_camera)
        if posed is None:
            continue
        inspector.first = _first(complete, T_body_hand, inspector) if colour else ()
        try:
            found = inspector.inspect([view], [posed]).verdicts
        except RefusedError:
            continue
        planned, real = (render(c, view.camera, posed.T_cell_camera, footprints=False) for c in (inspector.caster, caster_built))
        sigma = view_sigma(view, WeightConfig(), np.ix_(*map(np.arange, view.depth.shape)))
        for said in found:
            index = scene.index(said.name)
            if (planned.part == index).any():
                rule = _stands_out(view, sigma, planned, index, inspector.without(said.name)) >= 30
                alike = _alike(planned, index, inspector)
                number = built.index(said.name) if fate[said.name].state != "absent" else -1
                shown = number >= 0 and _stands_out(view, sigma, real, number, split.without(number)) >= 30
                yield _row(scene, said, fate[said.name], alike, rule, shown, bool(inspector.first))


def _posed(view: View, caster: Raycaster, T_cell_camera: Float) -> Posed | None:
    """Where a view was taken; None where alignment refuses it."""
    try:
        posed = align_view(view, caster, T_cell_camera, PRIOR).posed
    except RefusedError:
        return None
    return posed if posed.accepted else None


def _first(complete: VirtualRobot, T_body_hand: Any, inspector: Inspector) -> tuple[Picture, ...]:
    """A picture of the complete scene from near there, on another day: other light, another error of the base; its pose by the CAD."""
    complete.drive(complete.T_cell_body)
    complete.goto(T_body_hand)
    shot = complete.capture(colour=True)
    view = list(accumulate_views([shot], PreprocConfig()))[-1]
    posed = _posed(view, inspector.caster, complete.T_cell_camera)
    picture = Picture.of(shot.colour, posed.T_cell_camera) if posed else None
    return (picture,) if picture else ()


def _row(scene: Scene, said: PartVerdict, fate: Fate, alike: bool, rule: bool, shown: bool, coloured: bool) -> PartView:  # noqa: FBT001
    part = scene.part(said.name)
    size, moved = (1e3 * float(x) for x in (np.ptp(part.vertices, axis=0).max(), np.linalg.norm(fate.shift)))
    told = {name: getattr(said, name) for name in SAID}
    return PartView(said.name, size, alike, fate.state, moved, rule, shown, coloured, **told)


def _alike(planned: Rendering, index: int, inspector: Inspector) -> bool:
    """Whether what is behind the part has its colour."""
    T, scene = planned.T_cell_camera, inspector.scene
    behind = inspector.without(scene.parts[index].name).cast(T[:3, 3], planned.camera.rays()[planned.part == index] @ T[:3, :3].T).part
    most = int(np.bincount(behind + 1).argmax()) - 1
    return most >= 0 and scene.parts[most].material.albedo == scene.parts[index].material.albedo


def _stands_out(view: View, sigma: Float, whole: Rendering, index: int, bare: Without) -> int:
    """Rule 2: valid pixels of the part at which the scene with and without it differ by 3 sigma of the measurement."""
    covered, T = (whole.part == index) & view.valid, whole.T_cell_camera
    if not covered.any():
        return 0
    behind = bare.cast(T[:3, 3], view.camera.rays()[covered] @ T[:3, :3].T).t
    gap = np.abs(whole.depth[covered] - np.nan_to_num(behind, nan=np.inf))
    return int((gap > 3 * sigma[covered]).sum())
