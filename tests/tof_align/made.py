# SPDX-License-Identifier: Apache-2.0
"""Small sessions with everything true about them: boxes and a cylinder, and a thin panel alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tof_align.config import AlignConfig, WeightConfig
from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import RobotPose, View
from tof_scene.raycast import Raycaster
from tof_scene.scene import Part, Scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float

CAMERA = Camera(112, 86, 105.0, 105.0, 55.2, 42.9, frame_id="camera")
CONFIG = AlignConfig(weights=WeightConfig(pixels=2500, coarse_pixels=600, live_pixels=2000))
ROBOT = np.repeat([0.05, np.radians(2.0)], 3)
"""Standard deviations (6,) of the robot's own pose where a test gives one by hand."""


def box(name: str, size: tuple[float, float, float], T: Float) -> Part:
    """A box of `size` metres about the origin of T."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
    return Part(name, se3.apply(T, corners), np.array(faces, np.int32))


def at(x: float, y: float, z: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Float:
    """T_cell_part from a place and a rotation vector."""
    return se3.from_quat([x, y, z], se3.quat_from_matrix(se3.so3_exp(turn)))


def scene_of(*parts: Part) -> Scene:
    """A scene made in memory."""
    return Scene("cell", parts, None, Path())


@lru_cache(maxsize=1)
def section() -> Raycaster:
    """A wall with flanges, brackets and blocks: every direction is determined."""
    return Raycaster(scene_of(
        box("wall", (0.03, 1.0, 0.5), at(0, 0, 0.8)),
        box("sill", (0.14, 1.0, 0.03), at(0.07, 0, 0.56)),
        box("roof", (0.10, 1.0, 0.03), at(0.05, 0, 1.04)),
        box("bracket", (0.08, 0.15, 0.2), at(0.05, -0.2, 0.8, (0, 0, 0.3))),
        box("block", (0.06, 0.2, 0.08), at(0.03, 0.25, 0.85, (0.3, 0.2, 0))),
    ))  # fmt: skip


@lru_cache(maxsize=1)
def panel() -> Raycaster:
    """A thin flat panel alone, larger than the view: slides in y and z and turns about x are open."""
    return Raycaster(scene_of(box("panel", (0.002, 2.4, 2.0), at(0, 0, 0.8))))


@lru_cache(maxsize=1)
def foreign() -> Raycaster:
    """Another scene than any recorded here: a heap of tilted boxes where the section would be."""
    rng = np.random.default_rng(5)
    middle = se3.from_quat([0.1, 0.0, 0.8], [0, 0, 0, 1])
    heap = [middle @ se3.exp(np.concatenate([rng.uniform(-0.25, 0.25, 3), rng.normal(size=3)])) for _ in range(14)]
    return Raycaster(scene_of(*(box(f"box{i}", (0.12, 0.14, 0.1), T) for i, T in enumerate(heap))))


def look(eye: Float, target: Float, roll: float = 0.0) -> Float:
    """T_cell_camera of a camera at `eye` whose optical axis meets `target`, cell z up in the image."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1) @ se3.so3_exp([0, 0, roll]), eye
    return T


@dataclass(frozen=True)
class Truth:
    """Where the camera really was, and what it would have measured without noise or bias (H, W)."""

    T_cell_camera: Float
    depth: Float


@dataclass(frozen=True)
class Seen:
    """What an unmodelled effect may depend on: depth, radial range, amplitude (H, W), the view's number."""

    depth: Float
    range_m: Float
    amplitude: Float
    view: int


def true_depth(caster: Raycaster, T: Float, camera: Camera = CAMERA) -> tuple[Float, Float]:
    """z (H, W) and cosine of incidence (H, W) seen from T."""
    rays = camera.rays().reshape(-1, 3) @ T[:3, :3].T
    hits = caster.cast(T[:3, 3], rays)
    cosine = np.abs(np.einsum("ij,ij->i", hits.normal, rays)) / np.linalg.norm(rays, axis=1)
    return hits.t.reshape(camera.shape), cosine.reshape(camera.shape)


