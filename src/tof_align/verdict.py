# SPDX-License-Identifier: Apache-2.0
"""Whether a registration is accepted: by support, improvement and step; and the directions that are not determined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.shares import in_percent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.config import AlignConfig, VerdictConfig
    from tof_align.linearise import Linearised
    from tof_core.arrays import Float


FEW_PIXELS, FITS_NOWHERE, CONTRADICTED = "too few pixels on the CAD", "fits nowhere", "contradicted"
FAR, NO_BETTER = "too far from the robot's pose", "no better than the robot's pose"
"""Why a pose is refused, without numbers."""
PARTLY, APART = "the robot's pose in part", "parts disagree"
"""Remarks on an accepted pose, without numbers."""


@dataclass(frozen=True, slots=True)
class Fit:
    """Agreement of a view with the CAD at one pose.

    pixels: raster pixels with a depth where the CAD has a surface; support: the share of them
    closer than `support_mm` (edges and grazing pixels left out of both); rms: metres, over
    those; score: mean of min(|residual|, support_mm), metres, lower is better.
    """

    pixels: int
    support: float
    rms: float
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """Information (6, 6) of a view's pixels about a right perturbation of a frame: of those that agree with the CAD, and of all."""

    agreeing: Float
    everyone: Float

    def moved(self, links: Float) -> Information:
        """The information about another frame, whose right perturbation moves this one by `links` (6, 6)."""
        return Information(links.T @ self.agreeing @ links, links.T @ self.everyone @ links)

    def __add__(self, other: Information) -> Information:
        """Of both views together."""
        return Information(self.agreeing + other.agreeing, self.everyone + other.everyone)


def information_of(view: Linearised, weight: Float, config: AlignConfig, offset: Float | float = 0.0) -> Information:
    """A view's information about its camera; `weight` (n,) and `offset` (n,) as in the fit."""
    near = _errors(view, config, offset) < config.verdict.support_mm * 1e-3
    plain = view.sigma**-2
    # Pixels that the kernel cut count as much as agreeing ones: neighbours share errors, so n of them are not n measurements.
    share = float(weight[near].sum() / plain[near].sum()) if near.any() else 1.0
    J = view.jacobian * np.sqrt(share * plain)[:, None]
    return Information(J[near].T @ J[near], J.T @ J)


def _errors(view: Linearised, config: AlignConfig, offset: Float | float) -> Float:
    """(n,) distance from the CAD; where the discrepancy explains more than `explained` times the limit, a pixel does not agree."""
    limit = config.verdict.support_mm * 1e-3
    error = np.abs(view.residual - offset)
    return np.where(np.abs(offset) < config.verdict.explained * limit, error, np.maximum(error, limit))


def fit_of(view: Linearised, config: AlignConfig, offset: Float | float = 0.0) -> Fit:
    """Agreement of a view; offset (n,): metres that the fit attributes to the discrepancy."""
    limit, error = config.verdict.support_mm * 1e-3, _errors(view, config, offset)
    if not len(error):
        return Fit(0, 0.0, float("nan"), limit)
    near = error < limit
    rms = float(np.sqrt((error[near] ** 2).mean())) if near.any() else float("nan")
    return Fit(len(error), float(near.mean()), rms, float(np.minimum(error, limit).mean()))


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a pose is accepted, with the reasons.

    accepted; short: the reason in a few words without numbers, by which verdicts are counted; reason: one line; seed, fit: agreement at the robot's pose and at the answer;
    step_mm, step_deg: how far the answer is from the robot's pose; step: the same in the
    robot's standard deviations (Mahalanobis over the rank, 1 is usual); null: degenerate directions in words.
    """

    accepted: bool
    short: str
    reason: str
    seed: Fit
    fit: Fit
    step_mm: float
    step_deg: float
    step: float
    null: tuple[str, ...]


def judge(
    seed: Fit,
    fit: Fit,
    T_seed: Float,
    T: Float,
    cov_prior: Float | None,
    null: tuple[str, ...],
    config: AlignConfig,
    disputed: tuple[float, str] = (1.0, ""),
    apart: str = "",
) -> Verdict:
    """Accept or refuse, with the first reason that applies.

    cov_prior (6, 6): of the right perturbation of `T_seed`; None: no step is too large. disputed: the known direction in which pixels
    disagree most, as the share of its information that agrees with the CAD, and in words (`observability.most_disputed`). apart: parts
    that disagree with the others, in words (`apart_in_words`); "" where all agree.
    """
    limits = config.verdict
    metres, degrees = se3.distance(T_seed, T)
    step = 0.0
    if cov_prior is not None:
        xi = se3.log(se3.inverse(T_seed) @ T)
        step = float(np.sqrt(xi @ np.linalg.solve(cov_prior, xi) / 6.0))
    short = reason = ""
    if fit.pixels < limits.min_pixels:
        short = FEW_PIXELS
        reason = f"only {fit.pixels} pixels see the CAD (at least {limits.min_pixels})"
    elif fit.support < limits.min_support:
        short = FITS_NOWHERE
        reason = f"fits nowhere: {in_percent(fit.support)} of {fit.pixels} pixels within {limits.support_mm:g} mm of the CAD"
    elif disputed[0] < limits.min_support:
        short = CONTRADICTED
        reason = f"of the pixels that determine how it {disputed[1]}, {in_percent(disputed[0])} agree with the CAD: a part is missing, or the pose is wrong"
    elif step > limits.max_step:
        short = FAR
        reason = f"{metres * 1000:.0f} mm and {degrees:.1f}° from the robot's pose, {step:.1f} times what its error allows"
    elif fit.pixels * fit.support < limits.fewer * seed.pixels * seed.support and fit.score > seed.score:
        short = NO_BETTER
        reason = f"no better than the robot's pose ({in_percent(fit.support)} against {in_percent(seed.support)} agree)"
    if reason:
        return Verdict(False, short, reason, seed, fit, metres * 1000, degrees, step, null)
    short, reason = _praise(null, apart)
    return Verdict(True, short, reason, seed, fit, metres * 1000, degrees, step, null)


def _praise(null: tuple[str, ...], apart: str) -> tuple[str, str]:
    """Remarks on an accepted pose: in a few words, and in full."""
    open_ = "robot's pose kept where the data do not say: " + "; ".join(null) if null else ""
    short = "; ".join(word for word, remark in ((PARTLY, open_), (APART, apart)) if remark)
    return short or "ok", "; ".join(filter(None, [open_, apart])) or "ok"


def disagreeing(apart: Float, std: Float, config: VerdictConfig) -> Float:
    """(P,) `apart` of the parts that disagree with the others significantly, 0 for all others.

    apart (P,): metres by which each part is displaced from its CAD; std (P,): its standard deviation.
    """
    sure = (apart > config.part_mm * 1e-3) & (apart > config.part_sigma * std)
    return np.where(sure, apart, 0.0)


def apart_in_words(names: Sequence[str], apart: Float) -> str:
    """The parts that disagree with their CAD, largest first; "" without any. names (P,); apart (P,) metres, 0 where a part agrees."""
    found = [f"{names[p]} by {1e3 * apart[p]:.0f} mm" for p in np.argsort(-apart, kind="stable") if apart[p] > 0]
    return "parts disagree with the CAD: " + ", ".join(found) if found else ""
