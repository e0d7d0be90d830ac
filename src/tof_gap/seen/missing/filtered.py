# SPDX-License-Identifier: Apache-2.0
"""Outliers of low amplitude that the camera removed, with their neighbours, one by one or now and then; failed phase unwrapping makes such."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import binary_dilation, binary_opening, label, uniform_filter

from tof_core.shares import in_percent
from tof_core.stats import pairs_below
from tof_gap.seen.evidence.edges import edge_band
from tof_gap.seen.finding import LOSS_CONFIDENT, Finding
from tof_gap.seen.missing.lost import NEIGHBOURS, expected, lost_share, not_judged
from tof_sensor.effects.phase_wrap import SINGLE_PIXELS, PhaseWrap
from tof_sensor.frame import lambert_amplitude

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Image, Mask
    from tof_gap.limits.filters import FilterLimits
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence


EVEN = 0.5
"""Chance that a lost pixel is dimmer than another one where there is nothing to compare."""


@dataclass(frozen=True, slots=True)
class Removed:
    """Pixels that the camera removed as outliers of low amplitude.

    gone: (H, W) per view, all False where there are none; how: what tells them from pixels below a threshold, in words; each: pixels that
    one outlier takes.
    """

    gone: list[Mask]
    how: str = ""
    each: int = 1


def failed_unwrapping(views: Sequence[ViewEvidence], removed: Removed, limits: MissingLimits) -> Finding | None:
    """`phase_wrap` where the camera removed outliers at low amplitude that are too large for noise.

    The lower the amplitude, the more pixels are unwrapped wrongly when frequencies are merged. A filter that removes these pixels with
    their neighbours leaves no depth that is off by a period, but holes of the filter's shape; a check of single pixels leaves holes that
    do not depend on their neighbours; and from capture to capture other pixels are outliers. Below a threshold of amplitude, pixels are
    lost in all captures, in holes of any shape, whose rims are as dim as the threshold.

    removed: the result of `filtered`.
    """
    inside, gone = [expected(v, limits) for v in views], removed.gone
    lost = np.concatenate([np.where(g, lost_share(v), 0.0)[i] for v, g, i in zip(views, gone, inside, strict=True)])
    if not len(lost) or lost.mean() < limits.lost_share or noise_may_reach(views, gone, limits):
        return None
    # A pixel is lost where it or another one that the filter takes with it is an outlier.
    share = min(1.0 - (1.0 - float(lost.mean())) ** (1 / removed.each), 0.5 * SINGLE_PIXELS)
    start = float(np.quantile(np.concatenate([v.frame.radial[g] for v, g in zip(views, gone, strict=True)]), limits.turn_start))
    of_all = in_percent(float(lost.mean()))
    note = f"the camera's filter removed {of_all} of the pixels, around outliers in weak light; their jump is not seen"
    size = f"by a step that is not seen, since the camera removed these pixels: {of_all} of all, {removed.how}"
    # An effect outside the vocabulary may make outliers, too.
    return Finding(
        PhaseWrap(start_m=start, share=share),
        LOSS_CONFIDENT,
        note=note,
        size=size,
        structure=True,
        holes=tuple(gone),
        lost=float(lost.mean()),
    )


def filtered(views: Sequence[ViewEvidence], limits: MissingLimits) -> Removed:
    """Pixels that the camera removed as outliers of low amplitude.

    They are lost in some captures of a dwell and not in others, in holes of a filter's shape, or independently of their neighbours.
    Besides, rims are brighter than those of a threshold, and lost pixels have a lower amplitude than measured ones. None is returned
    without an amplitude image.
    """
    inside = [expected(v, limits) for v in views]
    lost = [~(v.view.valid | not_judged(v)) & i for v, i in zip(views, inside, strict=True)]
    at_times = [v.view.valid & i & (v.view.returned > 0.0) & (v.view.returned < 1.0) for v, i in zip(views, inside, strict=True)]
    if _changes(views, inside, at_times, limits) and _of_outliers(views, inside, at_times, at_times, limits.filter):
        either = [np.asarray(a | g) for a, g in zip(at_times, lost, strict=True)]
        return Removed(either, "in some captures of a dwell and not in others, in weak light")
    shaped = [_shaped(v.view.valid | not_judged(v), limits.filter) & i for v, i in zip(views, inside, strict=True)]
    single = [_single(v.view.valid) & i for v, i in zip(views, inside, strict=True)]
    if _pixels(shaped) >= _pixels(single):  # Few holes of independent pixels have a filter's shape by chance.
        if _of_outliers(views, inside, shaped, shaped, limits.filter):
            return Removed(shaped, "in holes of 3 x 3 pixels in weak light", NEIGHBOURS.size)
    elif _independent(views, inside, single, limits) and _of_outliers(views, inside, single, lost, limits.filter):
        return Removed(lost, "one by one in weak light")
    return Removed([np.zeros(i.shape, bool) for i in inside])


def _changes(views: Sequence[ViewEvidence], inside: Sequence[Mask], at_times: Sequence[Mask], limits: MissingLimits) -> bool:
    """Whether much of the loss is of pixels that other captures of the same dwell measure: those `at_times`, (H, W) per view."""
    share = [lost_share(v) for v in views]
    changing = sum(float(s[a].sum()) for s, a in zip(share, at_times, strict=True))
    whole = sum(float(s[i].sum()) for s, i in zip(share, inside, strict=True))
    return changing > max(limits.lost_share * _pixels(inside), limits.filter.at_times * whole)


def _of_outliers(
    views: Sequence[ViewEvidence], inside: Sequence[Mask], holes: Sequence[Mask], gone: Sequence[Mask], limits: FilterLimits
) -> bool:
    """Whether the rims of `holes` are brighter than a threshold's, and the pixels `gone` dimmer than measured ones; all (H, W) per view."""
    rims: list[Image] = []
    returned: list[Image] = []
    for v, i, h in zip(views, inside, holes, strict=True):
        amplitude = np.full(i.shape, np.float32(np.nan)) if v.view.amplitude is None else v.view.amplitude
        # Where amplitude jumps, a threshold leaves bright rims too.
        level = ~edge_band(v.frame, v.limits.edge_px, v.limits, creases=True)
        rims.append(amplitude[v.view.valid & i & level & binary_dilation(h & level, NEIGHBOURS)])
        returned.append(amplitude[v.view.valid & i])
    rim, least = np.concatenate(rims), np.concatenate(returned)
    if not len(rim) or not np.median(rim) > limits.rim * np.quantile(least, limits.dimmest, overwrite_input=True):
        return False
    del least, returned
    return chance_dimmer(views, inside, gone) >= limits.dimmer


