# SPDX-License-Identifier: Apache-2.0
"""A car-body section: sill with flanges, beads and holes, a pillar, a bracket with bolts, clips of the panel's own colour."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_scene.builtin.parts import PAPER, RUBBER, STEEL, ZINC, part, room
from tof_scene.builtin.shapes import box, cylinder, hexagon_bolt, join, lathe, moved, rotated, sheet, tube
from tof_scene.scene import Material, Part, Scene

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_scene.builtin.shapes import Solid

PANEL = Material(0.45, 0.6)
"""Albedo of primed sheet metal. Clips and studs have the same, so that colour alone cannot find them."""
LENGTH, SHEET = 0.9, 0.0015
# The sill's section (x, z), from the lower flange up, along the folds; corners are rounded by CORNER.
SECTION = np.array([(0.02, 0.60), (0.02, 0.635), (0.10, 0.665), (0.115, 0.86), (0.015, 0.905), (0.005, 0.96)])
CORNER = 0.008


def make() -> Scene:
    """The scene; parts have the names of their kind, numbered where there are several."""
    return Scene("cell", (*_surroundings(), *_panels(), *_bracket(), *_clips(), *_trim()))


def _surroundings() -> tuple[Part, ...]:
    posts = join(*(box((0.06, 0.06, 0.62), (-0.03, y, 0.31), 4) for y in (-0.36, 0.36)), box((0.30, 0.94, 0.03), (-0.02, 0, 0.585), 6))
    return *room(), part("stand", posts, Material(0.25, 0.8))


def _panels() -> tuple[Part, ...]:
    path = _rounded(SECTION, CORNER)
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])

    def sill(uv: Float) -> Float:
        """Flat pattern (along y, along the section) to the outside of the sill, with two long beads and three cross beads."""
        u, v = uv[:, 0], uv[:, 1]
        x, z = np.interp(v, at, path[:, 0]), np.interp(v, at, path[:, 1])
        long = sum(_bead(v, c, 0.011) for c in (0.165, 0.265)) * _window(u, 0.10, 0.80)
        cross = sum(_bead(u, c, 0.013) for c in (0.25, 0.45, 0.65)) * _window(v, 0.19, 0.24)
        return np.stack([x - 0.005 * np.maximum(long, cross), u - LENGTH / 2, z], 1)

    holes = [
        (0.06, 0.215, 0.014),
        (0.35, 0.215, 0.009),
        (0.55, 0.215, 0.009),
        (0.84, 0.215, 0.014),
        (0.20, 0.335, 0.010),
        (0.70, 0.335, 0.010),
    ]
    holes += [(u, 0.016, 0.004) for u in np.arange(0.06, 0.9, 0.12)] + [(u, length - 0.022, 0.004) for u in np.arange(0.09, 0.9, 0.12)]

    def pillar(uv: Float) -> Float:
        """A panel above the sill that leans back and is curved both ways."""
        u, v = uv[:, 0] - 0.14, uv[:, 1]
        x = 0.004 - 0.25 * v - 0.30 * v**2 - 1.6 * u**2 + 0.006 * _bead(u, 0.0, 0.03) * _window(v, 0.06, 0.34)
        return np.stack([x, u + 0.16, 0.93 + v], 1)

    return (
        part("sill", sheet((LENGTH, length), (120, 90), SHEET, sill, holes), PANEL),
        part("pillar", sheet((0.28, 0.40), (48, 60), SHEET, pillar, [(0.07, 0.25, 0.022), (0.21, 0.25, 0.016)]), PANEL),
    )


def _bracket() -> tuple[Part, ...]:
    """An angle bolted to the sill's face, with a gusset and a shelf."""

    def flat(x: float, z: float) -> Solid:
        return sheet(
            (0.14, 0.10),
            (28, 20),
            0.004,
            lambda uv: np.stack([np.full(len(uv), x), uv[:, 0] - 0.30, uv[:, 1] + z], 1),
            [(0.02, 0.05, 0.006), (0.12, 0.05, 0.006)],
        )

    shelf = box((0.09, 0.14, 0.004), (0.160, -0.23, 0.712), 4)
    gussets = [_gusset(y) for y in (-0.295, -0.165)]
    spots = [(0.120, -0.28, 0.76), (0.120, -0.18, 0.76)]
    bolts = [part(f"bolt_{i + 1}", moved(hexagon_bolt(0.012), p, axis="x"), STEEL, inspect=True) for i, p in enumerate(spots)]
    nuts = [part(f"nut_{i + 1}", moved(_nut(), (0.165, y, 0.714)), STEEL, inspect=True) for i, y in enumerate((-0.265, -0.195))]
    return part("bracket", join(flat(0.120, 0.71), shelf, *gussets), ZINC), *bolts, *nuts


