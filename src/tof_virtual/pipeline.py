# SPDX-License-Identifier: Apache-2.0
"""One exposure from the scene to the stored depth: light, charge, four taps, phase, depth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_virtual import optics, taps
from tof_virtual.effect import Frame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_virtual.effect import Effect, Moment
    from tof_virtual.optics import Light
    from tof_virtual.sight import Sight


def expose(moment: Moment, effects: Sequence[Effect], rng: np.random.Generator | None = None) -> Frame:
    """Take one frame; without `rng` all random terms of mean zero are omitted."""
    config = moment.config.camera
    charge = _charge(moment, effects)
    for e in effects:
        e.expose(charge, moment)
    distance, amplitude, saturated = taps.measure(charge, config, rng)
    for e in effects:
        distance = e.disturb(distance, amplitude, moment)
        if rng is not None:
            distance = e.add_noise(distance, amplitude, moment)
    valid = (amplitude >= config.min_amplitude_e) & ~saturated & (distance > 0) & (charge.steady[0] > 0)
    frame = Frame(np.where(valid, distance / moment.sight.length, np.nan), amplitude, saturated)
    for e in effects:
        lost = e.lose(frame, moment)
        if lost is not None:
            frame.depth = np.where(lost, np.nan, frame.depth)
    for e in effects:
        frame.depth = e.finish(frame.depth, moment)
    return frame


def _charge(moment: Moment, effects: Sequence[Effect]) -> taps.Charge:
    """Charge of the four taps: of the same scene, or of four where the camera moved between them."""
    config = moment.config.camera
    third, fifth = (sum((e.harmonics()[i] for e in effects), start=0j) for i in (0, 1))
    harmonics = third != 0 or fifth != 0
    key = tuple((e, e.size) for e in effects)
    if key not in moment.lights:
        moment.lights[key] = [_light(moment, sight, effects, harmonics=harmonics) for sight in moment.sights]
    lights = moment.lights[key]
    middle = lights[-1]

    def four(name: str, factor: complex) -> Any:
        rows = [factor * getattr(light, name) for light in lights[:4]]
        return np.broadcast_to(rows[0], (4, rows[0].size)) if len(rows) == 1 else np.stack(rows)

    return taps.Charge(
        phasor=four("first", config.contrast),
        third=four("third", config.contrast * third) if harmonics else None,
        fifth=four("fifth", config.contrast * fifth) if harmonics else None,
        steady=four("total", 1.0) + four("ambient", 1.0),
        coarse=middle.coarse,
        lag=np.zeros(middle.total.size),
    )


def _light(moment: Moment, sight: Sight, effects: Sequence[Effect], *, harmonics: bool) -> Light:
    config, world = moment.config.camera, moment.world
    main = optics.echo(sight.main, world, config)
    mixed = any(e.footprint() > 0 for e in effects)
    parts = optics.echo(sight.parts, world, config) if mixed else None
    for e in effects:
        e.reflect(main, sight.main, moment)
        if parts is not None:
            e.reflect(parts, sight.parts, moment)
    light = optics.collect(main, parts, sight, taps.metres_per_radian(config.modulation_mhz), harmonics=harmonics)
    for e in effects:
        e.spread(light, sight, moment)
    return light
