# SPDX-License-Identifier: Apache-2.0
"""The gap that no named effect explains: whether it is structured, where it lies, what it depends on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import binary_dilation

from tof_gap.seen.finding import not_expected
from tof_gap.seen.missing.by_pixel import lost_by_pixels
from tof_gap.seen.missing.filtered import filtered, removed_for_noise
from tof_gap.seen.missing.lost import brightest, expected, lost
from tof_gap.seen.missing.smeared import smeared
from tof_gap.tell.account import astray2, rough_m, steps2
from tof_gap.tell.block_means import block_means, off_parts, unbiased2
from tof_gap.tell.figures.session import away_from_edges, no_jumps
from tof_gap.tell.figures.where import by_quantity
from tof_gap.tell.image_place import image_place
from tof_gap.tell.line_means import line_sizes_m
from tof_sensor.effect import Evidence
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.limits.report import ReportLimits, UnexplainedLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.finding import Finding
    from tof_gap.tell.account import Account
    from tof_gap.tell.block_means import BlockMeans
    from tof_gap.tell.figures.session import Figures
    from tof_scene.scene import Scene

LOST = "lost pixels"
EDGES = "edge_px"
"""What the error of a filter that smears edges depends on."""
VIEWED = "viewed"
"""What arm errors depend on if they follow distance and amplitude of the views."""
ATTITUDE = "attitude"
"""What turns of the camera depend on if its mount or the arm gives way."""
ARM = "arm"
"""What the robot's poses depend on if they err by more than its prior."""
HAND = "hand"
"""The quantity that arm errors depend on if all views share them or they lie along the optical axis: the camera's place on the hand."""


@dataclass(frozen=True, slots=True)
class Unexplained:
    """The gap that is left above the floor once all named effects are subtracted.

    rmse_mm: RMS of block means above the floor, weighted by information; structured: whether it is more than errors of the named
    effects' maps; share: the part of the gap's energy that is left, that free functions of an observable describe, or that steps of the
    camera along its axis absorb which are no errors of the arm, 0 without structure; depends_on: quantities that it varies with, most first; where: parts that carry it, most first; gross: share of pixels
    away from edges with an error that no bias reaches, 0 where they are as few as tools and cables make; resembles: effects that were
    taken out since the views contradict their maps (`tell.contradicted`): a similar mechanism acts there; in_image: the part of the
    image that carries most, in words.
    """

    rmse_mm: float
    structured: bool
    depends_on: tuple[str, ...]
    where: tuple[str, ...]
    share: float = 0.0
    gross: float = 0.0
    resembles: tuple[str, ...] = ()
    in_image: str = ""


def look(
    found: Account, scene: Scene, limits: ReportLimits, missing: MissingLimits, contradicted: Sequence[str] = (), removed_mm: float = 0.0
) -> Unexplained:
    """Judge the gap that is left away from edges, against the floor, and against what maps of the bias removed first (`removed_mm`, RMS) leave.

    It is structured if any of these holds:
    - Block means exceed those of white noise, over all pixels or over those of one part. Structure of a named noise that neighbours
      share (steps, rows, stripes) is allowed for.
    - Means of the image's columns or rows over all views exceed those of white noise.
    - Pixels away from edges have gross errors, at the final poses and where the solution was linearised, and `phase_wrap` is not named.
    - Pixels are lost, and neither `dropout` nor a noise is named.
    - Only a free function of an observable describes the error, or small effects explain much only together.
    - The joint fit leaves a share of the chi-square that it was to explain, and no noise is named: a larger noise is known less well.
    - Arm errors are alike in every view, or lie along the optical axis and exceed the robot's prior, or follow the views there.
    - Turns by arm errors follow the hand's attitude, or arm errors exceed the robot's prior in positions and in turns.
    - An effect that explained some of the gap was taken out as `contradicted`, and more than errors of a healthy camera and of maps is left.
    - A filter in the camera smears edges.
    """
    solved, figures, gap, limit = found.solved, found.figures, found.gap, limits.unexplained
    views, floor2 = solved.evidence, figures.floors
    depends_on = (*solved.depends_on, *_signs(found, limit, missing))
    gone = _lost_pixels(found, len(scene.parts), missing)
    residual, left = (away_from_edges(figures.edge, errors) for errors in (figures.residual, no_jumps(views, figures.left())))
    noise2 = unbiased2(found, range(len(views)))
    means = block_means(views, left, noise2, limits.block_px, limit.block_pixels)
    if len(means.pixels) == 0:
        return Unexplained(0.0, structured=False, depends_on=(), where=())
    size = 1e3 * float(np.sqrt(means.size2))
    before2 = max(gap.shown_mm[0] ** 2, 1e-9)
    gross = _gross(found, missing)
    exact = not removed_mm and all(EFFECTS[name].EXACT for name in solved.maps)
    allowed2 = limit.share * (before2 + removed_mm**2)
    least_mm, on_part_mm = (limit.alone_mm, limit.alone_mm) if exact else (limit.mm, limit.part_mm)
    off = _parts_off(found, means, residual, noise2, len(scene.parts), limits, on_part_mm)
    least = np.hypot(least_mm, 1e3 * figures.alike_m)
    of_lines = lines_off(line_sizes_m(views, left, noise2), least, allowed2)
    a_gap, beyond_maps = before2 > limit.mm**2, size**2 > allowed2
    structured = (
        (size > least and beyond_maps)
        or bool(of_lines)
        or bool(off.any())
        or gross > limit.gross_share
        or (bool(contradicted) and size > limit.contradicted_mm and beyond_maps)
        or bool(depends_on or (a_gap and solved.small_together) or gone.any())
        or (a_gap and size**2 > limit.share * removed_mm**2 and _misfits(found, residual, left, noise2, limits))
    )
    del residual  # Images of all views are most of a session's memory.
    if not structured:
        return Unexplained(size, structured=False, depends_on=(), where=())
    return Unexplained(
        size,
        structured=True,
        depends_on=_once([LOST] * bool(gone.any()), of_lines, depends_on or _depends_on(views, left, floor2, limits)),
        where=tuple(scene.names[i] for i in _carriers(means, gone, off, limit)),
        share=_share(size**2, (1e3 * solved.unnamed_m) ** 2 + _in_steps2(found), before2),
        gross=gross if gross > limit.gross_share else 0.0,
        resembles=tuple(contradicted),
        in_image=image_place(views, left, noise2, limits.block_px),
    )


