# SPDX-License-Identifier: Apache-2.0
"""A sensor model: a list of effects in physical order, stored as `sensor.yaml`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from tof_core.config import LARGEST, from_mapping, to_mapping
from tof_core.errors import ConfigError
from tof_core.yamlio import load_yaml
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.frame import Context, ideal_frame
from tof_sensor.origin import camera_from, promise_from, to_blocks
from tof_sensor.registry import PHYSICAL_ORDER, effect_class
from tof_sensor.stated import StatedNoise

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_scene.render import Rendering
    from tof_sensor.effect import Effect
    from tof_sensor.frame import Frame
    from tof_sensor.origin import Promise

SCHEMA = "toftwin.sensor/1"
FREQUENCY = "# modulation_mhz: the frequency at which the effect's formula fits best; a pulsed camera has none (docs/effects.md)\n"
"""First line of a `sensor.yaml` with an effect that has a frequency: the frequency is fitted, no property of the camera."""


@dataclass(frozen=True, slots=True)
class SensorModel:
    """Effects, sorted into physical order. Several of one kind are allowed (one per part).

    gain: amplitude of albedo 1 seen head-on from 1 m, in the camera's unit, None without amplitude; camera: the camera that the model was
    fitted to, None for any; promise: shrink of the gap stated by the fit, None without a fit; scene: digest of the scene that it was
    fitted in, empty for any.
    """

    effects: tuple[Effect, ...] = ()
    gain: float | None = None
    camera: Camera | None = None
    promise: Promise | None = None
    scene: str = ""

    def __post_init__(self) -> None:
        """Sort the effects."""
        rank = {kind: i for i, kind in enumerate(PHYSICAL_ORDER)}
        object.__setattr__(self, "effects", tuple(sorted(self.effects, key=lambda e: rank[type(e)])))

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Apply all effects to one view."""
        for effect in self.effects:
            frame = effect.apply(frame, rng)
        return replace(frame, depth=np.where(frame.depth > 0, frame.depth, np.nan))

    def bias(self, frame: Frame) -> Float:
        """(H, W) sum of the biases in metres of z, to first order."""
        return np.asarray(sum((e.bias(frame) for e in self.effects), np.zeros(frame.depth.shape)))

    def holding_in(self, scene: str) -> SensorModel:
        """The model in the scene of this digest: without effects of parts and their light, if it was fitted in another scene."""
        if not self.scene or self.scene == scene:
            return self
        return replace(self, effects=tuple(e for e in self.effects if not e.needs_scene))

    def without(self, name: str) -> SensorModel:
        """The model without the effects of that name."""
        return replace(self, effects=tuple(e for e in self.effects if name != e.NAME))

    @property
    def law(self) -> PhotonLaw | None:
        """The photon law with the noise that the other effects add to every capture; None without a law."""
        laws = [e for e in self.effects if isinstance(e, PhotonLaw)]
        return reduce(lambda law, effect: effect.added_to(law), self.effects, laws[0]) if laws else None

    @property
    def stated(self) -> StatedNoise:
        """The noise and the loss of pixels with which those of another session are compared."""
        return StatedNoise(self.law, self.effects)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its effects, sorted, once each."""
        return tuple(sorted({e.NAME for e in self.effects}))


def simulate(
    rendering: Rendering,
    model: SensorModel,
    rng: np.random.Generator,
    *,
    context: Context | None = None,
    amplitude: Float | None = None,
) -> Frame:
    """One capture of a rendered view by the modelled sensor."""
    return model.apply(ideal_frame(rendering, context, amplitude), rng)


def save_model(model: SensorModel, path: Path) -> None:
    """Write `sensor.yaml`: schema; unit of amplitude, camera and promise if known; then one block per effect."""
    blocks = [block_of(e) for e in model.effects]
    gain = {} if model.gain is None else {"gain": float(model.gain)}
    origin = to_blocks(model.camera, model.promise) | ({"scene": model.scene} if model.scene else {})
    head = FREQUENCY if any("modulation_mhz" in b for b in blocks) else ""
    body = {"schema": SCHEMA, **gain, **origin, "effects": blocks}
    path.write_text(head + yaml.safe_dump(body, sort_keys=False, default_flow_style=None))


def load_model(path: Path) -> SensorModel:
    """Read `sensor.yaml`; unknown effects, keys and values out of bounds are refused."""
    data = load_yaml(path)
    if data.get("schema") != SCHEMA:
        msg = f"is no sensor model (schema must be {SCHEMA})"
        raise ConfigError(msg, where=path)
    blocks = data.get("effects")
    if set(data) - {"gain", "camera", "promise", "scene"} != {"schema", "effects"} or not isinstance(blocks, list):
        msg = "must hold the keys schema and effects, and may hold gain, camera, promise and scene, nothing else"
        raise ConfigError(msg, where=path)
    effects = tuple(effect_of(b, f"{path}: effects[{i}]") for i, b in enumerate(blocks))
    gain, scene = _gain(data.get("gain"), path), data.get("scene", "")
    if not isinstance(scene, str):
        msg = "scene must be the digest of a scene"
        raise ConfigError(msg, where=path)
    return SensorModel(effects, gain, camera_from(data.get("camera"), path), promise_from(data.get("promise"), path), scene)


def _gain(value: Any, path: Path) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < LARGEST:
        msg = "gain must be a number above 0"
        raise ConfigError(msg, where=path)
    return float(value)


def block_of(effect: Effect) -> dict[str, Any]:
    """Name and parameters of an effect as plain values, for YAML and JSON."""
    return {"effect": effect.NAME} | _plain(to_mapping(effect))


def effect_of(block: Any, where: str) -> Effect:
    """The inverse of `block_of`; a block that is none, and values out of bounds, are refused."""
    if not isinstance(block, dict) or not isinstance(block.get("effect"), str):
        msg = "must name its effect"
        raise ConfigError(msg, where=where)
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in block.items() if k != "effect"}
    for key, value in values.items():
        if isinstance(value, tuple) and not all(isinstance(x, int | float) and -LARGEST < x < LARGEST for x in value):
            msg = f"{key} must be a list of numbers"
            raise ConfigError(msg, where=where)
    return from_mapping(effect_class(block["effect"]), values, where=where)


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Plain values for YAML: no tuples, no NumPy scalars."""
    return {k: [float(x) for x in v] if isinstance(v, tuple) else v.item() if isinstance(v, np.generic) else v for k, v in values.items()}
