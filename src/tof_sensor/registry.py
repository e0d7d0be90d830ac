# SPDX-License-Identifier: Apache-2.0
"""All effects by name, in the order in which light and electronics meet them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.errors import ConfigError
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.noise import Noise, PhotonLaw
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.quantization import Quantization
from tof_sensor.effects.radial_depth import RadialDepth
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.specular import Specular
from tof_sensor.effects.subsurface import Subsurface
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_sensor.effect import Effect

PHYSICAL_ORDER: tuple[type[Effect], ...] = (
    CadDeviation,
    HandEye,
    TimeSync,
    Intrinsics,
    Subsurface,
    FlyingPixels,
    Multipath,
    Specular,
    LensScatter,
    Motion,
    Wiggling,
    AmplitudeBias,
    FixedPattern,
    TemperatureDrift,
    RangeOffset,
    PhotonLaw,
    Noise,
    Interference,
    PhaseWrap,
    Dropout,
    DepthScale,
    RadialDepth,
    Quantization,
)
"""Part, pose, optics, pixel, electronics, output."""

EFFECTS: dict[str, type[Effect]] = {effect.NAME: effect for effect in PHYSICAL_ORDER}

VOCABULARY: tuple[str, ...] = tuple(sorted(set(EFFECTS) - {PhotonLaw.NAME}))
"""Names that a diagnosis may give; the photon law is what every sensor has."""


def effect_class(name: str) -> type[Effect]:
    """The effect of that name, or a ConfigError that lists the names."""
    if name not in EFFECTS:
        msg = f"unknown effect '{name}'"
        raise ConfigError(msg, where="sensor", todo=f"known: {', '.join(sorted(EFFECTS))}")
    return EFFECTS[name]
