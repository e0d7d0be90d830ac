# SPDX-License-Identifier: Apache-2.0
"""Lost returns: pixels on the CAD, away from edges, without a measured depth."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation, binary_fill_holes, label, uniform_filter

from tof_core.reasons import Reason
from tof_core.stats import joined
from tof_gap.seen.evidence.between_points import hides_loss
from tof_gap.seen.evidence.residual import single
from tof_gap.seen.finding import LOSS_CONFIDENT, Finding
from tof_gap.seen.missing.loss import STRICT, GoesWith, curve, loss_of
from tof_gap.seen.missing.on_part import may_lose, neighbours_span, own_light, worst_part
from tof_gap.seen.missing.shadow import shadowed
from tof_gap.seen.session import amplitude_unit
from tof_sensor.effects.dropout import Dropout
from tof_sensor.frame import lambert_amplitude
from tof_sensor.stated import NOTHING_STATED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.missing.loss import Loss
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.stated import StatedNoise

NEIGHBOURS = np.ones((3, 3), bool)
"""A filter removes an outlier with its neighbours."""
LEAST_COVER = 0.1
"""Least share of a window over which a mean is taken."""
FILLS_UP = 4.0
"""Light over the session's median from which a loss of at most `by_design_share` is by design: pixels of sound cameras of one exposure fill up at 4.9
to 13 times the median (12 sessions of two authors), and from 1 to 0.5 m light grows by four."""


def expected(view: ViewEvidence, limits: MissingLimits) -> Mask:
    """(H, W) pixels that should return light: on the CAD, not at grazing incidence, away from edges and from steps of a fixed pattern.

    None where no point of a registered image falls on some pixels: its holes move from capture to capture, and hide the camera's own loss. Nor
    beside missing parts and foreign objects, which were taken out, nor at the border of the camera's field: their outlines are edges too. A
    lamp beside the lens casts a shadow beside an edge: some pixels wide, or many by near surfaces. A filter in the camera mistakes steps of
    the pattern for edges.
    """
    if hides_loss([view]):
        return np.zeros_like(view.edge)
    grazing = view.rendering.incidence > np.radians(limits.lost_grazing_deg)
    edge = view.edge | not_judged(view)
    beside = binary_dilation(edge, iterations=limits.edge_reach_px) if limits.edge_reach_px else edge
    smooth = view.frame.valid & ~beside & ~grazing & ~shadowed(view.frame.depth, view.frame.camera, limits.lamp_m)
    return np.asarray(smooth if view.stepped is None else smooth & ~view.stepped)


def not_judged(view: ViewEvidence) -> Mask:
    """(H, W) pixels of missing parts and foreign objects, which were taken out of the view (`seen.world`), and outside of the camera's field."""
    return np.isin(view.view.reason, (Reason.NOT_CAD, Reason.OUT_OF_FIELD))


def brightest(views: Sequence[ViewEvidence], limits: MissingLimits) -> float:
    """Amplitude from which a lost pixel counts as saturated: nearly the largest of the session's measured pixels.

    A saturated pixel shows no more amplitude than the brightest measured ones, since its charge is cut off.
    """
    lit = [v for v in views if v.view.amplitude is not None]
    returned = joined((v.frame.amplitude[v.smooth] for v in lit), sum(v.smooth.size for v in lit))
    return limits.bright * float(np.quantile(returned, limits.saturated, overwrite_input=True)) if len(returned) else float("inf")


def lost(view: ViewEvidence, limits: MissingLimits, too_bright: float) -> Float:
    """(H, W) share of a view's captures in which an `expected` pixel has no return, and no filter removed it.

    Saturated pixels do not count: those with the code of saturation, or with an amplitude of `too_bright` and more there or all around.
    """
    seen = view.view
    by_filter = outliers_removed(seen.valid, limits)
    gone = np.where(expected(view, limits) & ~by_filter, lost_share(view), 0.0)
    return np.where(saturating(view, too_bright), 0.0, gone)