def _gusset(y: float) -> Solid:
    outline = np.array([(0.120, 0.712), (0.195, 0.712), (0.120, 0.79)])
    v = np.concatenate([np.insert(outline, 1, y + s, axis=1) for s in (-0.002, 0.002)])
    f = [(0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5)]
    return v, np.asarray(f, np.int32)


def _nut() -> Solid:
    return join(lathe([(0, 0), (0.0075, 0), (0.0085, 0.001), (0.0085, 0.007), (0.0075, 0.008), (0, 0.008)], 6), cylinder(0.004, 0.013, 24))


def _clips() -> tuple[Part, ...]:
    """Trim clips and studs in the panel's own colour, on the sill's face and shelf."""
    body = join(
        box((0.030, 0.016, 0.006), (0, 0, 0.003)), box((0.018, 0.010, 0.008), (0, 0, 0.010)), moved(cylinder(0.004, 0.006), (0, 0, 0.014))
    )
    face = [(0.114, y, 0.805) for y in (-0.38, -0.08, 0.035, 0.30)]
    clips = [part(f"clip_{i + 1}", moved(body, p, axis="x"), PANEL, inspect=True) for i, p in enumerate(face)]
    stud = lathe([(0, 0), (0.006, 0), (0.006, 0.003), (0.003, 0.004), (0.003, 0.022), (0, 0.022)], 32)
    top = [(0.06, y, 0.884) for y in (-0.33, 0.0, 0.33)]
    return *clips, *(part(f"stud_{i + 1}", rotated(moved(stud, p), "y", 24, p), PANEL, inspect=True) for i, p in enumerate(top))


def _trim() -> tuple[Part, ...]:
    """Dark and bright parts: grommets, a harness on the sill, a paper label, a reference plate."""
    grommet = lathe([(0, 0), (0.020, 0), (0.020, 0.003), (0.016, 0.006), (0.010, 0.006), (0.008, 0.002), (0, 0.002)])
    spots = [(0.107, -0.39, 0.70), (0.107, 0.39, 0.70)]
    grommets = [part(f"grommet_{i + 1}", moved(grommet, p, axis="x"), RUBBER, inspect=True) for i, p in enumerate(spots)]
    y = np.linspace(0.02, 0.42, 60)
    harness = tube(np.stack([0.125 + 0.004 * np.sin(18 * y), y, 0.735 + 0.010 * np.sin(11 * y)], 1), 0.006)
    connector = join(box((0.030, 0.048, 0.024), (0.128, 0.01, 0.737), 3), box((0.012, 0.030, 0.010), (0.148, 0.01, 0.737)))
    mat = box((0.004, 0.16, 0.12), (0.1155, 0.16, 0.79), 4)
    label = box((0.0006, 0.09, 0.06), (-0.005, 0.15, 1.03), 3)
    plate = box((0.10, 0.16, 0.006), (0.20, 0.30, 0.62), 4)
    return (
        *grommets, part("harness", harness, RUBBER), part("connector", connector, Material(0.12, 0.7), inspect=True),
        part("damping_mat", mat, RUBBER), part("label", rotated(label, "y", -14, (-0.005, 0.15, 1.03)), PAPER), part("plate", plate, PAPER),
    )  # fmt: skip


def _bead(x: Float, centre: float, half: float) -> Float:
    """A cosine ridge of height 1."""
    s = np.clip((x - centre) / half, -1, 1)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * s))


def _window(x: Float, low: float, high: float, ramp: float = 0.02) -> Float:
    """1 between low and high, easing to 0 over `ramp`."""
    s = np.clip(np.minimum(x - low, high - x) / ramp, 0, 1)
    return np.asarray(s * s * (3 - 2 * s))


def _rounded(corners: Float, radius: float, n: int = 8) -> Float:
    """A polyline (k, 2) whose inner corners are arcs (quadratic curves that leave and meet its sides at `radius`)."""
    out = [corners[:1]]
    for a, b, c in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        p, q = b + radius * (a - b) / np.linalg.norm(a - b), b + radius * (c - b) / np.linalg.norm(c - b)
        s = np.linspace(0, 1, n)[:, None]
        out.append((1 - s) ** 2 * p + 2 * s * (1 - s) * b + s**2 * q)
    return np.concatenate([*out, corners[-1:]])
