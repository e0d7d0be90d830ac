# SPDX-License-Identifier: Apache-2.0
"""Light on a pixel from the surfaces that it sees: inverse square law, Lambert, sum of phasors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_virtual.config import CameraConfig
    from tof_virtual.sight import Rays, Sight, World

SIGNAL_RANGE = 0.8
"""Range in metres at which `signal_ke` is stated, for albedo 0.5."""


@dataclass(slots=True, eq=False)
class Echo:
    """Light of N rays: modulated electrons (N,), half the path length there and back (N,), ambient electrons (N,)."""

    strength: Float
    distance: Float
    ambient: Float


@dataclass(slots=True, eq=False)
class Light:
    """Light on P pixels: phasor of the fundamental and of the odd harmonics 3 and 5 (P,) complex, ambient (P,), coarse distance."""

    first: NDArray[np.complex128]
    third: NDArray[np.complex128]
    fifth: NDArray[np.complex128]
    total: Float
    ambient: Float
    coarse: Float


def echo(rays: Rays, world: World, config: CameraConfig) -> Echo:
    """Light that a matt surface returns to an emitter beside the lens: albedo * cosine / distance^2."""
    hit = rays.face >= 0
    albedo = np.where(hit, world.soup.albedo[rays.face], 0.0)
    distance = np.where(hit, rays.distance, 1.0)
    law = albedo / 0.5 * (SIGNAL_RANGE / distance) ** 2
    return Echo(
        strength=1e3 * config.signal_ke * law * np.where(hit, rays.cosine, 0.0),
        distance=distance,
        ambient=1e3 * config.ambient_ke * albedo / 0.5,
    )


def collect(main: Echo, parts: Echo | None, sight: Sight, metres_per_radian: float, *, harmonics: bool) -> Light:
    """Sum echoes as phasors on the pixels: the main surface alone, or with `parts` every ray of an edge pixel."""
    light = _phasors(main, metres_per_radian, harmonics=harmonics)
    if parts is None or not sight.edge.size:
        return light
    bundle = _phasors(parts, metres_per_radian, harmonics=harmonics)
    weight = parts.strength.reshape(-1, sight.samples)
    distance = parts.distance.reshape(-1, sight.samples)
    light.coarse[sight.edge] = (weight * distance).sum(1) / np.maximum(weight.sum(1), 1e-9)
    for name in ("first", "third", "fifth", "total", "ambient"):
        values = getattr(bundle, name)
        if values.size:
            getattr(light, name)[sight.edge] = values.reshape(-1, sight.samples).mean(axis=1)
    return light


def _phasors(e: Echo, metres_per_radian: float, *, harmonics: bool) -> Light:
    first = np.exp(1j / metres_per_radian * e.distance)
    none = np.zeros(0, np.complex128)
    return Light(
        first=e.strength * first,
        third=e.strength * first**3 if harmonics else none,
        fifth=e.strength * first**5 if harmonics else none,
        total=e.strength.copy(),
        ambient=e.ambient.copy(),
        coarse=e.distance.copy(),
    )