def _single(valid: Mask) -> Mask:
    """(H, W) lost pixels whose eight neighbours are measured."""
    holes, _ = label(~valid, NEIGHBOURS)
    return np.asarray(~valid & (np.bincount(holes.ravel()) == 1)[holes])


def _independent(views: Sequence[ViewEvidence], inside: Sequence[Mask], single: Sequence[Mask], limits: MissingLimits) -> bool:
    """Whether as many `single` pixels (H, W per view) are lost as where each is lost by itself, at the rate of the pixels around it."""
    seen = expectation = 0.0
    for v, i, s in zip(views, inside, single, strict=True):
        level = i & ~edge_band(v.frame, v.limits.edge_px, v.limits, creases=True)
        near, lost = (uniform_filter(m.astype(float), limits.near_px) for m in (level, level & ~v.view.valid))
        rate = lost[level] / near[level]
        expectation += float((rate * (1.0 - rate) ** (NEIGHBOURS.size - 1)).sum())
        seen += int((s & level).sum())
    return seen > limits.turn_share * _pixels(inside) and seen > limits.filter.alone * expectation


def _pixels(masks: Sequence[Mask]) -> int:
    """Number of pixels of the masks (H, W)."""
    return sum(int(m.sum()) for m in masks)


def removed_for_noise(views: Sequence[ViewEvidence], limits: MissingLimits) -> list[Mask]:
    """(H, W) per view: pixels that a filter removed since their noise reaches what it lets pass; these are no effect."""
    holes = filtered(views, limits).gone
    by_noise = any(h.any() for h in holes) and noise_may_reach(views, holes, limits)
    return holes if by_noise else [np.zeros(h.shape, bool) for h in holes]


def _shaped(valid: Mask, limits: FilterLimits) -> Mask:
    """(H, W) pixels in holes that morphological opening by a 3 x 3 neighbourhood keeps."""
    holes, count = label(~valid, NEIGHBOURS)
    # Beyond the image there is nothing that a filter could have kept.
    kept = binary_opening(np.pad(~valid, 1, constant_values=True), NEIGHBOURS)[1:-1, 1:-1]
    size, whole = (np.bincount(pixels, minlength=count + 1) for pixels in (holes.ravel(), holes[kept]))
    return np.asarray(~valid & (whole > limits.shaped * size)[holes])


def chance_dimmer(views: Sequence[ViewEvidence], inside: Sequence[Mask], gone: Sequence[Mask]) -> float:
    """Chance that a pixel of `gone` has a lower amplitude, by the CAD, than another pixel of `inside`: the area under the ROC curve.

    Even chances without pixels of both. One view after the other, since ranks of all pixels of a long session take a gigabyte.
    """
    lost = np.sort(np.concatenate([lambert_amplitude(v.rendering)[g] for v, g in zip(views, gone, strict=True)]))
    dimmer, pairs = 0.0, 0
    for v, i, g in zip(views, inside, gone, strict=True):
        kept = lambert_amplitude(v.rendering)[i & ~g]
        dimmer += pairs_below(lost, kept)
        pairs += len(lost) * len(kept)
    return dimmer / pairs if pairs else EVEN


def noise_may_reach(views: Sequence[ViewEvidence], holes: Sequence[Mask], limits: MissingLimits) -> bool:
    """Whether noise at the rims is as large as the steps that the filter must pass: a surface at `lost_grazing_deg` over a neighbourhood.

    The filter sees the noise of single captures.
    """
    sigma, passed = [], []
    for v, h in zip(views, holes, strict=True):
        rim = v.smooth & binary_dilation(h, NEIGHBOURS, iterations=2)
        sigma.append(np.sqrt(v.view.captures) * v.sigma[rim])
        passed.append(2 * v.frame.depth[rim] * v.view.camera.pixel_angle * np.tan(np.radians(limits.lost_grazing_deg)))
    s, p = np.concatenate(sigma), np.concatenate(passed)
    return not len(s) or float(np.median(limits.filter.noise_sigma * s / p)) > 1.0
