# SPDX-License-Identifier: Apache-2.0
"""The figures of a session: residual and floor of the pixels that count, and how far any set of effects shrinks the gap."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from tof_gap.seen.evidence.pattern import single_pixels, without_pattern
from tof_gap.seen.evidence.residual import single
from tof_gap.tell.figures.floor import floor2, shown2
from tof_gap.tell.figures.shrink import Shrink, blocks, measure
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.report import ReportLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.finding import Finding
    from tof_gap.solved import Solved

NOISE_SIGMA = 3.0
"""Standard deviations of noise by which a pixel may lie beside its surface."""
WRAPPED_M = 0.5
"""Metres beyond both surfaces from which a pixel at their edge is mixed, and its frequencies disagree on the wrap: half a wave of 300 MHz, more than
cameras modulate with. Mixing by itself overshoots by 0.3 m at most (two sessions), and wraps were off by 1.3 to 3.9 m."""


@dataclass(frozen=True, eq=False)
class Figures:
    """The arrays that every figure of a session is computed from; lists are per view, images (H, W).

    residual: metres before any effect, NaN where a pixel does not count; floors: m^2; maps: metres per effect; common: metres of
    noise that neighbours share (part of the floors); noise2: m^2 of white noise by held-out view (part of the floors); edge: pixels
    that count only where `flying_pixels` is named; mixed: those of `edge` that are mixed ones (`mixed_pixels`); held:
    held-out views; gross: pixels away from edges that count only where `phase_wrap` is named; unsure2: m^2 along the ray, variance of the error of the fixed pattern's map; step_m: metres between depth codes,
    where `quantization` is named; posed_m: metres of noise that neighbours share and that the poses absorbed; rng: for resampling;
    limits: how the figures are computed; window_px: pixels over which a filter in the camera averages, 1 without one.
    """

    residual: Sequence[Float]
    floors: Sequence[Float]
    maps: Mapping[str, Sequence[Float]]
    common: Sequence[Float]
    noise2: Mapping[int, Float]
    edge: Sequence[Mask]
    gross: Sequence[Mask]
    mixed: Sequence[Mask]
    held: Sequence[int]
    unsure2: Float
    step_m: float
    posed_m: float
    rng: np.random.Generator
    limits: ReportLimits
    window_px: int = 1

    def total(self, names: Sequence[str], view: int) -> Float:
        """(H, W) metres that the named effects add in a view."""
        zero = np.zeros(self.residual[view].shape)
        return np.asarray(np.sum([zero, *(np.nan_to_num(self.maps[n][view]) for n in names)], axis=0))

    @cached_property
    def added2(self) -> dict[str, float]:
        """m^2: mean square of what each named effect adds to depth; without effects that change no mean depth."""
        return {name: float(np.mean([np.mean(np.square(np.nan_to_num(m))) for m in maps])) for name, maps in self.maps.items()}

    def left(self, views: Sequence[int] | None = None) -> list[Float]:
        """(H, W) metres per view that no named effect explains; of these views, None for all."""
        return [self._left(v) for v in (range(len(self.residual)) if views is None else views)]

    def _left(self, view: int) -> Float:
        return single(self.residual[view] - self.total(list(self.maps), view) - self.common[view])

    @property
    def alike_m(self) -> float:
        """Metres of named error that neighbours share: the depth code's step, and errors of the maps of rows, stripes or foreign light."""
        shared = np.hypot(np.sqrt(np.mean([np.mean(np.square(np.nan_to_num(c))) for c in self.common])), self.posed_m)
        return float(np.hypot(self.step_m / np.sqrt(12), self.limits.shrink.common_left * shared))

    def shrink(self, names: Sequence[str]) -> Shrink:
        """Figures before and after subtracting the named effects, on the held-out views."""
        before = [self.residual[v] for v in self.held]
        after = [b - self.total(names, v) for b, v in zip(before, self.held, strict=True)]
        floors = self.floors_shown
        unsure2 = float(self.unsure2.mean()) if FixedPattern.NAME in names else 0.0
        if FlyingPixels.NAME in names:
            after = [np.where(self.mixed[v], np.sqrt(np.maximum(f, 0.0)), a) for v, a, f in zip(self.held, after, floors, strict=True)]
            unsure2 += self._mixed_left(after)
        held_out = blocks(before, after, floors, self.limits.block_px)
        return replace(measure(held_out, self.rng, self.limits.shrink, unsure2), off_edges_mm=self._off_edges_mm(before, after, floors))

    def _off_edges_mm(self, before: Sequence[Float], after: Sequence[Float], floors: Sequence[Float]) -> tuple[float, float] | None:
        """RMS in mm above the noise, before and after, of the held-out pixels that neither lie at edges nor wrap.

        None where pixels at edges and wrapped ones do not count, or where no other pixel is left.

        before, after: (H, W) metres per held-out view; floors: m^2.
        """
        few = [of for name, of in ((FlyingPixels.NAME, self.edge), (PhaseWrap.NAME, self.gross)) if name in self.maps]
        if not few:
            return None
        away = away_from_edges([np.any([of[v] for of in few], axis=0) for v in self.held], before)
        held_out = blocks(away, after, floors, self.limits.block_px)
        return held_out.above_mm if held_out.n.any() else None

    @cached_property
    def floors_shown(self) -> list[Float]:
        """(H, W) m^2 of each held-out view: the floor, with the noise that its pixels show instead of the estimated variance."""
        steady = away_from_edges([self.edge[v] for v in self.held], self.left(self.held))
        limits = self.limits.shrink
        shown = shown2(steady, [self.noise2[v] for v in self.held], limits.noise_shown, limits.noise_px, self.window_px)
        return [self.floors[v] - self.noise2[v] + s for v, s in zip(self.held, shown, strict=True)]

    def _mixed_left(self, after: Sequence[Float]) -> float:
        """m^2, mean over all pixels: energy left at edges. Half a pixel of pose error makes it, and no other effect explains it."""
        left = [np.where(np.isfinite(a), a * a - self.floors[v], 0.0) for a, v in zip(after, self.held, strict=True)]
        pixels = sum(int(np.isfinite(a).sum()) for a in after)
        return max(float(sum(e[self.edge[v]].sum() for e, v in zip(left, self.held, strict=True))), 0.0) / max(pixels, 1)


