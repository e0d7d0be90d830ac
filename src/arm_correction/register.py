# SPDX-License-Identifier: Apache-2.0
"""Registration of one depth image to another: point to plane by projection, from near or from many starts, with undetermined directions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.bias import bias_covariance, sights
from arm_correction.kernels import associate, misfits
from arm_correction.starts import spread_starts
from arm_correction.unknown import SCALE, Unknown, inflation_of, smallest_motion, unknown_directions
from tof_align.robust import tukey
from tof_core import se3
from tof_core.shares import in_percent
from tof_core.stats import robust_std

if TYPE_CHECKING:
    from collections.abc import Sequence

    from arm_correction.config import CorrectConfig
    from arm_correction.surface import Surface
    from tof_core.arrays import Float

COARSE_M = 0.04, 0.02
"""In the search: largest misfit of a point, and misfit of a point that leaves the image, metres."""
FINE_M = 0.012, 0.0025
"""The same for the choice between solutions."""
SLIDES = (0.08, 20), (0.03, 3)
"""Reach, and steps each way, of the search along the least determined direction and the next one."""
CLEAR = 0.9, 0.5
"""Support and overlap beyond which the near search is the result and nothing else is tried."""
HIDDEN_M = 0.025
"""A point further behind the reference's surface was hidden by it: it neither agrees nor disagrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Pose of the camera in the reference's camera frame.

    T_reference_now (4, 4): of all motions that fit, the smallest; cov (6, 6) of its right perturbation, metres and radians;
    unknown: undetermined directions; accepted and reason; pixels that both images see, overlap (their share of the view),
    support (share of them that agree), rms in metres, misfit: the cost by which starts are compared; far: whether many starts were
    needed; by: target of the registration, `reference` or `cad`.
    """

    T_reference_now: Float
    cov: Float
    unknown: Unknown
    accepted: bool
    reason: str
    pixels: int
    overlap: float
    support: float
    rms: float
    misfit: float
    far: bool
    by: str = "reference"


@dataclass(frozen=True, slots=True, eq=False)
class Matcher:
    """A reference's surface, and points (n, 3) of the view with their sigma (n,)."""

    reference: Surface
    points: Float
    sigma: Float
    seen: Float
    """(m, 3) a sample of all the view's points, edges too."""
    slack: Float
    """(m,) metres that noise may make of their depth."""
    config: CorrectConfig

    @property
    def K(self) -> Float:
        """fx, fy, cx, cy of the reference."""
        c = self.reference.camera
        return np.array([c.fx, c.fy, c.cx, c.cy])

    def against(self, reference: Surface) -> Matcher:
        """The same view against another surface."""
        return replace(self, reference=reference)

    def misfits(self, motions: Float, *, coarse: bool = False) -> Float:
        """(m,) misfit of motions (m, 4, 4), metres."""
        return self._misfits(motions, coarse=coarse)[0]

    def rivalry(self, winner: Float, motions: Float) -> float:
        """Misfit of the best other solution among motions (m, 4, 4) over that of `winner` (4, 4); inf without another solution.

        The cost of the winner's neutral points is subtracted from both. It is the same for every solution, and where the
        images overlap little it would make any two solutions look alike.
        """
        trust = self.config.trust
        apart = np.array([se3.distance(winner, T) for T in motions])
        other = motions[(apart[:, 0] > trust.rival_mm * 1e-3) | (apart[:, 1] > trust.rival_deg)]
        if not len(other):
            return float("inf")
        scores, silent = self._misfits(np.concatenate([winner[None], other]), coarse=False)
        said_by_nothing = FINE_M[1] * silent[0]
        least = scores[1:].min()
        return float((least - said_by_nothing) / max(scores[0] - said_by_nothing, 1e-5)) if np.isfinite(least) else float("inf")

    def _misfits(self, motions: Float, *, coarse: bool) -> tuple[Float, Float]:
        limit, neutral = COARSE_M if coarse else FINE_M
        step = max(1, len(self.seen) // self.config.register.coarse_pixels) if coarse else 1
        motions, least = np.ascontiguousarray(motions), self.config.trust.min_overlap
        scores, silent = misfits(motions, self.seen[::step], self.slack[::step], self.reference.depth, self.K, limit, neutral, least)
        return np.asarray(scores), np.asarray(silent)

    def linearise(self, T: Float, stride: int = 1) -> tuple[Float, Float, Float, Float, Float]:
        """Residual (k,), Jacobian (k, 6), sigma of the residual (k,), the normal's tilt (k,), points (k, 3)."""
        ref, points = self.reference, self.points[::stride]
        at, e, J, cosine = associate(T, points, ref.depth, ref.normal, ref.usable, ref.camera.rays(), self.K)
        pixel = at[:, 1]
        sigma = np.hypot(self.sigma[::stride][at[:, 0]], ref.sigma.ravel()[pixel]) * cosine
        return e, J, sigma, ref.tilt.ravel()[pixel], points[at[:, 0]]

    def by_bias(self, T: Float) -> Float:
        """(k, m) derivative of the residuals of `linearise` by the camera's bias at the knots of `bias.sights`."""
        ref = self.reference
        at, *_ = associate(T, self.points, ref.depth, ref.normal, ref.usable, ref.camera.rays(), self.K)
        points, normal = self.points[at[:, 0]], ref.normal.reshape(-1, 3)[at[:, 1]]
        radial, rays = np.linalg.norm(points, axis=1), ref.camera.rays().reshape(-1, 3)[at[:, 1]]
        length = np.linalg.norm(rays, axis=1)
        now = sights(points / radial[:, None] @ T[:3, :3].T, normal, radial)
        then = sights(rays / length[:, None], normal, ref.depth.ravel()[at[:, 1]] * length)
        return now - then

    def refine(self, T: Float, kernel: float, *, stride: int = 1, rounds: int = 20) -> Float:
        """Gauss-Newton from T with a kernel that narrows."""
        floor = 4e-3
        for _ in range(rounds):
            e, J, sigma, _, _ = self.linearise(T, stride)
            if len(e) < 30:
                return T
            weight = tukey(e, kernel) / (sigma**2 + (0.1 * kernel) ** 2)
            H = (J * weight[:, None]).T @ J
            scale = np.sqrt(np.diag(H)) + 1e-12
            step = -np.linalg.solve(H / np.outer(scale, scale) + 1e-4 * np.eye(6), (J.T @ (weight * e)) / scale) / scale
            step *= min(1.0, 0.15 / max(float(np.linalg.norm(step[:3])), 3 * float(np.linalg.norm(step[3:])), 1e-12))
            T = T @ se3.exp(step)
            near = e[np.abs(e) < kernel]
            wanted = max(self.config.register.kernel * robust_std(near), floor)
            kernel = max(min(kernel, wanted), 0.6 * kernel)
            if np.linalg.norm(step[:3]) < 3e-5 and np.linalg.norm(step[3:]) < 3e-5 and kernel < 2.0 * wanted:
                break
        return T


def register(matcher: Matcher, T_guess: Float, others: Sequence[Float] = ()) -> Registration:
    """Find `T_reference_now` from the robot's own pose, and from many starts around it if that fails.

    Args:
        matcher: the two images.
        T_guess: (4, 4) the robot's own pose.
        others: more starts, for instance from features of the colour images.
    """
    rounds = matcher.config.register.rounds
    wide = matcher.refine(T_guess, matcher.config.register.far_kernel_mm * 1e-3 * 0.5, stride=3, rounds=rounds)
    # A wide kernel may slide along a pipe away from a correct guess, so the narrow one is tried as well.
    near = np.array([matcher.refine(wide, 0.01, rounds=rounds), matcher.refine(T_guess, 0.01, rounds=rounds)])
    answer = _look_around(matcher, near)
    if answer.accepted and answer.unknown.rank == 6 and answer.support > CLEAR[0] and answer.overlap > CLEAR[1]:
        return answer
    return _search(matcher, [T_guess, *others], near)


def settle(matcher: Matcher, T: Float) -> Registration:
    """The near search from a trusted start."""
    return _look_around(matcher, matcher.refine(T, 0.02, rounds=matcher.config.register.rounds)[None])


def _look_around(matcher: Matcher, answers: Float, *, far: bool = False) -> Registration:
    """Search a few centimetres around the best of `answers` (k, 4, 4) for a better one; all of them are its rivals.

    Along a weakly determined direction a descent can stop early.
    """
    T = answers[np.argmin(matcher.misfits(answers))]
    starts = T @ spread_starts(256, 0.04, np.radians(2.0))
    best = starts[1:][np.argsort(matcher.misfits(starts[1:], coarse=True), kind="stable")[:4]]
    slid = _slides(matcher, T)
    slid = slid[np.argsort(matcher.misfits(slid), kind="stable")[:3]]
    found = np.array([T, *answers, *(matcher.refine(s, 0.02, stride=4, rounds=10) for s in (*best, *slid))])
    scores = matcher.misfits(found)
    winner = int(np.argmin(scores))
    if winner > len(answers):
        found[winner] = matcher.refine(found[winner], 0.01, rounds=matcher.config.register.rounds)
        scores = matcher.misfits(found)
    return judge(matcher, found[winner], float(scores[winner]), far=far, rivalry=matcher.rivalry(found[winner], found))


def _slides(matcher: Matcher, T: Float) -> Float:
    """(k, 4, 4) motions along the two least determined directions: along a pipe only a flange determines the pose, and it is narrow."""
    e, J, sigma, _, _ = matcher.linearise(T, 4)
    if len(e) < 30:
        return T[None]
    weight = tukey(e, 0.01) / sigma**2
    Js = J / SCALE
    weakest = np.linalg.eigh((Js * weight[:, None]).T @ Js)[1][:, :2] / SCALE[:, None]
    steps = [np.linspace(-reach, reach, 2 * count + 1) for reach, count in SLIDES]
    return np.array([T @ se3.exp(a * weakest[:, 0] + b * weakest[:, 1]) for a in steps[0] for b in steps[1]])


def _search(matcher: Matcher, guesses: Sequence[Float], near: Float) -> Registration:
    """Score many starts around the first guess, refine the best and the other guesses, and compare the results with `near` (k, 4, 4)."""
    c = matcher.config.register
    starts = guesses[0] @ spread_starts(c.tried, c.reach_mm * 1e-3, np.radians(c.reach_deg))
    best = starts[np.argsort(matcher.misfits(starts, coarse=True), kind="stable")[: c.kept]]
    found = np.array([matcher.refine(T, c.far_kernel_mm * 1e-3, stride=12, rounds=12) for T in [*best, *guesses[1:]]])
    found = found[[any(_within(T, guess, matcher.config) for guess in guesses) for T in found]]
    leading = _distinct(found, matcher.misfits(found)) if len(found) else []
    polished = [matcher.refine(matcher.refine(found[i], 0.02, stride=3, rounds=c.rounds), 0.01, rounds=c.rounds) for i in leading]
    return _look_around(matcher, np.array([*polished, *near]), far=True)


def _within(T: Float, guess: Float, config: CorrectConfig) -> bool:
    """Whether a solution lies in the searched region, with a margin."""
    metres, degrees = se3.distance(guess, T)
    return 1e3 * metres < 1.3 * config.register.reach_mm and degrees < 1.3 * config.register.reach_deg


def _distinct(motions: Float, scores: Float, most: int = 8) -> list[int]:
    """The best solutions without duplicates."""
    out: list[int] = []
    for i in np.argsort(scores, kind="stable"):
        apart = [se3.distance(motions[i], motions[j]) for j in out]
        if all(metres > 0.01 or degrees > 1.0 for metres, degrees in apart):
            out.append(int(i))
        if len(out) == most:
            break
    return out


def judge(matcher: Matcher, T: Float, misfit: float, *, far: bool, rivalry: float = np.inf) -> Registration:
    """Covariance, undetermined directions and verdict of a solution. Along undetermined directions it is moved back to the smallest motion."""
    trust, limits = matcher.config.trust, matcher.config.register
    e, J, sigma, tilt, points = matcher.linearise(T)
    unknown, cov = Unknown.all_(), np.diag(np.repeat([1.0, 1.0], 3))
    width = max(limits.kernel * robust_std(e), 4e-3)
    weight = tukey(e, width) / sigma**2
    if int((weight > 0).sum()) >= 30:
        unknown, cov = unknown_directions(e, J, weight, tilt, points, trust)
        cov = cov + bias_covariance(e, J, weight, matcher.by_bias(T), unknown, inflation_of(e, weight))
    agree = np.abs(e) < np.minimum(trust.agree_mm * 1e-3, np.maximum(4.0 * sigma, 3e-3))
    shown = e > -HIDDEN_M
    overlap, support = int(shown.sum()) / max(len(matcher.points), 1), float(agree[shown].mean()) if shown.any() else 0.0
    rms = float(np.sqrt((e[agree] ** 2).mean())) if agree.any() else float("nan")
    moved = smallest_motion(T, unknown.null)
    reason = ""
    if len(e) < trust.min_pixels:
        reason = f"low support: only {len(e)} pixels see what the reference sees (at least {trust.min_pixels})"
    elif overlap < trust.min_overlap:
        reason = f"low support: {in_percent(overlap)} of the view lies in the reference (at least {in_percent(trust.min_overlap)})"
    elif support < trust.min_support:
        reason = f"low support: {in_percent(support)} of {len(e)} pixels agree (at least {in_percent(trust.min_support)})"
    elif unknown.rank == 0:
        reason = "no direction is determined"
    elif rivalry < trust.rival and unknown.rank == 6:
        reason = f"ambiguous: another pose fits nearly as well (its misfit is {rivalry:.2f} times as large; at least {trust.rival:g} is required)"
    return Registration(moved, cov, unknown, not reason, reason or "ok", len(e), overlap, support, rms, misfit, far)
