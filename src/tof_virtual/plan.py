# SPDX-License-Identifier: Apache-2.0
"""Plan of a session: stations around the target, views of varied range, azimuth and elevation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.errors import ConfigError
from tof_virtual.robot import HAND_OF_CAMERA

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints
    from tof_virtual.config import PlanConfig
    from tof_virtual.sight import World

STANDOFF_M = 1.35
"""Distance of the body from the target, on the floor."""
BODY_HEIGHT_M = 0.55
CLEAR_M = 0.22
"""Least distance of any surface from the camera."""
SEEN = 0.45
"""Least share of a view that should hit something."""
TRIES = 40


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """One view of the plan: its station, the body's pose in the cell, the hand's pose in the body."""

    station: int
    T_cell_body: Float
    T_body_hand: Float


def plan(world: World, config: PlanConfig, rays: Float, rng: np.random.Generator) -> list[Stop]:
    """Stops in order of time; `rays` (n, 3) is a coarse raster of the camera's rays, to see what a view would hit."""
    if config.sweep_deg > 0:
        return _sweep(world, config)
    target = _target(world, config)
    low, high = world.soup.box
    extent = config.spread * np.minimum(0.5 * (high - low), 0.6)
    station = np.arange(config.views) * min(config.stations, config.views) // config.views
    ranges = _spread(config.range_min_m, config.range_max_m, station, rng)
    elevations = _spread(config.elevation_min_deg, config.elevation_max_deg, station, rng)
    count = int(station.max()) + 1
    middle = config.facing_deg + (np.linspace(-0.4, 0.4, count) if count > 1 else np.zeros(1)) * config.azimuth_deg
    bodies = [_body(target, np.radians(a)) for a in middle]
    azimuths = _spread(-1.0, 1.0, station, rng)
    stops = []
    for k, s in enumerate(station):
        side = config.azimuth_deg - abs(middle[s] - config.facing_deg)
        T_cell_camera = _view(world, rays, rng, config, target, extent, ranges[k], middle[s] + side * azimuths[k], elevations[k])
        stops.append(Stop(int(s), bodies[s], se3.inverse(bodies[s]) @ T_cell_camera @ se3.inverse(HAND_OF_CAMERA)))
    return stops


def _sweep(world: World, config: PlanConfig) -> list[Stop]:
    """Views that differ in azimuth alone: the middle of the ranges from one surface point, the middle of the elevations."""
    target = _target(world, config)
    azimuths = np.radians(config.facing_deg + np.linspace(0, config.sweep_deg, config.views))
    elevation = np.radians(0.5 * (config.elevation_min_deg + config.elevation_max_deg))
    away = np.stack(
        [np.cos(elevation) * np.cos(azimuths), np.cos(elevation) * np.sin(azimuths), np.full(config.views, np.sin(elevation))], axis=1
    )
    middle = away[config.views // 2]
    far = target + middle * (world.soup.extent + 3.0)
    t, _ = world.tree.cast(far, -middle[None])
    point = far - middle * t[0] if np.isfinite(t[0]) else target
    body = _body(target, float(azimuths.mean()))
    range_m = 0.5 * (config.range_min_m + config.range_max_m)
    return [Stop(0, body, se3.inverse(body) @ look_at(point + a * range_m, point) @ se3.inverse(HAND_OF_CAMERA)) for a in away]


def look_at(position: Float, point: Float, roll: float = 0.0) -> Float:
    """`T_cell_camera` of an optical frame at `position` whose z axis goes through `point`, image upright at roll 0."""
    z = (point - position) / np.linalg.norm(point - position)
    x = np.cross(z, [0.0, 0, 1])
    x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-6 else np.array([0.0, 1, 0])
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1) @ se3.so3_exp([0, 0, roll])
    T[:3, 3] = position
    return T


def _target(world: World, config: PlanConfig) -> Float:
    if not config.target:
        return world.soup.centre
    try:
        target = np.array([float(x) for x in config.target.split(",")])
    except ValueError:
        target = np.zeros(0)
    if target.shape != (3,):
        msg = f"'{config.target}' is no point"
        raise ConfigError(msg, where="plan.target", todo="write x,y,z in metres")
    return target


def _spread(low: float, high: float, station: Ints, rng: np.random.Generator) -> Float:
    """One value a view, evenly over the interval within every station, in random order."""
    out = np.empty(station.size)
    for s in np.unique(station):
        mine = np.flatnonzero(station == s)
        steps = (np.arange(mine.size) + rng.uniform(0.2, 0.8, mine.size)) / mine.size
        out[mine] = low + (high - low) * rng.permutation(steps)
    return out


def _body(target: Float, azimuth: float) -> Float:
    """The body on the floor, facing the target from `azimuth` (radians from the cell's x)."""
    T = np.eye(4)
    T[:3, :3] = se3.so3_exp([0, 0, azimuth + np.pi])
    T[:3, 3] = target[0] + STANDOFF_M * np.cos(azimuth), target[1] + STANDOFF_M * np.sin(azimuth), BODY_HEIGHT_M
    return T


def _view(
    world: World,
    rays: Float,
    rng: np.random.Generator,
    config: PlanConfig,
    target: Float,
    extent: Float,
    range_m: float,
    azimuth: float,
    elevation: float,
) -> Float:
    """A camera at `range_m` from the first surface towards a point near the target; the best of some tries."""
    best, most = None, -1.0
    for k in range(TRIES):
        wobble = 1.0 + k / 8
        a, e = np.radians([azimuth + wobble * rng.normal(0, 2), elevation + wobble * rng.normal(0, 2)])
        away = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        point = target + rng.uniform(-1, 1, 3) * extent
        far = point + away * (world.soup.extent + 3.0)
        t, hit = world.tree.cast(far, -away[None])
        surface = far - away * (t[0] if np.isfinite(t[0]) else np.linalg.norm(far - point))
        T = look_at(surface + away * range_m, surface, np.radians(rng.uniform(-1, 1) * config.roll_deg))
        z, _ = world.tree.cast(T[:3, 3], rays @ T[:3, :3].T)
        seen = float(np.isfinite(z).mean())
        if np.nanmin(z, initial=np.inf) < CLEAR_M or T[2, 3] < 0.1:
            seen -= 1
        if hit[0] < 0 or not world.soup.subject[world.soup.body[hit[0]]]:
            seen -= 0.5  # the axis misses the subjects
        if seen > most:
            best, most = T, seen
        if most > SEEN:
            break
    assert best is not None
    return best
