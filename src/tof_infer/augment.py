# SPDX-License-Identifier: Apache-2.0
"""Data augmentation: frames of a labelled view simulated from its label by a fitted sensor model (`sensor.yaml`), with new noise each time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.frame import Context, Frame

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image
    from tof_core.camera import Camera
    from tof_infer.samples import Sample
    from tof_sensor.model import SensorModel


@dataclass(frozen=True, slots=True, eq=False)
class Labelled:
    """The fields of a rendering (`tof_scene.render.Rendering`) that effects read and a label contains."""

    camera: Camera
    T_cell_camera: Float
    depth: Image
    part: Any
    face: Any
    normal: Image
    incidence: Image
    albedo: Image
    mixed: Image
    second: Image


@dataclass(frozen=True, slots=True)
class Redraw:
    """Simulated samples: measured amplitude, and the label's depth with the model's bias and noise.

    Effects that need the CAD for ray casting (multipath) or a second surface (flying pixels) are not simulated; the recorded
    frames contain them.
    """

    model: SensorModel
    camera: Camera

    def __call__(self, sample: Sample, rng: np.random.Generator) -> Sample:
        """The sample as the modelled sensor measures it."""
        seen = np.isfinite(sample.label) & np.isfinite(sample.depth)
        depth = np.where(seen, sample.label, np.nan)
        lit = np.isfinite(sample.amplitude) & (sample.amplitude > 0)
        usual = np.median(sample.amplitude[lit]) if lit.any() else self._reference
        amplitude = np.where(lit, sample.amplitude, usual).astype(np.float64)
        zero = np.zeros(depth.shape)
        frame = Frame(
            cast("Any", self._labelled(sample, depth)),
            self.camera.rays(),
            depth.astype(np.float64),
            amplitude,
            zero,
            zero,
            Context(temperature=sample.temperature),
        )
        drawn = self.model.apply(frame, rng)
        lost = rng.uniform(size=depth.shape) < drawn.missing
        # pixels at edges keep the measured depth: a label alone does not determine a mixed pixel
        kept = ~(_smooth(sample.label) & sample.mask)
        return replace(sample, depth=np.where(kept, sample.depth, np.where(lost, np.nan, drawn.depth)).astype(np.float32))

    @property
    def _reference(self) -> float:
        """The reference amplitude of the photon law, used for samples without amplitude."""
        return next((e.reference for e in self.model.effects if isinstance(e, PhotonLaw)), 1.0)

    def _labelled(self, sample: Sample, depth: Float) -> Labelled:
        none = np.full(depth.shape, np.nan, np.float32)
        number = np.full(depth.shape, -1, np.int32)
        return Labelled(
            self.camera,
            np.eye(4),
            depth.astype(np.float32),
            number,
            number,
            _normals(self.camera, depth),
            sample.incidence,
            sample.material,
            np.zeros(depth.shape, np.float32),
            none,
        )


def _normals(camera: Camera, depth: Float) -> Image:
    """Unit normals (H, W, 3) toward the camera, from neighbouring points."""
    points = camera.rays() * np.nan_to_num(depth)[..., None]
    normal = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True) + 1e-12
    away = np.einsum("...i,...i->...", normal, points) > 0
    return np.where(away[..., None], -normal, normal).astype(np.float32)


def _smooth(depth: Image) -> Any:
    """Pixels on a continuous surface: depth changes by less than 2 % to all four neighbours."""
    smooth = np.isfinite(depth)
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis, append=np.take(depth, [-1], axis=axis)))
        fine = step < 0.02 * np.abs(depth)
        smooth &= fine & np.roll(fine, 1, axis=axis)
    return smooth
