# SPDX-License-Identifier: Apache-2.0
"""Effects that noise shows: noise beyond the photon law, bursts, stripes, steps of the depth code."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import minimum_filter

from tof_core.shares import in_percent
from tof_core.stats import joined
from tof_gap.seen.evidence.correlation import INDEPENDENT
from tof_gap.seen.evidence.pattern import beside_pixels, single_pixels
from tof_gap.seen.evidence.range_code import steps_along_ray
from tof_gap.seen.evidence.residual import over_mean
from tof_gap.seen.finding import CONFIDENT, Finding, most
from tof_gap.seen.foreign.repeated import repeated
from tof_gap.seen.foreign.stripes import beat
from tof_gap.seen.noise.between_captures import stepping_captures
from tof_gap.seen.noise.bursts import bursts
from tof_gap.seen.noise.dwells import as_captures_differ, usual_ratio
from tof_gap.seen.noise.exposure import exposed
from tof_gap.seen.noise.lines import everywhere_m, line_map, line_noise, line_noise_by_view, shared_m
from tof_gap.seen.noise.photons import (
    binned,
    brightness,
    code_step,
    constant_beside_range,
    constant_map,
    constant_part,
    fit_law,
    least_mm,
    of_means,
    of_one_capture,
    over_law,
)
from tof_gap.seen.noise.pixels import INTERPOLATED, halves_agree, noisy_pixels, pixel_pattern, variance_elsewhere
from tof_gap.seen.noise.whole_average import wholly_averaged
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.pattern import PixelOffsets
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.noise.lines import LineNoise
    from tof_gap.seen.noise.photons import LawFit
    from tof_gap.seen.noise.pixels import NoisyPixels
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.session import NoiseBins

EVERYWHERE = "at every amplitude"
"""Noise that is alike in weak and in bright light."""
BY = "by columns", "by rows"
"""Lines whose pixels are along axis 0, and along axis 1."""
FIELD_TERMS = 3
"""Terms of a smooth field along one axis (constant, slope, curvature), each of which takes one line's share of the noise of lines."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A part of the noise of one capture: what it is noise of, metres RMS over the image, and its (V, H, W) metres of z where known.

    where: (H, W) pixels that have it, if not all do; there_m: metres RMS over these.
    """

    of: str
    size_m: float
    common: Float | None = None
    where: Mask | None = None
    there_m: float = 0.0

    @property
    def stated(self) -> str:
        """Size, and what it is noise of."""
        over_all = f"{1e3 * self.size_m:.1f} mm"
        return f"{over_all} {self.of}" if self.where is None else f"{1e3 * self.there_m:.1f} mm {self.of}, {over_all} RMS over all"


def noise_effects(
    views: Sequence[ViewEvidence],
    limits: NoiseLimits,
    left_out: AbstractSet[str] = frozenset(),
    law: PhotonLaw | None = None,
    *,
    patchy: bool = False,
    piled_up: bool = False,
    of_maps_m: float = 0.0,
) -> list[Finding]:
    """`quantization`, or else `interference` or `noise`, where noise shows them and they are not left out.

    law: the camera's photon law as `--sensor` states it; noise within it is no effect.
    patchy: whether a named cause makes noise leave the law in places: frequencies that fail to merge, or light on a part of the cell.
    Then noise at every amplitude, of some views or of all, is no effect of its own.
    piled_up: whether photons hide later ones, so that more light adds no counts: noise left in bright light is no effect of its own.
    of_maps_m: metres that maps of named effects may leave in single views: less is no stripe.
    """
    step = code_step(views)
    if step > limits.step_mm * 1e-3:  # Coarse steps make contours and uneven noise.
        if Quantization.NAME in left_out:
            return []
        of_one = max(step, float(np.median([v.view.written_m for v in views])))  # A mean of captures lies on parts of their steps.
        coarse = Quantization(step_m=of_one, along_ray=steps_along_ray(views, of_one))
        return [Finding(coarse, 1.0, share=constant_map(views, step / np.sqrt(12)))]
    # Structure, such as edges of texture and rounded creases, grows with distance as noise does that neighbours share. Only beside a
    # stated law is the variance itself asked for; else views and amplitudes are compared with each other, by next neighbours alone.
    near = views if law is not None else [replace(v, correlation=INDEPENDENT) for v in views]
    b = binned(near, limits.bins, limits)
    if len(b.view) < limits.least_bins:
        return []
    if step > np.sqrt(np.median(b.variance)):  # Steps wider than the noise hide it, but not that of whole lines and single pixels.
        parts = [] if Noise.NAME in left_out else [*_lines(views, _typical(b), step / np.sqrt(12), limits), *_pixels(views, limits)]
        return _named(parts, views)
    # Without amplitude there is no photon law to compare with: only noise of rows, columns and single pixels is found.
    dark = all(v.view.amplitude is None for v in views)
    other = None if Interference.NAME in left_out else _other_light(views, b, limits, of_maps_m, dark=dark)
    if other is not None:
        return [other]
    whole = wholly_averaged(b, near[0].correlation)
    b = whole if len(whole.view) >= limits.least_bins else b
    b = of_one_capture(without_offsets(b, near), np.array([v.view.captures for v in views], float), step, limits)
    b = as_captures_differ(b, usual_ratio(b, law))
    fitted = None if dark else fit_law(b, step, limits)
    bright = brightness(views)
    changes = fitted is not None and exposed(b, fitted, limits, bright)
    hit = (
        None
        if dark or patchy or {Interference.NAME, Noise.NAME} <= left_out
        else bursts(views, b, step, limits, bright if changes else None)
    )
    if hit is not None and not lines_found(views, limits):  # Noise of whole lines differs from view to view by itself.
        return [] if hit.name in left_out else [hit]
    if Noise.NAME in left_out:
        return []
    usual = law is not None and over_law(b, law) < 1.0 + limits.law_excess
    return _noise(views, near, b, None if usual or patchy or changes or piled_up else fitted, limits)


def _other_light(views: Sequence[ViewEvidence], b: NoiseBins, limits: NoiseLimits, of_maps_m: float, *, dark: bool) -> Finding | None:
    """`interference` by stripes in single views, or by captures of a dwell that step as a whole, which noise of whole lines does, too."""
    wave = beat(views, limits.beat)
    if wave is not None and wave.size_m > max(limits.extra_mm * 1e-3, of_maps_m):
        found = wave.finding(views, float(np.median(b.amplitude)), limits.beat)
        if not repeated(views, found.common, limits.repeated):
            return found
    stepping = None if dark else stepping_captures(views, limits)
    return None if stepping is None or lines_found(views, limits) else stepping


def without_offsets(b: NoiseBins, views: Sequence[ViewEvidence]) -> NoiseBins:
    """The bins without the excess variance that constant offsets of single pixels give to views of many captures.

    The variance of one capture is estimated as n times that of the mean of n captures. Averaging does not reduce the offset p of a
    pixel, so the estimate is n p^2 too large. The excess of the views with the fewest captures is left in all views alike.
    """
    captures = np.array([v.view.captures for v in views], float)
    more = (captures - captures.min())[b.view.astype(int)]
    if not more.any():
        return b
    least = views[0].limits.pattern.level_share * b.variance
    return replace(b, variance=np.maximum(b.variance - more * pixel_pattern(views) ** 2, least))


def _noise(
    views: Sequence[ViewEvidence], near: Sequence[ViewEvidence], b: NoiseBins, fitted: LawFit | None, limits: NoiseLimits
) -> list[Finding]:
    """Noise of one capture that is not in the photon law: a constant part, noise of whole rows or columns, noise of single pixels."""
    least = max(1e-3 * least_mm(near, limits), limits.extra_share * _typical(b))
    step, floor_std = code_step(views), 0.0 if fitted is None else fitted.floor_std
    constant = (0.0, 0.0) if fitted is None else (constant_part(fitted, step), constant_beside_range(b, step, limits))
    # Constant offsets of single pixels are a fixed pattern, but second differences contain them as noise (`without_offsets`).
    pattern_m = float(np.sqrt(min(v.view.captures for v in views))) * pixel_pattern(near)
    excess, certain = (float(np.sqrt(max(of**2 - pattern_m**2, 0.0))) for of in constant)
    parts = _lines(views, _typical(b), 0.0, limits)
    if min(excess, certain) > max(least, limits.extra_sigma * floor_std):
        parts.insert(0, Part(EVERYWHERE, excess))
    return _named([*parts, *_pixels(views, limits)], views, floor_std)


def _pixels(views: Sequence[ViewEvidence], limits: NoiseLimits) -> list[Part]:
    """Noise of single pixels. Constant offsets of pixels raise the estimated noise: single noisy pixels are not found beside them."""
    pixels = pixels_found(views, limits)
    over = over_mean(views)
    if pixels is None or over * pixels.size_m <= limits.pixels.own_mm * 1e-3:
        return []
    share = f"on {in_percent(pixels.share)} of the pixels"
    return [Part(share, over * pixels.rms_m, where=pixels.where, there_m=over * pixels.size_m)]


def _lines(views: Sequence[ViewEvidence], typical_m: float, least_m: float, limits: NoiseLimits) -> list[Part]:
    """Noise of whole rows and of whole columns (`_noisy_lines`)."""
    found = _noisy_lines(views, typical_m, least_m, limits)
    maps = (np.stack([line_map(v, of.axis, limits.lines) for v in views]) for of in found)
    return [Part(BY[of.axis], over_mean(views) * of.size_m, m) for of, m in zip(found, maps, strict=True)]


def _noisy_lines(views: Sequence[ViewEvidence], typical_m: float, least_m: float, limits: NoiseLimits) -> list[LineNoise]:
    """Noise of rows and of columns where that of one capture exceeds `least_m` and a share of the `typical_m` noise of pixels, both in metres."""
    least = max(limits.line_mm * 1e-3, limits.line_share * typical_m, least_m)
    found = (line_noise(views, axis, limits.lines) for axis in (1, 0))
    over, lines = over_mean(views), limits.lines
    large = (of for of in found if of.sigma > lines.sigma and over * of.size_m > least)
    return [of for of in large if any(over * of_all(views, of.axis, lines) > lines.shared * least for of_all in (shared_m, everywhere_m))]


def lines_found(views: Sequence[ViewEvidence], limits: NoiseLimits) -> list[LineNoise]:
    """Noise of whole rows and columns, each where it exceeds the rounding of the depth code and a share of the noise of pixels."""
    usual_m = median_m(views)
    return _noisy_lines(views, usual_m, code_step(views) / np.sqrt(12), limits) if usual_m > 0.0 else []


def smooth_by_lines(views: Sequence[ViewEvidence], lines: Sequence[LineNoise], limits: NoiseLimits) -> Float:
    """(V,) metres RMS along the ray: the smooth field, new in each view, that the noise of whole rows and columns makes."""
    variance = sum((line_noise_by_view(views, of.axis, limits.lines) ** 2 for of in lines), np.zeros(len(views)))
    number = min(views[0].residual.shape) / views[0].correlation.line
    return np.asarray(np.sqrt(variance * FIELD_TERMS / number))


def beside_lines(views: Sequence[ViewEvidence], lines: Sequence[LineNoise]) -> Sequence[ViewEvidence]:
    """The views with `smooth` only where the camera averages over whole neighbourhoods, if whole lines have noise.

    An average that lacks lost neighbours takes in the lines around by other shares than the average of the next pixel: so the noise of
    lines makes pixels of one line differ.
    """
    if not (lines and views[0].correlation.correlated):
        return views
    reach = views[0].correlation.window_px + 2  # A filter may lose a neighbour in one capture, and not in the mean.
    return [replace(v, smooth=v.smooth & minimum_filter(v.view.valid, reach, mode="nearest")) for v in views]


def _typical(b: NoiseBins) -> float:
    """Metres: usual noise of one capture."""
    return float(np.sqrt(np.median(b.variance)))


def median_m(views: Sequence[ViewEvidence]) -> float:
    """Metres along the ray: median noise of one capture over the smooth pixels; 0 without any."""
    sigma = joined(((v.sigma * v.frame.length)[v.smooth] for v in views), sum(v.smooth.size for v in views))
    return over_mean(views) * float(np.median(sigma, overwrite_input=True)) if len(sigma) else 0.0


def _named(parts: Sequence[Part], views: Sequence[ViewEvidence], floor_std: float = 0.0) -> list[Finding]:
    """The finding `noise` of these parts, if any; `floor_std`: standard deviation of its size in metres."""
    size = float(np.sqrt(sum(part.size_m**2 for part in parts)))
    if size <= 0:
        return []
    maps = [part.common for part in parts if part.common is not None]
    note = ", ".join(part.stated for part in parts)
    found = Finding(
        Noise(extra_m=min(size, most(Noise, "extra_m"))),
        CONFIDENT,
        {"extra_m": floor_std},
        of_means(views, size),
        common=sum(maps[1:], maps[0]) if maps else None,
        note=note,
        size=f"{note}, beside the photon noise",
        own_noise=next((part.where for part in parts if part.where is not None), None),
        everywhere=any(part.of == EVERYWHERE for part in parts),
    )
    return [found]


def pixels_found(views: Sequence[ViewEvidence], limits: NoiseLimits) -> NoisyPixels | None:
    """Pixels with a noise of their own that both halves of the views show; None where they may stand out by chance."""
    offsets = single_pixels(views)
    beside = beside_pixels(views, offsets)
    found = noisy_pixels(beside, limits.pixels)
    return found if stand_out(found, limits) and of_their_own(found, beside, offsets, limits) else None


def stand_out(pixels: NoisyPixels, limits: NoiseLimits) -> bool:
    """Whether more pixels are noisier than the views than by chance."""
    return pixels.share > limits.pixel_share and pixels.chance < limits.pixels.chance


def of_their_own(pixels: NoisyPixels, beside: Sequence[ViewEvidence], offsets: PixelOffsets, limits: NoiseLimits) -> bool:
    """Whether the noise of pixels that stand out is theirs: the same pixels are noisy in both halves of the views, beyond constant offsets.

    A camera that averages takes a neighbour with another offset in or leaves it out, from capture to capture. A driver that interpolates
    leaves more noise where a pixel lies on one of the sensor's. `beside`: the views without the offsets.
    """
    beyond = pixels.rms_m >= limits.pixels.of_offsets * offsets.size_m
    again = beyond and halves_agree(beside, limits.pixels) > limits.pixels.repeated
    return again and variance_elsewhere(beside, limits.pixels) > INTERPOLATED


def without_noisy_pixels(views: Sequence[ViewEvidence], limits: NoiseLimits) -> Sequence[ViewEvidence]:
    """The views less the pixels with a noise of their own: the photon law is fitted to the others."""
    found = pixels_found(views, limits)
    return views if found is None else [replace(v, smooth=v.smooth & ~found.where) for v in views]
