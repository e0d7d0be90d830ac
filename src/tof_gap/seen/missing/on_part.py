# SPDX-License-Identifier: Apache-2.0
"""Whether one part loses pixels that it should return, neither too dark nor removed by a filter in the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import pairs_below

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence


def may_lose(gone: Float, part: Ints, limits: MissingLimits) -> bool:
    """Whether any part may lose `lost_on_part` of its pixels, if as many as possible of the others are among the session's darkest.

    Most sessions end here, before the light of all their pixels is computed. Arguments as of `worst_part`.
    """
    for number in range(int(part.max(initial=-1)) + 1):
        mine = part == number
        least = max(int(mine.sum()) - limits.weakest * len(part), limits.part_pixels)
        if float(gone[mine].sum()) >= limits.lost_on_part * least:
            return True
    return False


def own_light(seen: Float, light: Float, part: Ints, limits: MissingLimits) -> Float:
    """(n,) amplitude of each pixel: measured, or predicted by the CAD with the albedo that other pixels of the part show.

    The infrared albedo in scene.yaml may be far from the true one.

    Args:
        seen: (n,) measured amplitude, NaN or 0 without one.
        light: (n,) amplitude that the CAD's albedo predicts, in the same unit.
        part: (n,) index of each pixel's part.
        limits: number of pixels that determine an albedo.
    """
    known = (seen > 0) & (light > 0)
    out = np.where(known, seen, light)
    for number in range(int(part.max(initial=-1)) + 1):  # No counts of all parts at once: these take eight bytes a pixel.
        mine = part == number
        both = known & mine
        if both.sum() >= limits.albedo_pixels:
            ratio = seen[both] / light[both]
            out[mine & ~known] *= np.median(ratio, overwrite_input=True)
    return out


def neighbours_span(view: ViewEvidence, limits: MissingLimits) -> Float:
    """(H, W) range of depth over a neighbourhood by slope and noise of one capture, over the range that a filter in the camera passes.

    A filter passes the rise of a surface at `lost_grazing_deg`, beyond which missing pixels are usual.
    """
    flat = 2.0 * view.frame.depth * view.view.camera.pixel_angle
    slope = np.tan(view.rendering.incidence.astype(np.float64))
    noise = limits.filter.noise_sigma * np.sqrt(view.view.captures) * view.sigma
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.hypot(flat * slope, noise) / (flat * np.tan(np.radians(limits.lost_grazing_deg))))


def worst_part(gone: Float, part: Ints, view: Ints, light: Float, spans: Float, too_bright: float, limits: MissingLimits) -> float:
    """Largest share of its pixels that any part loses, also without the view that loses most of them: two views must show the loss.

    Parts that lose less than `lost_on_part` are not looked at.

    Not counted are: parts with few pixels; pixels among the darkest of the session, of which every camera loses some; parts whose
    brightest pixels are lost at amplitudes that saturate others of this session; and parts whose slope and noise a filter does not pass,
    if amplitude does not separate their lost pixels from the measured ones.

    Args:
        gone: (n,) share of captures in which a pixel is lost.
        part: (n,) its part.
        view: (n,) the view that has it.
        light: (n,) its amplitude (`own_light`).
        spans: (n,) `neighbours_span`.
        too_bright: amplitude that saturates.
        limits: what counts.
    """
    usual = light > np.quantile(light, limits.weakest)
    worst = 0.0
    for number in range(int(part.max(initial=-1)) + 1):
        mine = (part == number) & usual
        if mine.sum() < limits.part_pixels or gone[mine].mean() < limits.lost_on_part:
            continue
        away, kept = mine & (gone > 0.5), mine & (gone <= 0.5)
        if away.any() and kept.any():
            brighter = pairs_below(np.sort(light[kept]), light[away]) / (int(kept.sum()) * int(away.sum()))
            if brighter > limits.brighter and float(np.median(light[away])) > too_bright:
                continue
            if 1.0 - brighter < limits.filter.dimmer and float(np.nanmedian(spans[away])) > 1.0:
                continue
        worst = max(worst, _shown_again(gone[mine], view[mine], limits))
    return worst


def _shown_again(gone: Float, view: Ints, limits: MissingLimits) -> float:
    """Share of a part's pixels that is lost in all views, or without the view that loses most, if that is less; 0 where others see few."""
    other = view != np.argmax(np.bincount(view, gone))
    return min(float(gone.mean()), float(gone[other].mean())) if other.sum() >= limits.part_pixels else 0.0