def measured(
    caster: Raycaster,
    T: Float,
    robot: RobotPose,
    *,
    number: int = 0,
    station: int = 0,
    noise_mm: float = 1.0,
    captures: int = 10,
    effect: Callable[[Seen], Float] | None = None,
    seed: int = 0,
    camera: Camera = CAMERA,
) -> tuple[View, Truth]:
    """A view from T whose robot believes `robot`: noise falls with amplitude, sigma is estimated from as many captures."""
    rng = np.random.default_rng([seed, number])
    z, cosine = true_depth(caster, T, camera)
    reach = z * camera.ray_length()
    spot = np.where(np.indices(z.shape).sum(0) // 9 % 2, 0.2, 0.7)
    amplitude = 1000.0 * spot * cosine / reach**2
    bias = 0.0 if effect is None else effect(Seen(z, reach, amplitude, number))
    one = noise_mm * 1e-3 * np.sqrt(400.0 / np.maximum(amplitude, 1.0))
    depth = z + bias + rng.normal(size=z.shape) * one / np.sqrt(captures)
    told = one * np.sqrt(rng.chisquare(captures - 1, z.shape) / (captures - 1) / captures) if captures > 1 else np.full(z.shape, np.nan)
    view = View(
        stamp_ns=number * 10**9, dwell_ns=number * 10**9, camera=camera, depth=depth.astype(np.float32), sigma=told.astype(np.float32),
        count=np.where(np.isfinite(z), captures, 0).astype(np.uint16), reason=np.isnan(z).astype(np.uint8), robot=robot, station=station,
        captures=captures, amplitude=np.nan_to_num(amplitude).astype(np.float32),
    )  # fmt: skip
    return view, Truth(T, z)


def session(
    caster: Raycaster,
    *,
    views: int = 8,
    stations: int = 2,
    seed: int = 0,
    base: tuple[float, float] = (30.0, 1.0),
    arm: tuple[float, float] = (0.6, 0.06),
    X: Float | None = None,
    effect: Callable[[Seen], Float] | None = None,
    noise_mm: float = 1.0,
    camera: Camera = CAMERA,
) -> tuple[list[View], list[Truth]]:
    """A robot that stands off by `base` (mm, degrees per axis) and whose arm errs by `arm`."""
    rng = np.random.default_rng([seed, 99])
    hand_eye = np.eye(4) if X is None else X
    out: list[tuple[View, Truth]] = []
    for station in range(stations):
        body = at(1.6, 0.4 * station, 0.5, (0, 0, np.pi))
        body_true = body @ se3.exp(_draw(rng, *base))
        for k in range(views // stations):
            number = station * (views // stations) + k
            nominal = _aim(rng, 0.9 if k == 0 else rng.uniform(0.55, 1.25))
            robot = RobotPose(body, se3.inverse(body) @ nominal)
            T = body_true @ robot.T_body_camera @ se3.exp(_draw(rng, *arm)) @ hand_eye
            out.append(
                measured(caster, T, robot, number=number, station=station, noise_mm=noise_mm, effect=effect, seed=seed, camera=camera)
            )
    return [view for view, _ in out], [truth for _, truth in out]


def _aim(rng: np.random.Generator, reach: float) -> Float:
    azimuth, elevation = rng.uniform(-0.6, 0.6), rng.uniform(-0.3, 0.6)
    target = np.array([0.0, rng.uniform(-0.2, 0.2), rng.uniform(0.7, 0.9)])
    direction = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    return look(target + reach * direction, target, rng.uniform(-0.4, 0.4))


def _draw(rng: np.random.Generator, mm: float, degrees: float) -> Float:
    return np.concatenate([rng.normal(size=3) * mm * 1e-3, np.radians(rng.normal(size=3) * degrees)])


def one_view(caster: Raycaster, error: Float, *, effect: Callable[[Seen], Float] | None = None, seed: int = 0) -> tuple[View, Truth]:
    """One frontal view of the section whose robot is wrong by the twist `error` (6,), in the camera's frame."""
    T = look(np.array([0.85, 0.25, 1.0]), np.array([0.0, 0.0, 0.8]))
    return measured(caster, T, RobotPose(np.eye(4), T @ se3.exp(-np.asarray(error))), effect=effect, seed=seed)


def wiggling(seen: Seen) -> Float:
    """3 mm RMS that repeats every 375 mm of range."""
    return np.asarray(3e-3 * np.sqrt(2.0) * np.sin(2 * np.pi * seen.range_m / 0.375 + 0.7))


def amplitude_bias(seen: Seen) -> Float:
    """About 3 mm RMS: too far where dark, too near where bright."""
    return -3e-3 * (np.log(np.maximum(seen.amplitude, 1.0)) - 6.0) / 0.8


def drift(seen: Seen) -> Float:
    """A camera that warms up: 15 mm in the end, alike in all pixels."""
    return np.full_like(seen.depth, 15e-3 * (1.0 - np.exp(-seen.view / 3.0)))


def pose_error(T: Float, truth: Truth) -> tuple[float, float]:
    """mm and degrees."""
    metres, degrees = se3.distance(T, truth.T_cell_camera)
    return 1000.0 * metres, degrees


def label_errors(caster: Raycaster, T: Float, truth: Truth) -> Float:
    """Errors (n,) in metres of the depth rendered at T, where both poses see the same surface."""
    error = (true_depth(caster, T)[0] - truth.depth).ravel()
    return error[np.abs(error) < 0.02]
