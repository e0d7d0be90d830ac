# SPDX-License-Identifier: Apache-2.0
"""The effects of the vocabulary, as physics of the virtual camera and robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.errors import UsageError
from tof_virtual.effects.geometry import CadDeviation, HandEye, Intrinsics, Motion, TimeSync
from tof_virtual.effects.light import Ambient, EmitterOffset, FlyingPixels, LensScatter, Specular, Subsurface
from tof_virtual.effects.multipath import Multipath
from tof_virtual.effects.output import DepthScale, Dropout, Noise, PhaseWrap, Quantization, RadialDepth, RangeOffset
from tof_virtual.effects.pixel import AmplitudeBias, FixedPattern, Interference, TemperatureDrift, Wiggling

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_virtual.config import VirtualConfig
    from tof_virtual.effect import Effect

EFFECTS: dict[str, type[Effect]] = {
    e.name: e
    for e in (
        CadDeviation,
        Intrinsics,
        HandEye,
        TimeSync,
        Motion,
        EmitterOffset,
        Specular,
        Subsurface,
        FlyingPixels,
        Multipath,
        LensScatter,
        Wiggling,
        FixedPattern,
        TemperatureDrift,
        AmplitudeBias,
        Interference,
        Ambient,
        RangeOffset,
        PhaseWrap,
        Noise,
        Dropout,
        RadialDepth,
        DepthScale,
        Quantization,
    )
}
"""By name, in the order in which they act."""


def adapt(config: VirtualConfig, strengths: Mapping[str, float]) -> VirtualConfig:
    """The configuration that these effects need to be visible (a moving hand, a warm-up)."""
    for name, effect in EFFECTS.items():
        if strengths.get(name, 0) > 0:
            config = effect.adapt(config)
    return config


def make_effects(strengths: Mapping[str, float], config: VirtualConfig) -> tuple[Effect, ...]:
    """Effects of these strengths (zero is off), in the order in which they act."""
    unknown = sorted(set(strengths) - set(EFFECTS))
    if unknown:
        msg = f"effect '{unknown[0]}' is not known"
        raise UsageError(msg, where="--effect", todo=f"use one of {', '.join(EFFECTS)}")
    wrong = [f"{n}={s:g}" for n, s in strengths.items() if not 0 <= s <= 100]
    if wrong:
        msg = f"strength {wrong[0]} is out of bounds"
        raise UsageError(msg, where="--effect", todo="0 is off, 1 usual, 0.33 small, 3.3 large")
    return tuple(EFFECTS[n](strengths[n], config) for n in EFFECTS if strengths.get(n, 0) > 0)