def saturating(view: ViewEvidence, too_bright: float) -> Mask:
    """(H, W) pixels with an amplitude of `too_bright` and more there or all around; none without an amplitude image."""
    amplitude = view.view.amplitude
    return (
        np.zeros(view.residual.shape, bool) if amplitude is None else np.asarray(binary_fill_holes(np.nan_to_num(amplitude) > too_bright))
    )


def lost_share(view: ViewEvidence) -> Float:
    """(H, W) share of a view's captures in which a pixel has no return."""
    seen = view.view
    return np.where(seen.valid, 1.0 - seen.returned, seen.reason == Reason.NO_RETURN)


def outliers_removed(valid: Mask, limits: MissingLimits) -> Mask:
    """(H, W) pixels that a filter in the camera removed around outliers.

    A filter removes an outlier with its neighbours, so its holes are a few pixels large. Pixels that are lost one by one are mostly single.
    """
    holes, _ = label(~valid, NEIGHBOURS)
    size = np.bincount(holes.ravel())[holes]
    small = ~valid & (size <= limits.filter_px)
    single = small & (size == 1)
    if single.sum() > limits.filter_single * small.sum():
        return np.zeros(valid.shape, bool)
    return np.asarray(small & ~single)


class Losses(NamedTuple):
    """What a session's views lose.

    inside: (H, W) per view, pixels that should return light and that no filter in the camera removed; share: (H, W) per view, of the
    captures in which a pixel is lost; too_bright: amplitude that saturates.
    """

    inside: list[Mask]
    share: list[Float]
    too_bright: float

    @property
    def gone(self) -> Float:
        """(n,) shares of the pixels inside, one view after the other."""
        return self.of(self.share)

    def of(self, images: Iterable[Float]) -> Float:
        """(n,) of the pixels inside, from an image (H, W) per view."""
        return joined((image[i] for image, i in zip(images, self.inside, strict=True)), sum(int(i.sum()) for i in self.inside))


def losses_of(views: Sequence[ViewEvidence], limits: MissingLimits, filtered: Sequence[Mask] | None = None) -> Losses:
    """The losses of views, but of the pixels `filtered`, (H, W) per view, which a filter in the camera removed."""
    too_bright = brightest(views, limits)
    inside = [expected(v, limits) for v in views]
    if filtered is not None:
        inside = [i & ~f for i, f in zip(inside, filtered, strict=True)]
    return Losses(inside, [single(lost(v, limits, too_bright)) for v in views], too_bright)