def _parts_off(
    found: Account, means: BlockMeans, residual: Sequence[Float], noise2: Sequence[Float], parts: int, limits: ReportLimits, least_mm: float
) -> Mask:
    """(parts,) parts that are off by themselves: by `least_mm` and more, and by more than coarse maps err on parts.

    None beside noise of rows and stripes, which is uneven over parts.
    """
    if found.figures.alike_m:
        return np.zeros(parts, bool)
    views, limit = found.solved.evidence, limits.unexplained
    before = block_means(views, residual, noise2, limits.block_px, limit.block_pixels)
    return off_parts(means, before, parts, len(views), limit, max(least_mm * 1e-3, rough_m(found.solved)))


def _misfits(found: Account, residual: Sequence[Float], left: Sequence[Float], noise2: Sequence[Float], limits: ReportLimits) -> bool:
    """Whether the fit leaves much of the chi-square that it was to explain, where no noise is named."""
    return not noisy(found.findings) and misfit(residual, left, noise2, limits.shrink.noise_known) > limits.unexplained.misfit


def noisy(findings: Sequence[Finding]) -> bool:
    """Whether a noise is named."""
    return any(f.effect.EVIDENCE is Evidence.NOISE for f in not_expected(findings))


def _gross(found: Account, missing: MissingLimits) -> float:
    """Share of gross pixels, the least of the final poses and those of the linearisation; 0 beside `phase_wrap`, which explains them."""
    if any(f.name == PhaseWrap.NAME for f in found.findings):
        return 0.0
    # No model of motion describes surfaces that appear and vanish beside edges while the hand moves.
    reach = missing.edge_reach_px if Motion.NAME in found.solved.maps else 0
    return min(gross_share(v, _explained(found.figures), reach) for v in (found.solved.evidence, found.solved.linearised))


def _carriers(means: BlockMeans, gone: Float, off: Mask, limit: UnexplainedLimits) -> list[int]:
    """Parts that carry what is left, most first: its lost pixels, or its energy on parts that are `off`, or its energy."""
    spread = np.bincount(means.part, np.maximum(means.excess2, 0) / means.white2, len(off))
    energy = gone if gone.any() else spread * off if off.any() else spread
    order = [int(i) for i in np.argsort(-energy, kind="stable") if energy[i] > limit.part_share * energy.sum()]
    return order[: limit.parts]


def lines_off(sizes_m: Mapping[str, float], least_mm: float, least2: float) -> tuple[str, ...]:
    """Lines whose mean errors exceed `least_mm` and, squared, `least2` (mm^2)."""
    return tuple(name for name, size in sizes_m.items() if 1e3 * size > least_mm and (1e3 * size) ** 2 > least2)


def _once(*names: Sequence[str]) -> tuple[str, ...]:
    """All names in order, each once."""
    return tuple(dict.fromkeys(chain.from_iterable(names)))


def _signs(found: Account, limit: UnexplainedLimits, missing: MissingLimits) -> list[str]:
    """What the unexplained depends on by other signs than block means: arm errors, and edges."""
    seen = {
        HAND: found.solved.arms_alike > limit.arms or found.pushed,
        VIEWED: found.follows,
        ATTITUDE: found.sags,
        ARM: found.astray,
        EDGES: smeared(found.solved.bare, missing),
    }
    return [name for name, shown in seen.items() if shown]


