# SPDX-License-Identifier: Apache-2.0
"""A constant in a curve of the amplitude: what no law of the light has left of its error where that is least is an effect of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.range_offset import RangeOffset

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solved import Named

FLATTEST, USUAL = 0.5, 1.0
"""Power of the light with which a bias by the amplitude changes at least, and usually: the error of charge that arrives late is inverse to the
light. Over light of one to r, a bias that changes by v has v / (r^power - 1) left where it is least. In 24 sessions whose sensor has charge
traps and no constant, 0.03 to 1.6 times that of the flattest law was left, at most 0.4 mm more than it; with a late pulse besides, 5.4 times,
3.2 mm more."""
TRIM = 0.02
"""Share of the pixels that is left out at either end of light and bias: a few pixels of dark edges would tell of a wider range of light."""


def offset_apart(found: Sequence[Named], views: Sequence[ViewEvidence], least_m: float, *, asked: bool = True) -> tuple[Named, ...]:
    """The named effects with `range_offset` apart from `amplitude_bias`, where that is more than `least_m` metres too large at all amplitudes.

    The selection has no use for a constant beside a bias by the amplitude, whose formulas and curves contain one. It is named if `asked` for.
    A bias with zeros among the amplitudes of the session has none: cameras are calibrated at an amplitude of usual surfaces.
    """
    at = next((k for k, one in enumerate(found) if one.name == AmplitudeBias.NAME), None)
    if at is None or not asked or any(one.name == RangeOffset.NAME for one in found):
        return tuple(found)
    (effect, *others), (std, *_) = found[at].effects, found[at].std
    if others or not isinstance(effect, AmplitudeBias):
        return tuple(found)
    least, change, ratio = _extremes(effect, views)
    flattest, usual = (change / max(ratio**power - 1.0, 1e-12) for power in (FLATTEST, USUAL))
    if abs(least) - flattest < least_m:
        return tuple(found)
    offset = RangeOffset(offset_m=float(np.sign(least) * (abs(least) - usual)))
    sd_m = float(np.hypot(_constant_sd(std), 0.5 * (flattest - usual)))
    both = found[at].divided(_lowered(effect, offset.offset_m), offset, {"offset_m": sd_m})
    return tuple(sorted((*found[:at], *both, *found[at + 1 :]), key=lambda one: one.name))


def _extremes(effect: AmplitudeBias, views: Sequence[ViewEvidence]) -> tuple[float, float, float]:
    """Bias in metres along the ray where it is least, 0 if it changes sign; by how much it changes; and the ratio of the light."""
    bias, light = [np.zeros(0)], [np.zeros(0)]
    for v in views:
        seen = v.smooth & v.frame.valid & (v.frame.amplitude > 0)
        bias.append((effect.bias(v.frame) * v.frame.length)[seen])
        light.append(np.log(v.frame.amplitude[seen]))
    if not sum(map(len, bias)):
        return 0.0, 0.0, 1.0
    (low, high), (dark, bright) = (np.quantile(np.concatenate(of), [TRIM, 1.0 - TRIM]) for of in (bias, light))
    least = 0.0 if low * high <= 0.0 else float(min(low, high, key=abs))
    return least, float(high - low), float(np.exp(bright - dark))


def _constant_sd(std: dict[str, float]) -> float:
    """Standard deviation in metres of the constant: the formula's, or that of a curve's usual knot."""
    return std.get("at_reference_m", float(np.sqrt(np.mean(np.square([*std.values()])))))


def _lowered(effect: AmplitudeBias, constant_m: float) -> AmplitudeBias:
    """The same effect less a constant."""
    if effect.free_form:
        return replace(effect, values=tuple(float(v - constant_m) for v in effect.values))
    return replace(effect, at_reference_m=float(effect.at_reference_m - constant_m))
