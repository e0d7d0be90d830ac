# SPDX-License-Identifier: Apache-2.0
"""Is every part there: presence by depth and by colour alone, false alarms, observability, displaced parts."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure, at_least, at_most
from tof_align.single import align_view
from tof_core.config import from_mapping
from tof_core.errors import RefusedError
from tof_inspect.config import InspectConfig
from tof_inspect.judge import Inspector
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import accumulate_views
from tof_scene.builtin import builtin_names, make_builtin
from tof_scene.raycast import Raycaster
from tof_virtual.config import VirtualConfig
from tof_virtual.live import VirtualRobot
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Mask
    from tof_core.capture import Capture, Posed, View
    from tof_inspect.judge import PartVerdict

VIEWS = 4
BUILDS = 2
"""Builds of each scene, in each of which every inspected part is gone with probability 0.3 and else displaced with 0.3."""
CAPTURES = 5


@dataclass(frozen=True, slots=True)
class Judged:
    """One part in one view: what is true, what was said, and whether rule 2 calls it observable."""

    scene: str
    truth: str
    moved_mm: float
    rule: bool
    said: PartVerdict
    colour: float
    """Correlation of the part's colour patch with the first picture's (NaN where not seen)."""


def run() -> list[Figure]:
    """Every figure of this room."""
    return figures([j for name in builtin_names() for build in range(BUILDS) for j in judged(name, build, VIEWS)])


def judged(name: str, build: int, views: int, *, colour: bool = True) -> list[Judged]:
    """All inspected parts of one build of a scene, view by view."""
    scene, rng = make_builtin(name), np.random.default_rng([build, len(name)])
    config = from_mapping(VirtualConfig, {"plan": {"views": views, "stations": 1, "range_max_m": 0.8}, "seed": 20 + build})
    truth = {p.name: _fate(rng) for p in scene.parts if p.inspect}
    bodies = bodies_of(scene)
    built = [
        replace(b, vertices=b.vertices + truth[b.name][1]) if b.name in truth else b
        for b in bodies
        if truth.get(b.name, ("",))[0] != "absent"
    ]
    complete, robot = VirtualRobot(bodies, config), VirtualRobot(built, config)
    inspector = Inspector(Raycaster(scene), InspectConfig())
    prior = np.diag(np.repeat([0.05, np.radians(2.0)], 3) ** 2)
    out: list[Judged] = []
    for _, T_body_hand in complete.views:
        complete.goto(T_body_hand)
        robot.drive(robot.T_cell_body)
        robot.goto(T_body_hand)
        shots = [robot.capture(colour=colour and k == 0) for k in range(CAPTURES)]
        view = list(accumulate_views(shots, PreprocConfig()))[-1]
        posed = align_view(view, inspector.caster, robot.T_cell_camera, prior).posed
        if posed.accepted:
            first = _first_photo(complete, robot) if colour else None
            try:
                verdicts = inspector.inspect([view], [posed])
            except RefusedError:
                continue
            out += [_one(name, v, truth, view, posed, inspector, first, shots[0]) for v in verdicts]
    return out


def _fate(rng: np.random.Generator) -> tuple[str, Float]:
    """What becomes of a part: gone, moved by 4 to 9 mm, or in its place."""
    if rng.uniform() < 0.3:
        return "absent", np.zeros(3)
    if rng.uniform() < 0.3:
        shift = rng.normal(size=3)
        return "displaced", np.asarray(shift / np.linalg.norm(shift) * rng.uniform(4e-3, 9e-3))
    return "present", np.zeros(3)


def _first_photo(complete: VirtualRobot, robot: VirtualRobot) -> Bytes:
    """The complete scene's picture from exactly where the camera is now, in its own light: 2D alone, as well aligned as can be."""
    from tof_virtual.colour import photograph

    return photograph(complete._session, robot.T_cell_camera_true, 0, 0)  # noqa: SLF001  (evaluation only)


def _one(
    scene: str,
    said: PartVerdict,
    truth: dict[str, tuple[str, Float]],
    view: View,
    posed: Posed,
    inspector: Inspector,
    first: Bytes | None,
    shot: Capture,
) -> Judged:
    state, shift = truth[said.name]
    correlation = float("nan")
    if first is not None and shot.colour is not None:
        correlation = _patch(first, shot, posed, inspector, said.name)
    return Judged(scene, state, 1e3 * float(np.linalg.norm(shift)), _rule(view, posed, inspector, said.name), said, correlation)