def _share(left2: float, free2: float, before2: float) -> float:
    """Share of the gap that no named effect explains: error left, and error of free functions and in steps, over all and the gap (all in mm^2)."""
    return min((left2 + free2) / max(before2 + free2, left2 + free2), 1.0)


def _in_steps2(found: Account) -> float:
    """mm^2: squared error that arm errors absorb where these are no errors of a healthy arm: all of it, or that along the camera's axis."""
    if found.astray:
        return 1e6 * float(astray2(found.solved).mean())
    return 1e6 * float(steps2(found.solved).mean()) if found.pushed or found.follows else 0.0


def misfit(before: Sequence[Float], left: Sequence[Float], floor2: Sequence[Float], noise_known: float) -> float:
    """Chi-square per pixel in excess of the floor: ratio of the errors `left` to the errors `before` ((H, W) metres per view; floor2: m^2).

    0 where `left` exceeds the floor by less than the relative error of the noise variance, `noise_known`.
    """

    def excess(errors: Sequence[Float]) -> float:
        total, pixels = 0.0, 0
        for e, f in zip(errors, floor2, strict=True):
            seen = np.isfinite(e)
            total, pixels = total + float((e[seen].astype(float) ** 2 / f[seen]).sum()), pixels + int(seen.sum())
        return total / pixels - 1.0

    after = excess(left)
    return 0.0 if after < noise_known else after / max(excess(before), after)


def by_part(views: Sequence[ViewEvidence], maps: Iterable[Float], parts: int) -> Float:
    """(parts,) sums of maps (H, W), one per view, by the part that the CAD has there."""
    out = np.zeros(parts)
    for v, values in zip(views, maps, strict=True):
        seen = np.isfinite(values) & (v.rendering.part >= 0)
        out += np.bincount(v.rendering.part[seen].astype(np.int64), values[seen], parts)
    return out


def _lost_pixels(found: Account, parts: int, missing: MissingLimits) -> Float:
    """(parts,) lost pixels of each part; zeros where they are few, or where `dropout`, a noise, or a pattern that a filter stops at is named.

    Where `phase_wrap` is named, a filter in the camera removes pixels beside those that jump: its holes do not count.
    """
    views = found.solved.bare
    if any(f.name == Dropout.NAME or f.effect.makes_outliers for f in found.findings):
        return np.zeros(parts)
    if FixedPattern.NAME in found.solved.maps and lost_by_pixels(views, missing):
        return np.zeros(parts)
    too_bright = brightest(views, missing)
    wraps = any(f.name == PhaseWrap.NAME for f in found.findings)
    removed = filtered(views, missing).gone if wraps else removed_for_noise(views, missing)
    gone = by_part(views, (np.where(r, 0.0, lost(v, missing, too_bright)) for v, r in zip(views, removed, strict=True)), parts)
    inside = sum(int(expected(v, missing).sum()) for v in views)
    return gone if gone.sum() > missing.lost_share * inside else np.zeros(parts)


def _explained(figures: Figures) -> Iterator[Float]:
    """(H, W) metres that all named effects add, one view after the other to save memory."""
    return (figures.total(list(figures.maps), v) for v in range(len(figures.residual)))


def gross_share(views: Sequence[ViewEvidence], named: Iterable[Float], reach_px: int = 0) -> float:
    """Share of gross pixels farther than `reach_px` from edges, mean over views: gross both with and without the named effects (H, W metres)."""
    shares = []
    for v, explained in zip(views, named, strict=True):
        away = ~(binary_dilation(v.edge, iterations=reach_px) if reach_px else v.edge)
        shares.append((v.still_gross(v.residual - explained) & away).sum() / max((np.isfinite(v.residual) & away).sum(), 1))
    return float(np.mean(shares))


def _depends_on(views: Sequence[ViewEvidence], left: Sequence[Float], floor2: Sequence[Float], limits: ReportLimits) -> tuple[str, ...]:
    """Quantities whose bins' means carry the share `quantity_share` or more of the energy left, most first."""
    limit, share = limits.unexplained, {}
    for name, bins in by_quantity(views, left, floor2, limits.where.bins).items():
        if len(bins) < limit.quantity_bins:
            continue
        n = np.array([b.pixels for b in bins], float)
        mean, square, floor = (np.array([getattr(b, k) for b in bins]) for k in ("bias_mm", "rmse_mm", "floor_mm"))
        above = max(float(n @ (square**2 - floor**2)), 1e-9)
        share[name] = float(n @ (mean - np.average(mean, weights=n)) ** 2) / above
    most = sorted(share.items(), key=lambda item: -item[1])
    return tuple(name for name, s in most if s > limit.quantity_share)[: limit.quantities]
