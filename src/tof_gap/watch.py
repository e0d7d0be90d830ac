# SPDX-License-Identifier: Apache-2.0
"""The gap watched live: the part of each view's gap that pose error cannot cause; growth is reported at a stated false-alarm rate.

How to feed it (no ROS here)::

    watch = GapWatch(Raycaster(scene), WatchConfig())
    seen = watch.add(view, T_cell_camera, pose_cov)   # once per view, in order of time, at the label's pose
    seen.state       # "learning", "steady" or "grown": the level of /diagnostics (OK, OK, WARN)
    seen.message     # one line for it
    seen.residual    # (H, W) metres, measured minus rendered: the topic gap/residual

`pose_cov` is the label's: (6, 6) of a right perturbation of the camera (from a PoseWithCovariance by `se3.cov_right`). A view whose pose was
refused must not be added. `watch.restart()` forgets the baseline, as after a repair, another camera or another scene.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import param, section
from tof_core.errors import RefusedError
from tof_core.stats import blocks
from tof_gap.limits.evidence import EvidenceLimits
from tof_gap.seen.evidence.residual import gather
from tof_scene.render import render
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True)
class WatchConfig:
    """When a growing gap is reported."""

    baseline: int = param(20, "views of the baseline, before growth is tested", low=6, high=1000, why="p-values down to 5 %")
    views_per_alarm: int = param(
        1000, "least mean number of healthy views per false alarm", low=20, why="with a dwell every ten seconds, one in three hours"
    )
    calm_views: int = param(5, "usual views in a row that end an alarm", low=1, why="one usual view occurs by chance")
    calm: float = param(0.25, "p-value above which a view is usual", low=0.0, high=1.0, why="three of four healthy views")
    arm_mm: float = param(1.0, "position error of a pose without covariance", unit="mm", low=1e-3, why="the arm's own error")
    arm_deg: float = param(0.1, "rotation error of a pose without covariance", unit="deg", low=1e-4, why="the arm's own error")
    block_px: int = param(
        16, "side of a block of pixels with a common error", unit="px", low=2, high=256, why="neighbours share errors, blocks less so"
    )
    block_pixels: int = param(40, "least pixels of a block", low=1, why="a sixth of the block; its mean is known to a sixth of the noise")
    blocks: int = param(6, "least blocks of a view", low=2, why="the pose has six unknowns")
    evidence: EvidenceLimits = section(EvidenceLimits, "which pixels count")

    @property
    def pose_cov(self) -> Float:
        """(6, 6) covariance of a pose that states none."""
        return np.diag(np.repeat([self.arm_mm * 1e-3, np.radians(self.arm_deg)], 3) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """Result of one view.

    gap_mm: RMS of block means above the floor, 0 where they do not exceed it; floor_mm: RMS of block means by noise and pose error
    alone; usual_mm: median gap of the baseline (NaN while learning); alarm: 0 to 1, at 1 growth is reported; parts_mm: for each part in
    view, RMS of measured minus rendered beyond the noise, in mm.
    """

    state: str
    gap_mm: float
    floor_mm: float
    usual_mm: float
    alarm: float
    views: int
    residual: Float
    parts_mm: Mapping[str, float] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """One line for diagnostics."""
        seen = f"gap {self.gap_mm:.2f} mm (noise and pose error: {self.floor_mm:.2f})"
        if self.state == "learning":
            return f"learning the baseline, {self.views} views so far: {seen}"
        usual = f"usual {self.usual_mm:.2f} mm over {self.views} views"
        return f"the gap grows: {seen}, {usual}: ~/diagnose names the cause" if self.state == "grown" else f"{seen}, {usual}"


BETS = ((0.1, 0.5), (0.3, 0.5))
"""(quantile q, stake) of each bet that a new view lies in the baseline's upper share q: pays 1 - stake + stake / q there, 1 - stake elsewhere.

