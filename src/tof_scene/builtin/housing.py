# SPDX-License-Identifier: Apache-2.0
"""An open machined housing with its inside: pocket, ribs, bosses, board, cooling fins, gasket; concave, dark and bright side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_scene.builtin.parts import PAPER, RUBBER, STEEL, ZINC, part, room
from tof_scene.builtin.shapes import box, cylinder, join, lathe, moved, rotated, socket_screw, tube
from tof_scene.scene import Material, Part, Scene

if TYPE_CHECKING:
    from tof_scene.builtin.shapes import Solid

ALUMINIUM = Material(0.5, 0.5)
BOARD = Material(0.16, 0.7)
BLACK = Material(0.07, 0.8)
CENTRE = np.array([0.0, 0.0, 0.80])
"""Centre of the housing's back; its opening faces +x, tilted back by LEAN degrees on its stand."""
LEAN = -12.0
CORE = (0.17, 0.11)
FLOOR, RIM = 0.012, 0.095
"""Heights over the housing's back: of the pocket's floor and of the flange."""


def make() -> Scene:
    """The scene; parts have the names of their kind, numbered where there are several."""
    return Scene("cell", (*room(), *_stand(), *_leaning(_housing()), *_leaning(_inside()), *_leaning(_screws())))


def _leaning(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    """Parts built flat (z out of the pocket, x and y across) set upright in the cell."""
    out = []
    for p in parts:
        v, f = rotated(moved((p.vertices, p.faces), CENTRE, axis="x"), "y", LEAN, CENTRE)
        out.append(Part(p.name, v, f, p.material, p.inspect))
    return tuple(out)


def _stand() -> tuple[Part, ...]:
    table = box((0.9, 1.5, 0.03), (0.05, 0, 0.555), 10)
    back = rotated(box((0.02, 0.30, 0.30), CENTRE - (0.012, 0, 0.02), 6), "y", LEAN, CENTRE)
    sill = box((0.16, 0.34, 0.042), (0.10, 0, 0.592), 6)
    block = rotated(box((0.08, 0.10, 0.09), (0.20, 0.36, 0.616), 4), "z", 25, (0.20, 0.36, 0.6))
    return (
        part("table", table, Material(0.4, 0.9)), part("fixture", join(back, sill), ZINC), part("block", block, PAPER),
        part("foot", moved(cylinder(0.035, 0.05), (0.22, -0.36, 0.571)), RUBBER),
    )  # fmt: skip


def _housing() -> tuple[Part, ...]:
    """Tray with flange, fillet at the pocket's floor, ribs, bosses and a bearing seat: one casting."""
    fillet = [(0.014 - 0.010 * np.sin(a), FLOOR + 0.010 * (1 - np.cos(a))) for a in np.linspace(np.pi / 2, 0, 8)]
    profile = [(0, 0), (0.026, 0), (0.030, 0.004), (0.030, 0.083), (0.046, 0.083), (0.046, RIM), (0.022, RIM), (0.020, RIM - 0.002)]
    fillet = [(0.015 - 0.010 * (1 - np.cos(a)), FLOOR + 0.010 * (1 - np.sin(a))) for a in np.linspace(0, np.pi / 2, 8)]
    tray = lathe([*profile, *fillet, (0, FLOOR)], 96, CORE)
    ribs = [box((0.004, 0.10, 0.040), (-0.055, -0.068, 0.031), 4), box((0.11, 0.004, 0.030), (-0.118, -0.022, 0.026), 4)]
    bosses = [moved(cylinder(0.011, 0.052, 64), (x, y, FLOOR - 0.002)) for x, y in ((-0.165, 0.105), (0.165, -0.105), (-0.165, -0.105))]
    seat = lathe([(0.030, 0.0105), (0.043, 0.0105), (0.043, 0.046), (0.041, 0.048), (0.033, 0.048), (0.031, 0.046), (0.030, 0.0105)], 96)
    gasket = lathe(
        [(0.030, RIM - 0.001), (0.034, RIM - 0.001), (0.034, RIM + 0.0015), (0.030, RIM + 0.0015), (0.030, RIM - 0.001)], 96, CORE
    )
    return (
        part("housing", join(tray, *ribs, *bosses, moved(seat, (-0.105, 0.035, 0))), ALUMINIUM), part("gasket", gasket, RUBBER),
    )  # fmt: skip


def _inside() -> tuple[Part, ...]:
    """Board on pillars with chips and connectors, cooling fins, bearing, cable."""
    pillars = join(*(moved(cylinder(0.004, 0.020, 32), (x, y, 0.011)) for x in (0.005, 0.125) for y in (-0.035, 0.085)))
    board = box((0.14, 0.14, 0.0016), (0.065, 0.025, 0.0306), 10)
    chips = [((0.03, 0.03, 0.003), (0.03, 0.0)), ((0.02, 0.014, 0.002), (0.09, -0.02)), ((0.014, 0.02, 0.0025), (0.115, 0.02))]
    caps = [(0.105, 0.075), (0.088, 0.075), (0.071, 0.075)]
    fins = join(
        box((0.05, 0.044, 0.004), (0.045, 0.062, 0.0330), 4),
        *(box((0.0016, 0.044, 0.022), (0.022 + 0.0075 * i, 0.062, 0.0455), 4) for i in range(7)),
    )
    bearing = lathe(
        [
            (0.012, 0.010),
            (0.029, 0.010),
            (0.029, 0.040),
            (0.026, 0.041),
            (0.024, 0.037),
            (0.018, 0.037),
            (0.016, 0.041),
            (0.012, 0.040),
            (0.012, 0.010),
        ],
        96,
    )
    x = np.linspace(0, 1, 48)
    cable = tube(np.stack([-0.05 + 0.055 * x, -0.095 + 0.05 * x + 0.012 * np.sin(7 * x), 0.022 + 0.018 * np.sin(np.pi * x)], 1), 0.0035)
    return (
        part("pillars", pillars, STEEL), part("board", board, BOARD),
        *(part(f"chip_{i + 1}", box((a, b, c), (u, v, 0.0312 + c / 2), 2), BLACK, inspect=True) for i, ((a, b, c), (u, v)) in enumerate(chips)),
        *(part(f"capacitor_{i + 1}", moved(cylinder(0.0065, 0.016), (u, v, 0.0312)), Material(0.35, 0.5), inspect=True) for i, (u, v) in enumerate(caps)),
        part("fins", fins, Material(0.62, 0.4)), part("bearing", moved(bearing, (-0.105, 0.035, 0)), STEEL, inspect=True),
        part("connector", join(box((0.034, 0.012, 0.014), (0.09, -0.044, 0.0380), 3), box((0.028, 0.006, 0.008), (0.09, -0.053, 0.0380), 2)), PAPER, inspect=True),
        part("cable", cable, BLACK), part("label", box((0.05, 0.03, 0.0006), (-0.115, -0.075, 0.0121), 3), PAPER),
    )  # fmt: skip


def _screws() -> tuple[Part, ...]:
    """Screws on the flange and in the bosses, plugs in the wall, a rubber bumper in the pocket."""
    flange = [(x, y) for x in (-0.165, -0.055, 0.055, 0.165) for y in (-0.148, 0.148)]
    bosses = [(-0.165, 0.105), (0.165, -0.105), (-0.165, -0.105)]
    bumper = lathe([(0, 0.011), (0.014, 0.011), (0.014, 0.028), (0.010, 0.033), (0, 0.033)], 64)
    return (
        *(part(f"screw_{i + 1}", moved(socket_screw(0.006), (x, y, RIM - 0.0002)), STEEL, inspect=True) for i, (x, y) in enumerate(flange)),
        *(part(f"boss_screw_{i + 1}", moved(socket_screw(0.008), (x, y, 0.0618)), ZINC, inspect=True) for i, (x, y) in enumerate(bosses)),
        part("bumper", moved(bumper, (0.14, -0.082, 0)), RUBBER, inspect=True), part("dowel", _dowel(), ALUMINIUM, inspect=True),
    )  # fmt: skip


def _dowel() -> Solid:
    """A pin of the housing's own colour on the flange."""
    return moved(lathe([(0, 0), (0.004, 0), (0.004, 0.011), (0.003, 0.012), (0, 0.012)], 48), (-0.207, 0.0, RIM - 0.0002))