def figures(solved: Solved, findings: Sequence[Finding], rng: np.random.Generator, limits: ReportLimits) -> Figures:
    """The figures of views at the solution's poses."""
    views, maps, fit_views = solved.evidence, solved.maps, solved.split.fit
    unsure2, quiet = np.zeros(views[0].residual.shape), views
    if FixedPattern.NAME in maps:
        unsure2 = single_pixels([solved.linearised[i] for i in fit_views]).unsure2
        quiet = tuple(without_pattern(views, maps[FixedPattern.NAME], unsure2, fit_views))
    shared = [f.common for f in findings if f.common is not None]
    nothing = np.broadcast_to(0.0, views[0].residual.shape)
    common = [np.asarray(sum((c[v] for c in shared), nothing)) for v in range(len(views))]
    # A wrong mount or lens is simulated to first order beside the edges that are seen through the right one.
    edge = [v.edge | true.edge for v, true in zip(views, solved.bare, strict=True)]
    return Figures(
        residual=[used(v, findings) for v in views],
        # Named noise is no bias to be subtracted: it belongs to the floor.
        floors=[single(f + np.nan_to_num(c) ** 2) for f, c in zip(floor2(quiet, solved.camera_covs), common, strict=True)],
        maps={**maps, **{f.name: list(f.share) for f in findings if f.corrects and f.share is not None}},
        common=common,
        noise2={v: quiet[v].sigma ** 2 for v in solved.split.held_out},
        edge=edge,
        gross=[v.gross & ~e for v, e in zip(views, edge, strict=True)],
        mixed=[mixed_pixels(true, e) for true, e in zip(solved.bare, edge, strict=True)],
        held=solved.split.held_out,
        unsure2=unsure2,
        step_m=max((f.effect.step_m for f in findings if isinstance(f.effect, Quantization)), default=0.0),
        posed_m=max((f.posed_m for f in findings), default=0.0),
        rng=rng,
        limits=limits,
        window_px=views[0].correlation.window_px,
    )


def away_from_edges(edges: Sequence[Mask], errors: Sequence[Float]) -> list[Float]:
    """(H, W) metres per view, NaN at edges, where half a pixel of pose error decides."""
    return [np.where(edge, np.nan, e) for edge, e in zip(edges, errors, strict=True)]


def no_jumps(views: Sequence[ViewEvidence], errors: Sequence[Float]) -> list[Float]:
    """(H, W) metres per view, NaN at gross pixels whose error is still too large for a bias: they jump by a length that `phase_wrap` has not."""
    return [np.where(v.still_gross(e), np.nan, e) for v, e in zip(views, errors, strict=True)]


def mixed_pixels(view: ViewEvidence, edge: Mask) -> Mask:
    """(H, W) mixed pixels: those of `edge` (H, W) whose depth lies between those of the two surfaces there, up to noise, or wraps beyond both.

    Their mixed share, and so the depth that a map predicts, depends on half a pixel of pose: only that they are mixed is known. A share
    of 0 or 1 is among them: such a pixel shows one of its two surfaces, with noise on either side of it.
    """
    cad, noise = view.frame.depth, NOISE_SIGMA * view.sigma
    near, far = minimum_filter(np.nan_to_num(cad, nan=np.inf), 3), maximum_filter(np.nan_to_num(cad, nan=-np.inf), 3)
    with np.errstate(invalid="ignore"):
        at, beyond = view.view.depth, np.maximum(view.view.depth - far, near - view.view.depth)
        return np.asarray(edge & ((at > near - noise) & (at < far + noise) | (beyond > WRAPPED_M)))


def used(view: ViewEvidence, findings: Sequence[Finding]) -> Float:
    """(H, W) the residual of the pixels that count; NaN elsewhere.

    Gross errors and edges count only if a named effect explains them. Pixels with a named noise of their own do not count.
    """
    names = {f.name for f in findings if f.corrects}
    keep = view.smooth.copy()
    if PhaseWrap.NAME in names:
        keep |= view.gross & ~view.edge
    if FlyingPixels.NAME in names:
        keep |= view.edge & (view.rendering.mixed > 0) & (view.rendering.mixed < view.limits.own_share) & np.isfinite(view.residual)
    for finding in findings:
        if finding.own_noise is not None:
            keep &= ~finding.own_noise
    return np.where(keep, view.residual, np.nan)
