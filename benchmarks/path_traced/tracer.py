# SPDX-License-Identifier: Apache-2.0
"""Range errors by light of many bounces, traced by mitransient (Mitsuba 3): surfaces are Lambertian, the lamp stands at the camera."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_scene.scene import Scene

BOUNCES = 8
"""Longest path: surfaces on the way from lamp to camera."""
BIN_M = 0.004
"""Bins of the path length: 1/900 of a wave of 80 MHz."""
LONGEST_M = 9.0
"""Longest path that is kept, twice the range of what is seen and some bounces."""
BEAM = 1.15
"""Half angle of the lamp's cone over that of the image's diagonal."""
SAMPLES = 1024
"""Paths per pixel and pass."""


@dataclass(frozen=True, slots=True, eq=False)
class Traced:
    """Phasors (H, W) of a continuous wave, averaged over the area of each pixel: of direct light alone, and of all light."""

    direct: NDArray[np.complex128]
    everything: NDArray[np.complex128]
    mhz: float

    @property
    def range_error(self) -> Float:
        """(H, W) metres along the ray by which light of several bounces lengthens what is measured: mixed pixels cancel."""
        with np.errstate(invalid="ignore"):
            error = np.angle(self.everything * np.conj(self.direct)) * LIGHT_M_PER_S / (4e6 * np.pi * self.mhz)
        return np.asarray(np.where(np.abs(self.direct) > 0, error, np.nan))


def traced(scene: Scene, albedo: Mapping[str, float], camera: Camera, T_cell_camera: Float, mhz: float, seed: int) -> Traced:
    """The light of a scene as a continuous wave of `mhz` measures it.

    Args:
        scene: the parts, in the cell frame.
        albedo: diffuse albedo of each part by name.
        camera: without distortion; square pixels, principal point in the middle.
        T_cell_camera: (4, 4), of the camera and its lamp.
        mhz: modulation frequency.
        seed: of the paths.
    """
    mi = _mitsuba()
    world = _world(mi, scene, albedo, camera, T_cell_camera)
    direct, everything = (_phasor(mi, world | {"integrator": _integrator(depth)}, mhz, seed) for depth in (2, BOUNCES + 1))
    return Traced(direct, everything, mhz)


def _mitsuba() -> Any:
    import mitsuba as mi

    mi.set_variant("llvm_ad_mono")
    import mitransient  # noqa: F401  (registers its integrator and film)

    return mi


def _integrator(depth: int) -> dict[str, Any]:
    return {"type": "transient_path", "max_depth": depth, "rr_depth": 100, "camera_unwarp": False, "temporal_filter": "box"}


def _world(mi: Any, scene: Scene, albedo: Mapping[str, float], camera: Camera, T_cell_camera: Float) -> dict[str, Any]:
    """Meshes, lamp and camera as Mitsuba names them: its camera looks along +z with x to the left."""
    to_world = mi.ScalarTransform4f(T_cell_camera @ np.diag([-1.0, -1.0, 1.0, 1.0]))
    corner = np.hypot(0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy)
    cone = float(np.degrees(np.arctan(corner)) * BEAM)
    film = {
        "type": "transient_hdr_film",
        "width": camera.width,
        "height": camera.height,
        "temporal_bins": int(LONGEST_M / BIN_M),
        "bin_width_opl": BIN_M,
        "start_opl": 0.0,
        "rfilter": {"type": "box"},
    }
    sensor = {
        "type": "perspective",
        "fov": float(2.0 * np.degrees(np.arctan(0.5 * camera.width / camera.fx))),
        "fov_axis": "x",
        "near_clip": 0.01,
        "to_world": to_world,
        "sampler": {"type": "independent", "sample_count": SAMPLES},
        "film": film,
    }
    lamp = {"type": "spot", "to_world": to_world, "cutoff_angle": cone, "beam_width": cone, "intensity": 1.0}
    return {"type": "scene", "sensor": sensor, "lamp": lamp} | {
        f"part_{i}": _mesh(mi, part.name, part.vertices, part.faces, albedo[part.name]) for i, part in enumerate(scene.parts)
    }


def _mesh(mi: Any, name: str, vertices: Float, faces: Any, albedo: float) -> Any:
    """A mesh with flat faces, Lambertian on both sides."""
    bsdf = mi.load_dict({"type": "twosided", "nested": {"type": "diffuse", "reflectance": {"type": "spectrum", "value": albedo}}})
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    properties["face_normals"] = True
    mesh = mi.Mesh(name, len(vertices), len(faces), has_vertex_normals=False, has_vertex_texcoords=False, props=properties)
    values = mi.traverse(mesh)
    values["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
    values["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
    values.update()
    return mesh


def _phasor(mi: Any, world: dict[str, Any], mhz: float, seed: int) -> Any:
    """(H, W) complex sum of the light over path lengths."""
    _, transient = mi.render(mi.load_dict(world), seed=seed, spp=SAMPLES)
    light = np.array(transient)[..., 0]
    length = (np.arange(light.shape[2]) + 0.5) * BIN_M
    return light @ np.exp(2e6j * np.pi * mhz / LIGHT_M_PER_S * length)


def runs() -> str:
    """Why Mitsuba renders nothing here, "" where it does: tried in a process of its own, since an LLVM library that is too old ends it."""
    tried = subprocess.run([sys.executable, "-m", "benchmarks.path_traced.tracer"], capture_output=True, text=True, check=False)
    return "" if tried.returncode == 0 else (tried.stderr.strip().splitlines() or ["it ended without a word"])[-1][:200]


def _probe() -> None:
    """Render one plate."""
    from tof_core.camera import Camera
    from tof_scene.builtin.shapes import box
    from tof_scene.scene import Part, Scene

    plate = Scene("cell", (Part("plate", *box((1.0, 1.0, 0.01), (0.0, 0.0, 1.0))),))
    traced(plate, {"plate": 0.5}, Camera(4, 4, 8.0, 8.0, 1.5, 1.5), np.eye(4), 80.0, 0)


if __name__ == "__main__":
    _probe()