The false-alarm rate holds for any bets."""


@dataclass(slots=True)
class GrowthTest:
    """A test whether values grow, by their ranks alone, so that it holds for any distribution.

    The rank of a new value among all earlier ones gives a p-value, which is uniform while values are exchangeable. A bet on small
    p-values therefore wins nothing on average. The fortunes of the bets follow Shiryaev and Roberts' rule (Vovk 2021, "conformal
    e-detectors"): R = (R + 1) e. E[R] grows by at most one per view, so the mean run to R = `views_per_alarm` is at least that number
    of views. During an alarm, new values do not enter the pool; it ends when `calm_views` in a row have a p-value above `calm`.
    """

    config: WatchConfig
    grown: bool = False
    alarm: float = 0.0
    _pool: list[float] = field(default_factory=list)
    _fortune: list[float] = field(default_factory=lambda: [0.0] * len(BETS))
    _calm: int = 0
    _rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    @property
    def learning(self) -> bool:
        """Whether the baseline is still gathered."""
        return len(self._pool) < self.config.baseline

    @property
    def usual(self) -> float:
        """Median of the pool."""
        return float(np.median(self._pool)) if self._pool else float("nan")

    def add(self, value: float) -> None:
        """The next value."""
        if not self.learning:
            p = self._p_value(value)
            if self.grown:
                self._calm = self._calm + 1 if p > self.config.calm else 0
                if self._calm < self.config.calm_views:
                    return
                self.grown, self._calm, self._fortune = False, 0, [0.0] * len(BETS)
            else:
                self._fortune = [(r + 1) * (1 - s + (s / q if p <= q else 0.0)) for r, (q, s) in zip(self._fortune, BETS, strict=True)]
            self.alarm = min(float(np.mean(self._fortune)) / self.config.views_per_alarm, 1.0)
            self.grown = self.alarm >= 1.0
            if self.grown:
                return
        insort(self._pool, value)

    def _p_value(self, value: float) -> float:
        """Share of the pool and of the value itself that is as large or larger; ties are broken at random."""
        above = len(self._pool) - bisect_right(self._pool, value)
        ties = bisect_right(self._pool, value) - bisect_left(self._pool, value) + 1
        return float((above + self._rng.uniform() * ties) / (len(self._pool) + 1))


class GapWatch:
    """The gap of each view against a baseline."""

    def __init__(self, caster: Raycaster, config: WatchConfig | None = None) -> None:
        """Nothing seen yet."""
        self.caster, self.config = caster, config or WatchConfig()
        self._camera: object = None
        self.restart()

    def restart(self) -> None:
        """Forget the baseline."""
        self._test = GrowthTest(self.config)
        self._camera = None
        self._views = 0

    def add(self, view: View, T_cell_camera: Float, pose_cov: Float | None = None) -> Watched:
        """Judge the next view at its estimated pose.

        Args:
            view: a capture or a dwell, unfiltered.
            T_cell_camera: (4, 4) the label's pose of the camera (never a free registration of this view, which hides the gap).
            pose_cov: (6, 6) of its right perturbation, metres and radians; the arm's prior where None.

        Raises:
            RefusedError: another camera than before, or too little of the CAD in view.
        """
        if self._camera not in (None, view.camera):
            raise RefusedError("the camera's calibration changed", where="gap", todo="its baseline is of another camera: call ~/reset")
        (evidence,) = gather([view], [render(self.caster, view.camera, T_cell_camera)], self.caster, self.config.evidence)
        gap2, floor2 = gap_beyond_pose(evidence, self.config.pose_cov if pose_cov is None else np.asarray(pose_cov, float), self.config)
        self._camera = view.camera
        self._test.add(gap2)
        self._views += 1
        state = "grown" if self._test.grown else "learning" if self._test.learning else "steady"
        usual = float("nan") if self._test.learning else 1e3 * max(self._test.usual, 0.0) ** 0.5
        return Watched(
            state,
            1e3 * max(gap2, 0.0) ** 0.5,
            1e3 * floor2**0.5,
            usual,
            self._test.alarm,
            self._views,
            evidence.residual.astype(np.float32),
            part_gaps(evidence, self.caster.scene.names, self.config.block_pixels),
        )


def part_gaps(view: ViewEvidence, names: Sequence[str], least: int) -> dict[str, float]:
    """RMS in mm of the residual beyond the noise, for each part that at least `least` smooth pixels show."""
    part, beyond = view.rendering.part[view.smooth], view.residual[view.smooth] ** 2 - view.sigma[view.smooth] ** 2
    seen = part >= 0
    count = np.bincount(part[seen], minlength=len(names))
    square = np.bincount(part[seen], beyond[seen], minlength=len(names))
    return {name: 1e3 * float(max(s / n, 0.0)) ** 0.5 for name, n, s in zip(names, count, square, strict=True) if n >= least}


def gap_beyond_pose(view: ViewEvidence, pose_cov: Float, config: WatchConfig) -> tuple[float, float]:
    """(gap, floor) in m^2: floor is the mean square of block means by noise and pose error; gap is the measured one less the floor.

    The most likely pose error by its covariance (6, 6) is subtracted first. The gap may be negative: without a gap its mean is 0.

    Raises:
        RefusedError: too few blocks of the view see the CAD.
    """
    by_block = blocks(view.smooth, config.block_px)
    n = by_block.count
    enough = n >= config.block_pixels
    if enough.sum() < config.blocks:
        msg = f"only {int(enough.sum())} blocks of pixels see the CAD"
        raise RefusedError(msg, where="gap", todo="views that see parts of the scene can be watched")

    def mean(values: Float) -> Float:
        return by_block.mean(values)[enough]

    J = pose_columns(view.frame)[view.smooth]
    A = np.stack([mean(J[:, k]) for k in range(6)], axis=1)
    e, white2 = mean(view.residual[view.smooth]), mean(view.mean_sigma[view.smooth] ** 2) / n[enough]
    # The most likely pose error under its covariance and white noise; its posterior belongs to the floor.
    W = A / white2[:, None]
    posterior = np.linalg.inv(A.T @ W + np.linalg.inv(pose_cov + 1e-14 * np.eye(6)))
    left = e - A @ (posterior @ (W.T @ e))
    weight = n[enough] / n[enough].sum()
    pose2 = np.einsum("bi,ij,bj->b", A, posterior, A)
    # The fit of the pose removes its share of the noise too.
    return float(weight @ (left**2 - (white2 - pose2))), float(weight @ (white2 + pose2))
