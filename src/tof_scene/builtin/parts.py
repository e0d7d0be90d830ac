# SPDX-License-Identifier: Apache-2.0
"""Parts and surroundings common to the built-in scenes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_scene.builtin.shapes import box
from tof_scene.scene import Material, Part

if TYPE_CHECKING:
    from tof_scene.builtin.shapes import Solid

RUBBER = Material(0.05, 0.95)
PAPER = Material(0.82, 0.9)
ZINC = Material(0.3, 0.4)
STEEL = Material(0.55, 0.35)


def part(name: str, solid: Solid, material: Material, *, inspect: bool = False) -> Part:
    """A part from a solid."""
    return Part(name, *solid, material, inspect)


def room() -> tuple[Part, Part]:
    """Floor and back wall, so that nearly every ray hits a surface."""
    floor = part("floor", box((3.2, 5.0, 0.02), (0.4, 0, -0.01), 8), Material(0.35, 1.0))
    return floor, part("wall", box((0.02, 5.0, 2.6), (-0.55, 0, 1.3), 8), Material(0.6, 1.0))
