# SPDX-License-Identifier: Apache-2.0
"""What distinguishes lost pixels from measured ones: low or high amplitude, a limit of range, certain parts, or nothing."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit

from tof_core.shares import in_percent

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints
    from tof_gap.limits.missing import LossLimits


class GoesWith(Enum):
    """The one quantity that separates lost pixels from measured ones."""

    LIGHT = "light"
    STRONG_LIGHT = "strong light"
    RANGE = "range"
    PARTS = "parts"
    NOTHING = "nothing"


REMEDY = {
    GoesWith.LIGHT: (
        "nothing if these surfaces are not needed: cameras drop weak pixels by design (confidence or amplitude threshold). "
        "Otherwise expose longer or come closer; a lower threshold returns these pixels with more noise"
    ),
    GoesWith.STRONG_LIGHT: (
        "shorten the exposure or move away, where these surfaces are needed: a camera drops pixels that are near saturation, and pixels whose "
        "samples contradict each other"
    ),
    GoesWith.RANGE: (
        "the camera's measuring range ends there: choose a mode, or a gate, whose range holds these surfaces, move the camera, or leave them out"
    ),
    GoesWith.PARTS: (
        "look at the surface: black, glossy, wet or transparent ones return little light to the camera. Spray it matt, look at it from another "
        "direction, expose longer, or mask it"
    ),
}
"""What to do about lost pixels, by the quantity that separates them; without one, the remedy of `Dropout` holds."""
STRICT = (
    "lower the camera's threshold of amplitude or confidence if these surfaces are needed: depth has only {noise_mm:.2g} mm of noise there, and a "
    "usual threshold drops pixels of more than {usual_mm:g} mm. If it was lower before, something raised it"
)
"""What to do about a threshold of amplitude at which depth is still good."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Lost pixels: their share, the quantity that separates them, and indices of the scene's parts that carry most of them.

    amplitude: threshold below which pixels are lost, above which in strong light, in the unit of the amplitude image; NaN where the image
    does not show it. of_median: the same over the median amplitude, by the CAD if `amplitude` is NaN. range_m: metres beyond which (`beyond`), or up to
    which, pixels are lost. weak: whether their amplitude is lower than the scene's albedo predicts; share_on: lost share of the pixels
    of `parts`.
    """

    goes_with: GoesWith
    share: float
    parts: tuple[int, ...] = ()
    amplitude: float = float("nan")
    of_median: float = float("nan")
    range_m: float = float("nan")
    beyond: bool = True
    weak: bool = False
    share_on: float = 0.0

    @property
    def size(self) -> str:
        """Share and limit in words; empty where nothing separates lost pixels from measured ones."""
        share = f"{in_percent(self.share)} of the pixels"
        if self.goes_with is GoesWith.LIGHT:
            limit = f"{in_percent(self.of_median)} of" if self.of_median < 1.0 else f"{self.of_median:.2g} times"
            stated = f"amplitude {self.amplitude:.3g}, {limit} the median" if np.isfinite(self.amplitude) else ""
            return f"{share}, those of weak light: below {stated or f'{limit} the median light'}"
        if self.goes_with is GoesWith.STRONG_LIGHT:
            return f"{share}, those of strong light: above {self.of_median:.2g} times the median light"
        if self.goes_with is GoesWith.RANGE:
            return f"{share}, those {'farther' if self.beyond else 'nearer'} than {self.range_m:.2f} m"
        if self.goes_with is GoesWith.PARTS:
            weak = ", which return less light than their albedo in scene.yaml says" if self.weak else ""
            return f"{in_percent(self.share_on)} of the pixels of these parts, {in_percent(self.share)} of all{weak}"
        return ""

    @property
    def remedy(self) -> str:
        """What to do about it; empty where nothing separates lost pixels from measured ones."""
        return REMEDY.get(self.goes_with, "")


def loss_of(gone: Float, amplitude: Float, light: Float, radial: Float, part: Ints, limits: LossLimits) -> Loss:
    """The quantity that separates the lost pixels of a session from the measured ones.

    Args:
        gone: (n,) share of the captures in which each pixel is lost.
        amplitude: (n,) of the amplitude image; NaN or 0 where it has none.
        light: (n,) amplitude that the CAD predicts, in the same unit.
        radial: (n,) metres along the ray, from the CAD.
        part: (n,) index of the part.
        limits: how well a quantity must separate lost pixels from measured ones.
    """
    share = float(gone.mean())
    known = np.isfinite(amplitude) & (amplitude > 0)
    shown = float(gone[known].sum()) >= limits.shown * float(gone.sum())
    weak = shown and lower(amplitude[known], gone[known]) >= limits.by_amplitude
    rate = np.bincount(part, gone) / np.maximum(np.bincount(part), 1)
    carry = _carrying(gone, part, limits.carried)
    on = np.isin(part, carry)
    farther = 1.0 - lower(radial, gone)
    at = limits.by_range
    if not weak and max(farther, 1.0 - farther) >= at:
        beyond = farther >= at
        return Loss(GoesWith.RANGE, share, carry, range_m=float(np.quantile(radial, 1.0 - share if beyond else share)), beyond=beyond)
    darker, by_part = lower(light, gone), 1.0 - lower(rate[part], gone) >= limits.by_part
    by_light = darker >= limits.by_light
    if not weak and 1.0 - darker >= limits.by_light:
        limit = float(np.quantile(light, 1.0 - share))
        return Loss(GoesWith.STRONG_LIGHT, share, carry, of_median=limit / max(float(np.median(light)), 1e-12))
    if not (by_light or weak or by_part):
        return Loss(GoesWith.NOTHING, share, carry)
    seen, lost = (amplitude[known], gone[known]) if weak else (light, gone)
    limit = balanced(seen, lost)
    measured, of_median = limit if weak else float("nan"), limit / max(float(np.median(seen)), 1e-12)
    goes_with = GoesWith.PARTS if by_part and not by_light else GoesWith.LIGHT
    return Loss(goes_with, share, carry, measured, of_median, weak=weak, share_on=float(gone[on].mean()))


def lower(values: Float, gone: Float) -> float:
    """Chance that a lost pixel has a lower value than a measured one: the area under the ROC curve; equal values count half.

    values (n,); gone (n,): share of captures in which each pixel is lost.
    """
    _, place = np.unique(values, return_inverse=True)
    lost, kept = np.bincount(place, gone), np.bincount(place, 1.0 - gone)
    above = kept.sum() - np.cumsum(kept)
    return float(lost @ (above + 0.5 * kept)) / max(float(lost.sum() * kept.sum()), 1e-12)


def balanced(values: Float, gone: Float) -> float:
    """The value below which there are as many pixels as lost ones."""
    return float(np.quantile(values, float(gone.mean())))


def curve(light: Float, gone: Float) -> tuple[float, float]:
    """Threshold and steepness of `Dropout`'s curve: the likeliest of the curves that lose as many pixels as were lost.

    light (n,): amplitude that the CAD predicts; gone (n,): share of captures in which each pixel is lost.
    """
    lit = light > 0
    edges = np.linspace(float(np.log(light[lit].min())), float(np.log(light[lit].max())), BINS + 1)
    which = np.clip(np.searchsorted(edges, np.log(light[lit])) - 1, 0, BINS - 1)
    pixels, lost = np.bincount(which, minlength=BINS), np.bincount(which, gone[lit], BINS)
    middle = 0.5 * (edges[1:] + edges[:-1])

    def of(steepness: float) -> tuple[float, float]:
        """Log of the threshold at this steepness, and log-likelihood."""
        low, high = middle[0] - 1.0, middle[-1] + 1.0
        for _ in range(HALVINGS):
            at = 0.5 * (low + high)
            low, high = (at, high) if pixels @ expit(steepness * (at - middle)) < lost.sum() else (low, at)
        at = 0.5 * (low + high)
        p = np.clip(expit(steepness * (at - middle)), 1e-9, 1 - 1e-9)
        return float(at), float(lost @ np.log(p) + (pixels - lost) @ np.log(1 - p))

    tried = {steepness: of(steepness) for steepness in STEEPNESSES}
    best = max(tried, key=lambda k: tried[k][1])
    return float(np.exp(tried[best][0])), best


BINS, HALVINGS = 2000, 40
"""Bins of log amplitude (1 % each over nine decades), and steps of bisection for the threshold."""
STEEPNESSES = (3.0, 4.0, 6.0, 9.0, 13.0, 20.0, 30.0, 50.0)
"""Steepness of the curves that are tried, up to the effect's bound, a sharp threshold."""


def _carrying(gone: Float, part: Ints, carried: float) -> tuple[int, ...]:
    """The parts that together carry the share `carried` of all loss, most first."""
    lost = np.bincount(part, gone)
    order = np.argsort(-lost, kind="stable")
    count = int(np.searchsorted(np.cumsum(lost[order]), carried * lost.sum())) + 1
    return tuple(int(p) for p in order[:count])
