# SPDX-License-Identifier: Apache-2.0
"""Is every part there: presence by depth, by colour and by both, false alarms, observability, displaced parts."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure, at_least, at_most
from benchmarks.part_views import CAPTURES, PRIOR, PartView, part_views
from tof_align.single import align_view
from tof_core.config import from_mapping
from tof_inspect.judge import Inspector
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import accumulate_views
from tof_scene.builtin import make_builtin
from tof_scene.raycast import Raycaster
from tof_virtual.config import VirtualConfig
from tof_virtual.live import VirtualRobot
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask

BUILDS = range(10, 16)
"""Nothing was tuned on these; `bench_inspect_long` has its own."""
SEEN_GONE = 0.3
"""Share of parts that are gone here: the prior with which probabilities are held to what is true."""


def run() -> list[Figure]:
    """Every figure of this room; more builds are in `bench_inspect_long`."""
    return [*figures([v for build in BUILDS for v in part_views(build, 2, colour=True)]), seconds()]


def auroc(scores: Float, positive: Mask) -> float:
    """Area under the ROC by ranks (Mann and Whitney), ties halved."""
    from scipy.stats import rankdata

    n1, n0 = int(positive.sum()), int((~positive).sum())
    if not n1 or not n0:
        return float("nan")
    ranks = rankdata(scores)
    return float((ranks[positive].sum() - n1 * (n1 + 1) / 2) / (n1 * n0))


def _auroc(views: list[PartView], name: str) -> float:
    """Of present against absent."""
    counted = [v for v in views if v.truth != "displaced"]
    return auroc(np.array([getattr(v, name) for v in counted]), np.array([v.truth == "present" for v in counted]))


def figures(views: list[PartView]) -> list[Figure]:
    """Bars over all part views."""
    return [*presence(views), *alarms(views), *displaced(views), *calibration(views)]


def presence(views: list[PartView]) -> list[Figure]:
    """Who sees it: depth, colour, both."""
    rule = [v for v in views if v.rule]
    coloured = [v for v in rule if v.coloured]
    alike, other = [v for v in coloured if v.same_colour], [v for v in coloured if not v.same_colour]
    unruled = [v for v in views if v.coloured and not v.rule and (v.log_depth or v.log_colour)]
    where = f"{len(views)} part views of {min(v.size_mm for v in views):.0f} to {max(v.size_mm for v in views):.0f} mm, {len(rule)} of them observable by rule 2"
    same = f"{len(alike)} part views; depth alone {_auroc(alike, 'log_depth'):.4f}, 2D alone {_auroc(alike, 'log_colour'):.3f}, median |log ratio| of 2D {np.median([abs(v.log_colour) for v in alike] or [0]):.2f}"
    seen = f"{len(other)} part views; depth alone {_auroc(other, 'log_depth'):.4f}, 2D alone {_auroc(other, 'log_colour'):.3f}"
    rest = f"{len(unruled)} part views; depth alone {_auroc(unruled, 'log_depth'):.4f}, 2D alone {_auroc(unruled, 'log_colour'):.3f}"
    return [
        at_least("presence AUROC, depth alone", _auroc(rule, "log_depth"), 0.99, "", remark=where),
        at_least("presence AUROC fused, part and background of one colour", _auroc(alike, "log_ratio"), 0.99, "", remark=same),
        at_least("presence AUROC fused, part of another colour", _auroc(other, "log_ratio"), 0.99, "", remark=seen),
        Figure("presence AUROC fused, too little to be observable by rule 2", _auroc(unruled, "log_ratio"), "", remark=rest),
    ]


def alarms(views: list[PartView]) -> list[Figure]:
    """Wrong verdicts, and missing ones."""
    judged = [v for v in views if v.state != "not_observable"]
    there, gone = [v for v in judged if v.truth == "present"], [v for v in judged if v.truth == "absent"]
    false, missed = [v for v in there if v.state != "present"], [v for v in gone if v.state != "absent"]
    rule = [v for v in views if v.rule]
    seen = [v for v in rule if v.state != "not_observable"]
    return [
        at_most("false alarms (a part in its place called absent or displaced), per 1000", 1e3 * len(false) / max(len(there), 1), 1, "", remark=f"{len(false)} of {len(there)}"),
        at_most("absent parts called present or displaced, per 1000", 1e3 * len(missed) / max(len(gone), 1), 1, "", remark=f"{len(missed)} of {len(gone)}"),
        at_least("observable where rule 2 says so", 100 * len(seen) / max(len(rule), 1), 90, "%", remark=f"{len(rule)} part views"),
    ]  # fmt: skip


def displaced(views: list[PartView]) -> list[Figure]:
    """Parts slid by 4 to 9 mm."""
    moved = [v for v in views if v.truth == "displaced" and v.rule and v.shown]
    far = [v for v in moved if np.isfinite(v.std_mm) and v.moved_mm - v.tolerance_mm > 3 * v.std_mm]
    found = [v for v in far if v.state == "displaced"]
    error = [abs(v.displaced_mm - v.moved_mm) / v.std_mm for v in moved if np.isfinite(v.std_mm)]
    states = ", ".join(
        f"{sum(v.state == s for v in moved)} {s.replace('_', ' ')}" for s in ("displaced", "present", "absent", "not_observable")
    )
    return [
        at_least("displaced beyond tolerance by 3 of its own sigmas and found", 100 * len(found) / max(len(far), 1), 95, "%",
                 remark=f"{len(found)} of {len(far)}; of all {len(moved)} in sight: {states}; found displacement off by {np.median(error or [np.nan]):.1f} sigmas (median)"),
        at_most("displaced parts in sight called absent, per 1000", 1e3 * sum(v.state == "absent" for v in moved) / max(len(moved), 1), 10, ""),
    ]  # fmt: skip


def calibration(views: list[PartView]) -> list[Figure]:
    """Whether a probability is what it says: the mean of |stated - true| over ten bins, weighed by their counts (ECE)."""
    counted = [v for v in views if v.truth != "displaced" and v.coloured and (v.log_depth or v.log_colour)]
    out = []
    for what, name in (("fused", "log_ratio"), ("depth alone", "log_depth"), ("2D alone", "log_colour")):
        ratio = np.clip(np.array([getattr(v, name) for v in counted]) + np.log(1 / SEEN_GONE - 1), -500, 500)
        p, true = 1 / (1 + np.exp(-ratio)), np.array([v.truth == "present" for v in counted])
        which = np.minimum((10 * p).astype(int), 9)
        error = sum(abs((p - true)[which == k].sum()) for k in range(10)) / max(len(counted), 1)
        sure = (p > 0.99) | (p < 0.01)
        wrong = int((sure & ((p > 0.5) != true)).sum())
        remark = (
            f"{len(counted)} part views; Brier {((p - true) ** 2).mean():.4f}; of {int(sure.sum())} stated beyond 99 % {wrong} are wrong"
        )
        out.append(Figure(f"calibration error of the probability, {what}", 100 * float(error), "%", remark=remark))
    return out


def seconds() -> Figure:
    """One view, all parts."""
    scene = make_builtin("body_section")
    robot = VirtualRobot(bodies_of(scene), from_mapping(VirtualConfig, {"plan": {"views": 2, "stations": 1}}))
    inspector = Inspector(Raycaster(scene))
    view = list(accumulate_views([robot.capture() for _ in range(CAPTURES)], PreprocConfig()))[-1]
    posed = align_view(view, inspector.caster, robot.T_cell_camera, PRIOR).posed
    inspector.inspect([view], [posed])
    started = time.process_time()
    inspector.inspect([view], [posed])
    return Figure("inspection of one 224x171 view, all parts, processor time", time.process_time() - started, "s")
