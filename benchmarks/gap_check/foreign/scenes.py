# SPDX-License-Identifier: Apache-2.0
"""Scenes that no part of toftwin carries: an open cabinet, a press tool with a free-form surface, a gearbox."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_scene.builtin import builtin_names, write_builtin
from tof_scene.builtin.shapes import Solid, box, cylinder, grid, join, lathe, moved, rotated
from tof_scene.scene import Material, Part, Scene
from tof_scene.scene_file import save_scene

if TYPE_CHECKING:
    from pathlib import Path

AROUND = ("floor", "back")
"""Parts that no robot comes to inspect."""


def write_foreign(name: str, folder: Path, seed: int) -> Path:
    """A built-in scene, or one of this file, drawn from the seed; returns its scene.yaml."""
    if name in builtin_names():
        return write_builtin(name, folder)
    rng = np.random.default_rng([seed, 3])
    solids = {"cabinet": _cabinet, "press_tool": _press_tool, "gearbox": _gearbox}[name](rng)
    parts = [
        Part(part, *solid, Material(0.4 if part in AROUND else round(float(rng.uniform(0.15, 0.75)), 2)), inspect=part not in AROUND)
        for part, solid in solids.items()
    ]
    return save_scene(Scene("cell", tuple(parts)), folder)


def _cabinet(rng: np.random.Generator) -> dict[str, Solid]:
    """Two shelves between side walls, bottles and crates on them, open towards +x."""
    width, depth, height = 1.0, 0.4, 0.75
    low = 0.4
    out = {"floor": box((2.4, 2.4, 0.02), (0, 0, -0.01)), "back": box((0.02, width, height), (-depth / 2, 0, low + height / 2))}
    for side in (-1, 1):
        out[f"side_{side + 1}"] = box((depth, 0.02, height), (0, side * width / 2, low + height / 2))
    levels = (low, low + rng.uniform(0.33, 0.42))
    for k, z in enumerate(levels):
        out[f"shelf_{k}"] = box((depth, width, 0.02), (0, 0, z - 0.01))
        places = np.linspace(-0.4, 0.4, 5) + rng.uniform(-0.03, 0.03, 5)
        for i, y in enumerate(places):
            at = (rng.uniform(-0.05, 0.1), y, z)
            out[f"item_{k}_{i}"] = moved(_bottle(rng) if rng.random() < 0.5 else _crate(rng), at)
    return out


def _bottle(rng: np.random.Generator) -> Solid:
    radius, height = rng.uniform(0.035, 0.06), rng.uniform(0.15, 0.26)
    profile = [(radius, 0), (radius, 0.6 * height), (0.4 * radius, 0.8 * height), (0.4 * radius, height)]
    return lathe([(0.0, 0.0), *profile, (0.0, height)])


def _crate(rng: np.random.Generator) -> Solid:
    size = rng.uniform((0.08, 0.07, 0.06), (0.18, 0.13, 0.2))
    return rotated(box(size, (0, 0, size[2] / 2)), "z", float(rng.uniform(-30, 30)))


def _press_tool(rng: np.random.Generator) -> dict[str, Solid]:
    """A die whose top is a smooth free form, guide posts at its corners, clamps before it."""
    out = {"floor": box((2.4, 2.4, 0.02), (0, 0, -0.01)), "base": box((0.7, 0.9, 0.3), (0, 0, 0.15))}
    out["die"] = _relief(rng, (0.5, 0.66), 0.3)
    for i, (x, y) in enumerate([(-0.29, -0.38), (-0.29, 0.38), (0.29, -0.38), (0.29, 0.38)]):
        out[f"post_{i}"] = moved(cylinder(float(rng.uniform(0.025, 0.045)), float(rng.uniform(0.15, 0.3))), (x, y, 0.3))
    for i, y in enumerate((-0.2, 0.0, 0.2)):
        out[f"clamp_{i}"] = moved(rotated(box((0.12, 0.05, 0.06), (0, 0, 0.03)), "z", float(rng.uniform(-25, 25))), (0.31, y, 0.3))
    out["back"] = box((0.02, 1.6, 1.1), (-0.75, 0, 0.55))
    return out


def _relief(rng: np.random.Generator, size: tuple[float, float], base: float) -> Solid:
    """A block with a top of a few smooth hills."""
    uv, tri = grid(48, 60)
    x, y = (uv[:, 0] - 0.5) * size[0], (uv[:, 1] - 0.5) * size[1]
    z = np.full(len(uv), 0.08)
    for _ in range(4):
        at, wide, high = rng.uniform(-0.2, 0.2, 2), rng.uniform(0.06, 0.14), rng.uniform(-0.05, 0.12)
        z += high * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * wide**2))
    top = np.stack([x, y, base + np.maximum(z, 0.01)], axis=1)
    return join((top, tri), box((size[0], size[1], 0.01), (0, 0, base + 0.005)))


def _gearbox(rng: np.random.Generator) -> dict[str, Solid]:
    """A lathed housing with flange, ribs and bolts, a shaft, a tray beside it."""
    middle = 0.55
    out = {"floor": box((2.4, 2.4, 0.02), (0, 0, -0.01)), "plinth": box((0.6, 0.8, 0.25), (0, 0, 0.125))}
    radius = float(rng.uniform(0.17, 0.22))
    profile = [(0, 0), (radius, 0), (radius, 0.02), (0.75 * radius, 0.03), (0.65 * radius, 0.2), (0.4 * radius, 0.24), (0, 0.24)]
    out["housing"] = moved(lathe(profile), (0, 0, middle), axis="x")
    for i, angle in enumerate(np.arange(6) * np.pi / 3):
        y, z = 0.85 * radius * np.cos(angle), 0.85 * radius * np.sin(angle)
        out[f"bolt_{i}"] = moved(cylinder(0.014, 0.02), (0.02, y, middle + z), axis="x")
        rib = rotated(box((0.12, 0.012, 0.3 * radius), (0.08, 0, 0.75 * radius)), "x", float(np.degrees(angle)) + 30)
        out[f"rib_{i}"] = moved(rib, (0, 0, middle))
    out["shaft"] = moved(cylinder(0.03, float(rng.uniform(0.05, 0.12))), (0.24, 0, middle), axis="x")
    out["bracket"] = box((0.03, 0.5, 0.35), (-0.015, 0, middle - 0.125))
    tray = [box((0.24, 0.3, 0.01), (0, 0, 0.005)), *(box((0.01, 0.3, 0.06), (s * 0.12, 0, 0.03)) for s in (-1, 1))]
    out["tray"] = moved(join(*tray), (0.1, float(rng.choice([-1, 1])) * 0.35, 0.25))
    out["back"] = box((0.02, 1.6, 1.2), (-0.6, 0, 0.6))
    return out