def _rule(view: View, posed: Posed, inspector: Inspector, name: str) -> bool:
    """Rule 2: at least 30 valid pixels at which the scene with and without the part differ by 3 sigma of the measurement."""
    from tof_align.config import WeightConfig
    from tof_align.pixels import view_sigma
    from tof_scene.render import render

    T, index = posed.T_cell_camera, inspector.scene.index(name)
    whole = render(inspector.caster, view.camera, T, footprints=False)
    bare = render(inspector.without(name), view.camera, T, footprints=False)
    sigma = view_sigma(view, WeightConfig(), np.ix_(*map(np.arange, view.depth.shape)))
    stands = (whole.part == index) & view.valid & (np.abs(whole.depth - bare.depth) > 3 * sigma)
    return int(stands.sum()) >= 30


def _patch(first: Bytes, shot: Capture, posed: Posed, inspector: Inspector, name: str) -> float:
    """Correlation of grey values over the part's box in both pictures."""
    from tof_core import se3

    colour = shot.colour
    assert colour is not None
    assert colour.camera is not None
    T = posed.T_cell_camera if colour.T_camera_colour is None else posed.T_cell_camera @ colour.T_camera_colour
    uv = colour.camera.project(se3.apply(se3.inverse(T), inspector.scene.part(name).vertices))
    if not np.isfinite(uv).all():
        return float("nan")
    low, high = np.floor(uv.min(axis=0)).astype(int) - 2, np.ceil(uv.max(axis=0)).astype(int) + 3
    box = slice(max(low[1], 0), max(high[1], 0)), slice(max(low[0], 0), max(high[0], 0))
    a, b = (image[box].mean(axis=-1).ravel() for image in (first, colour.image))
    if len(a) < 30 or a.std() < 1e-6 or b.std() < 1e-6:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


def auroc(scores: Float, positive: Mask) -> float:
    """Area under the ROC by ranks (Mann and Whitney), ties halved."""
    from scipy.stats import rankdata

    n1, n0 = int(positive.sum()), int((~positive).sum())
    if not n1 or not n0:
        return float("nan")
    ranks = rankdata(scores)
    return float((ranks[positive].sum() - n1 * (n1 + 1) / 2) / (n1 * n0))


def figures(all_: list[Judged]) -> list[Figure]:
    """Bars over all part views."""
    seen = [j for j in all_ if j.said.state != "not_observable"]
    there = np.array([j.truth != "absent" for j in seen])
    depth = np.array([j.said.log_depth for j in seen])
    flat = [j for j in seen if np.isfinite(j.colour)]
    by_colour = auroc(np.array([j.colour for j in flat]), np.array([j.truth != "absent" for j in flat])) if flat else float("nan")
    rule = [j for j in all_ if j.rule]
    whole = [j for j in seen if j.truth == "present"]
    alarms = [j for j in whole if j.said.state != "present"]
    missed = [j for j in seen if j.truth == "absent" and j.said.state != "absent"]
    moved = [j for j in seen if j.truth == "displaced" and j.moved_mm - j.said.tolerance_mm > 3 * max(j.said.std_mm, 0.0)]
    found = [j for j in moved if j.said.state == "displaced"]
    where = f"{len(all_)} part views, {len(seen)} judged, {sum(j.truth == 'absent' for j in seen)} of them absent"
    return [
        at_least("presence AUROC by depth, parts of the built-in scenes", auroc(depth, there), 0.99, "", remark=f"{where}; colour alone, perfectly aligned: {by_colour:.3f}"),
        at_most("false alarms (a part in its place called absent or displaced), per 1000", 1e3 * len(alarms) / max(len(whole), 1), 1, "",
                remark=f"{len(alarms)} of {len(whole)}: {', '.join(sorted({f'{j.scene} {j.said.name} {j.said.state}' for j in alarms})[:6])}"),
        at_most("absent parts called present or displaced, per 1000", 1e3 * len(missed) / max(sum(j.truth == "absent" for j in seen), 1), 1, ""),
        at_least("observable where rule 2 says so", 100 * sum(j.said.state != "not_observable" for j in rule) / max(len(rule), 1), 90, "%", remark=f"{len(rule)} part views"),
        at_least("displaced beyond 3 of its own sigmas and found", 100 * len(found) / max(len(moved), 1), 95, "%", remark=f"{len(found)} of {len(moved)}"),
        Figure("inspection of one 224x171 view, all parts, processor time", _seconds(), "s"),
    ]  # fmt: skip


def _seconds() -> float:
    scene = make_builtin("body_section")
    robot = VirtualRobot(bodies_of(scene), from_mapping(VirtualConfig, {"plan": {"views": 2, "stations": 1}}))
    inspector = Inspector(Raycaster(scene), InspectConfig())
    view = list(accumulate_views([robot.capture() for _ in range(CAPTURES)], PreprocConfig()))[-1]
    posed = align_view(view, inspector.caster, robot.T_cell_camera, np.diag(np.repeat([0.05, np.radians(2.0)], 3) ** 2)).posed
    inspector.inspect([view], [posed])
    started = time.process_time()
    inspector.inspect([view], [posed])
    return time.process_time() - started
