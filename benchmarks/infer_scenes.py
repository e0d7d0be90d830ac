# SPDX-License-Identifier: Apache-2.0
"""Scenes of random solids: geometry without end to train on, so that what is learnt is the camera and not a part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_scene.builtin.shapes import box, cylinder, join, sphere
from tof_scene.scene import Material, Part, Scene

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_scene.builtin.shapes import Solid

CENTRE = np.array([0.0, 0.0, 0.8])


def random_scene(seed: int, hollow: float = 0.0) -> Scene:
    """Five to fourteen solids before a wall and over a floor, dark and bright; +x is the robot's side, as in the built-in scenes.

    Of scenes with such a share `hollow`, fewer solids and a large cavity open to the robot: light bounces there unlike it does between solids.
    """
    rng = np.random.default_rng([seed, 4711])
    cavity = hollow > 0 and rng.uniform() < hollow
    solids = [_placed(_solid(rng), rng) for _ in range(int(rng.integers(2, 6) if cavity else rng.integers(5, 15)))]
    if cavity:
        solids.append(_facing(_cavity(rng), rng))
    if rng.uniform() < 0.8:
        solids.append(box((0.04, 2.4, 2.0), (-rng.uniform(0.1, 0.6), 0, 1.0), 4))
    if rng.uniform() < 0.7:
        solids.append(box((1.6, 2.4, 0.04), (-0.1, 0, rng.uniform(0.35, 0.65)), 4))
    parts = tuple(Part(f"solid_{k:02d}", *solid, material=Material(_albedo(rng))) for k, solid in enumerate(solids))
    return Scene("cell", parts)


def _albedo(rng: np.random.Generator) -> float:
    """Log-uniform from tyre to white paper."""
    return float(np.exp(rng.uniform(np.log(0.04), np.log(0.9))))


def _placed(solid: Solid, rng: np.random.Generator) -> Solid:
    """Somewhere about the middle; half of them upright."""
    turn = rng.normal(0, 1.5, 3) if rng.uniform() < 0.5 else np.array([0, 0, rng.uniform(-np.pi, np.pi)])
    R: Float = se3.so3_exp(turn)
    return solid[0] @ R.T + CENTRE + rng.uniform(-1, 1, 3) * [0.25, 0.45, 0.35], solid[1]


def _facing(solid: Solid, rng: np.random.Generator) -> Solid:
    """Open to the robot, a little askew."""
    R: Float = se3.so3_exp(rng.normal(0, 0.2, 3))
    return solid[0] @ R.T + CENTRE + [0, *rng.uniform(-0.1, 0.1, 2)], solid[1]


def _solid(rng: np.random.Generator) -> Solid:
    kinds = (_block, _block, _plate, _cylinder, _cylinder, _ball, _tray, _profile, _stairs)
    return kinds[int(rng.integers(len(kinds)))](rng)


def _block(rng: np.random.Generator) -> Solid:
    return box(rng.uniform(0.03, 0.35, 3), cells=2)


def _plate(rng: np.random.Generator) -> Solid:
    return box((rng.uniform(0.002, 0.02), *rng.uniform(0.1, 0.7, 2)), cells=2)


def _cylinder(rng: np.random.Generator) -> Solid:
    return cylinder(rng.uniform(0.015, 0.15), rng.uniform(0.08, 0.8))


def _ball(rng: np.random.Generator) -> Solid:
    return sphere(rng.uniform(0.04, 0.2))


def _tray(rng: np.random.Generator) -> Solid:
    """Floor and four walls: open, concave, where light goes back and forth. It opens to z."""
    x, y, z = rng.uniform(0.15, 0.5), rng.uniform(0.15, 0.6), rng.uniform(0.05, 0.25)
    t = 0.008
    walls = [box((x, t, z), (0, s * y / 2, z / 2)) for s in (-1, 1)] + [box((t, y, z), (s * x / 2, 0, z / 2)) for s in (-1, 1)]
    v, f = join(box((x, y, t)), *walls)
    return v[:, [2, 1, 0]] * [1, 1, -1], f  # opens to x, the robot's side


def _cavity(rng: np.random.Generator) -> Solid:
    """A box without lid, ribs and posts on its floor, fins perhaps: castings, cabinets, wheel houses. It opens to x."""
    y, z, depth, t = rng.uniform(0.15, 0.7), rng.uniform(0.15, 0.6), rng.uniform(0.05, 0.3), rng.uniform(0.004, 0.02)
    out = [box((t, y, z), cells=4)]
    out += [box((depth, t, z), (depth / 2, s * y / 2, 0), 4) for s in (-1, 1)] + [
        box((depth, y, t), (depth / 2, 0, s * z / 2), 4) for s in (-1, 1)
    ]
    for _ in range(int(rng.integers(0, 4))):
        high, at = depth * rng.uniform(0.2, 0.9), rng.uniform(-0.4, 0.4)
        out.append(
            box((high, 0.005, z), (high / 2, at * y, 0), 4) if rng.uniform() < 0.5 else box((high, y, 0.005), (high / 2, 0, at * z), 4)
        )
    for _ in range(int(rng.integers(0, 6))):
        post, faces = cylinder(rng.uniform(0.004, 0.03), depth * rng.uniform(0.2, 0.9))
        out.append((post[:, [2, 0, 1]] + [0, *rng.uniform(-0.4, 0.4, 2) * [y, z]], faces))
    if rng.uniform() < 0.4:
        pitch, high, middle = rng.uniform(0.006, 0.02), depth * rng.uniform(0.1, 0.5), rng.uniform(-0.25, 0.25, 2) * [y, z]
        out += [box((high, 0.002, z / 4), (high / 2, middle[0] + pitch * (k - 3), middle[1]), 2) for k in range(7)]
    return join(*out)


def _profile(rng: np.random.Generator) -> Solid:
    """Two plates at an angle."""
    length, width, half = rng.uniform(0.2, 0.7), rng.uniform(0.08, 0.35), np.radians(rng.uniform(30, 75))
    out = []
    for side in (-1, 1):
        v, f = box((width, 0.006, length), (width / 2, 0, 0))
        c, s = np.cos(half), side * np.sin(half)
        out.append((v @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]), f))
    return join(*out)


def _stairs(rng: np.random.Generator) -> Solid:
    """Steps of a few millimetres to centimetres."""
    rise, run, width = rng.uniform(0.004, 0.05), rng.uniform(0.03, 0.1), rng.uniform(0.1, 0.4)
    return join(*(box((rise * (k + 1), run, width), (rise * (k + 1) / 2, run * (k - 1.5), 0)) for k in range(4)))