def dropout(
    views: Sequence[ViewEvidence],
    limits: MissingLimits,
    losses: Losses,
    stated: StatedNoise = NOTHING_STATED,
    law: Callable[[], PhotonLaw | None] = lambda: None,
) -> Finding | None:
    """`dropout` where more than `lost_share` of all pixels is lost, or `lost_on_part` of one part in two views and more: below a threshold of amplitude, and at random.

    A lost pixel has no reliable amplitude; that of the CAD is used, in the unit of the camera's amplitude image. The loss is expected
    where `stated` includes it, or where light is so weak by the photon law of the session, which `law` gives, that any camera drops it,
    and far weaker than usual in the session, or of few pixels; or so strong that few pixels have it, which fill up.
    """
    gone = losses.gone
    part = np.concatenate([v.rendering.part[i] for v, i in zip(views, losses.inside, strict=True)])
    of_image = amplitude_unit(views)
    unit = 1.0 if of_image is None else of_image

    def by_cad(v: ViewEvidence) -> Float:
        return unit * lambert_amplitude(v.rendering)

    if not len(gone) or (gone.mean() < limits.lost_share and not _loses_a_part(views, losses, part, by_cad, limits)):
        return None
    light, seen = losses.of(map(by_cad, views)), losses.of(map(_amplitude, views))
    loss = loss_of(gone, seen, light, losses.of(v.frame.radial for v in views), part, limits.loss)
    if loss.goes_with is GoesWith.PARTS and loss.weak and 1e3 * _noise_at(views, loss.amplitude, law()) <= limits.by_design_mm:
        loss = replace(loss, goes_with=GoesWith.LIGHT)  # A part that returns little light is lost where depth is noisy.
    others = ~np.isin(part, loss.parts)
    apart = loss.parts if loss.goes_with is GoesWith.PARTS and others.any() else ()
    others |= not apart
    edges, rates = _by_light(light[others], gone[others], limits)

    def alike(v: ViewEvidence) -> Float:
        """(H, W) share that pixels of the same light lose; on parts that are set apart, pixels of these parts."""
        by_light = rates[np.searchsorted(edges, by_cad(v), side="right")]
        return np.where(np.isin(v.rendering.part, apart), loss.share_on, by_light)

    predicted = ((v, 0.5 * (alike(v) + _around(v, own, apart, limits))) for v, own in zip(views, losses.share, strict=True))
    share = np.stack([single(np.where(v.frame.valid, rate, np.nan)) for v, rate in predicted])
    random, half = float(gone[light > np.median(light)].mean()), _lost_below(light, gone, limits.half_lost, limits)
    few_darkest = half == 0.0 and _darkest(light, gone, limits.half_lost)
    by_light = loss.goes_with is GoesWith.LIGHT or (loss.goes_with is GoesWith.NOTHING and few_darkest)
    threshold, steepness = curve(light, gone) if by_light else (half, Dropout().steepness)
    effect = Dropout(threshold, steepness, loss.share if loss.goes_with is GoesWith.STRONG_LIGHT else min(random, 1.0))
    note = _of_median(effect.threshold, light, known=of_image is not None)
    rare = half == 0.0 and random < limits.lost_share and not few_darkest
    known = loss.goes_with in (GoesWith.LIGHT, GoesWith.NOTHING) and stated.includes(effect)
    found = Finding(effect, LOSS_CONFIDENT, share=share, note=note, size=loss.size, remedy=loss.remedy, parts=loss.parts, rare=rare)
    if loss.goes_with is GoesWith.STRONG_LIGHT and loss.of_median >= FILLS_UP and loss.share <= limits.by_design_share:
        return replace(found, expected=True, by_design="pixels fill up where surfaces are near and bright")
    if loss.goes_with is not GoesWith.LIGHT:
        return replace(found, expected=known)
    # Without an amplitude image, the CAD's light is what is known.
    at = loss.amplitude if np.isfinite(loss.amplitude) else effect.threshold
    return _by_noise(replace(found, expected=known), loss, random, 1e3 * _noise_at(views, at, law()), limits)


def _loses_a_part(
    views: Sequence[ViewEvidence], losses: Losses, part: Ints, by_cad: Callable[[ViewEvidence], Float], limits: MissingLimits
) -> bool:
    """Whether `lost_on_part` of one part is lost, beside what its own light and its neighbours explain; part (n,) of the pixels inside."""
    gone = losses.gone
    if not may_lose(gone, part, limits):
        return False
    own = own_light(losses.of(map(_amplitude, views)), losses.of(map(by_cad, views)), part, limits)
    spans = losses.of(neighbours_span(v, limits) for v in views)
    view = np.repeat(np.arange(len(views), dtype=np.int16), [int(i.sum()) for i in losses.inside])
    return worst_part(gone, part, view, own, spans, losses.too_bright, limits) >= limits.lost_on_part


def _by_noise(found: Finding, loss: Loss, random: float, noise_mm: float, limits: MissingLimits) -> Finding:
    """The finding of loss in weak light: by design where noise at the threshold is large, light far weaker than usual or few pixels are lost."""
    usual_mm = limits.by_design_mm
    if noise_mm <= usual_mm:
        return replace(found, remedy=STRICT.format(noise_mm=noise_mm, usual_mm=usual_mm))
    few = loss.of_median <= limits.by_design_light or loss.share <= limits.by_design_share
    if found.expected or not (few and noise_mm > usual_mm and random < limits.lost_share):
        return found
    return replace(found, expected=True, by_design=f"a camera drops light by design whose depth is noisier than {usual_mm:g} mm")


def _noise_at(views: Sequence[ViewEvidence], threshold: float, law: PhotonLaw | None) -> float:
    """Metres of noise that a capture has at this amplitude; NaN without an amplitude or a `law`.

    A camera that averages over neighbours compares the amplitude of single pixels, before their noise is averaged.
    """
    if law is None or not threshold > 0.0:
        return float("nan")
    around2 = np.median(np.concatenate([v.frame.surroundings_m2[v.smooth] for v in views]))
    return float(np.sqrt(views[0].correlation.area * law.variance(np.array(threshold), np.asarray(around2))))


def least_light(views: Sequence[ViewEvidence], limits: MissingLimits, losses: Losses) -> float:
    """Amplitude of the CAD (albedo 1, head-on from 1 m: 1) above which pixels away from edges return; 0 where loss does not follow light."""
    gone = losses.gone
    light = losses.of(lambert_amplitude(v.rendering) for v in views)
    return _lost_below(light, gone, limits.dark_lost, limits) if len(light) else 0.0


def _amplitude(view: ViewEvidence) -> Float:
    """(H, W) of the amplitude image, NaN where the view has none."""
    return np.full(view.frame.depth.shape, np.nan) if view.view.amplitude is None else view.view.amplitude.astype(np.float64)


def _of_median(threshold: float, light: Float, *, known: bool) -> str:
    """The threshold over the session's median amplitude, in words; `known`: whether the bag has an amplitude image."""
    if threshold <= 0:
        return ""
    unit = "" if known else " (the bag has no amplitude image: amplitude is albedo cos(incidence) / r² here)"
    return f"half are lost at {threshold / float(np.median(light)):.2g} of the median amplitude{unit}"


def _by_light(light: Float, gone: Float, limits: MissingLimits) -> tuple[Float, Float]:
    """Amplitudes (b - 1,) between bins of equal numbers of pixels, and the share of loss in each bin (b,); light, gone (n,)."""
    edges = np.unique(np.quantile(light, np.linspace(0, 1, limits.lost_bins + 1)))
    which, bins = np.searchsorted(edges[1:-1], light, side="right"), max(len(edges) - 1, 1)
    return edges[1:-1], np.bincount(which, gone, bins) / np.maximum(np.bincount(which, minlength=bins), 1)


def _around(view: ViewEvidence, lost_here: Float, apart: Sequence[int], limits: MissingLimits) -> Float:
    """(H, W) share of loss around each pixel; on parts that are set `apart`, of pixels on these parts alone."""
    inside, on = expected(view, limits), np.isin(view.rendering.part, apart)
    out = np.zeros(inside.shape)
    for side in (on, ~on) if apart else (~on,):
        cover = np.maximum(uniform_filter((inside & side).astype(float), limits.near_px), LEAST_COVER)
        out[side] = (uniform_filter(np.where(side, lost_here, 0.0), limits.near_px) / cover)[side]
    return out


def _darkest(light: Float, gone: Float, share: float) -> bool:
    """Whether more than this share of as many of the darkest pixels as are lost in all is lost: a threshold may lose fewer than a bin has."""
    count = max(round(float(gone.sum())), 1)
    return float(gone[light <= np.partition(light, count - 1)[count - 1]].mean()) > share


def _lost_below(light: Float, gone: Float, share: float, limits: MissingLimits) -> float:
    """Amplitude below which more than this share of the pixels is lost; 0 where loss does not follow amplitude."""
    bins = limits.half_bins
    edges = np.quantile(light, np.linspace(0, 1, bins + 1))
    within = ((light >= low) & (light < high) for low, high in pairwise([-np.inf, *edges[1:-1], np.inf]))
    rate = np.array([gone[these].mean() if these.any() else 0.0 for these in within])
    # A camera may lose its brightest pixels, too: below a threshold, all that is darker must be lost with a bin.
    of_darker = np.cumsum(rate) / np.arange(1, bins + 1)
    dark = np.flatnonzero((rate > share) & (of_darker > share))
    return float(edges[dark.max() + 1]) if len(dark) else 0.0
