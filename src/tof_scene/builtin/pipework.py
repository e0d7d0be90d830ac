# SPDX-License-Identifier: Apache-2.0
"""Pipes, elbows, flanges, a valve, a spherical tank and stepped plates: curved surfaces of many radii."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_scene.builtin.parts import PAPER, RUBBER, STEEL, ZINC, part, room
from tof_scene.builtin.shapes import arc, box, cylinder, hexagon_bolt, join, lathe, moved, rotated, sphere, torus, tube
from tof_scene.scene import Material, Part, Scene

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_scene.builtin.shapes import Solid

PAINT = Material(0.45, 0.7)
"""Albedo of pipes, plugs and sensors: colour alone cannot find them."""
BRASS = Material(0.36, 0.5)


def make() -> Scene:
    """The scene; parts have the names of their kind, numbered where there are several."""
    return Scene("cell", (*room(), *_frame(), *_pipes(), *_flanges(), *_tank(), *_small()))


def _frame() -> tuple[Part, ...]:
    plate = box((0.012, 1.0, 0.62), (-0.13, 0, 0.83), 10)
    steps = join(
        *(
            box((0.05 - 0.012 * i, 0.17 - 0.035 * i, 0.028), (-0.124 + (0.05 - 0.012 * i) / 2, -0.36, 0.600 + 0.0279 * i), 4)
            for i in range(4)
        )
    )
    skid = box((0.52, 1.1, 0.05), (0.02, 0, 0.495), 8)
    legs = join(*(box((0.05, 0.05, 0.472), (x, y, 0.236), 3) for x in (-0.18, 0.22) for y in (-0.48, 0.48)))
    return part("back_plate", plate, Material(0.28, 0.8)), part("steps", steps, STEEL), part("skid", join(skid, legs), Material(0.22, 0.9))


def _pipes() -> tuple[Part, ...]:
    main = tube(_straight((0.0, -0.46, 0.93), (0.0, 0.12, 0.93)), 0.042, 96)
    bend = tube(
        _joined([_straight((0.02, 0.22, 0.53), (0.02, 0.22, 0.86)), arc((0.02, 0.15, 0.86), (0.02, 0.22, 0.86), (0.02, 0.15, 0.93), 40)]),
        0.030,
        80,
    )
    riser = tube(
        _joined(
            [_straight((0.03, -0.20, 0.53), (0.03, -0.20, 0.84)), arc((-0.03, -0.20, 0.84), (0.03, -0.20, 0.84), (-0.03, -0.20, 0.90), 30)]
        ),
        0.019,
        64,
    )
    thin = tube(
        _joined(
            [
                _straight((0.055, -0.44, 0.70), (0.055, 0.02, 0.70)),
                arc((0.055, 0.02, 0.74), (0.055, 0.02, 0.70), (0.055, 0.06, 0.74), 20),
                _straight((0.055, 0.06, 0.745), (0.055, 0.06, 1.08)),
            ]
        ),
        0.008,
        40,
    )
    sleeve = tube(_straight((0.0, -0.42, 0.93), (0.0, -0.27, 0.93)), 0.054, 96)
    clamps = [part(f"clamp_{i + 1}", _clamp(y), ZINC, inspect=True) for i, y in enumerate((-0.235, -0.03))]
    return (
        part("main_pipe", main, PAINT), part("elbow", bend, PAINT), part("riser", riser, PAINT), part("thin_pipe", thin, BRASS),
        part("sleeve", sleeve, RUBBER), *clamps,
    )  # fmt: skip


def _clamp(y: float) -> Solid:
    """A saddle around the main pipe with two ears."""
    ring = moved(lathe([(0.043, -0.009), (0.0465, -0.009), (0.0465, 0.009), (0.043, 0.009), (0.043, -0.009)], 96), (0.0, y, 0.93), axis="y")
    ears = [box((0.006, 0.018, 0.022), (0.012, y, 0.93 + s * 0.055), 2) for s in (-1, 1)]
    return join(ring, *ears)


def _flanges() -> tuple[Part, ...]:
    """A pair of bolted flanges on the elbow and a blind one on the main pipe's end."""
    pair = join(*(moved(cylinder(0.058, 0.014, 96), (0.02, 0.22, z)) for z in (0.690, 0.706)))
    seal = moved(cylinder(0.050, 0.004, 96), (0.02, 0.22, 0.703))
    blind = moved(cylinder(0.066, 0.016, 96), (0.0, 0.11, 0.93), axis="y")
    angle = np.radians([-75, -37, 0, 37, 110, 180, 250])
    bolts = [moved(hexagon_bolt(0.008), (0.02 + 0.046 * np.cos(a), 0.22 + 0.046 * np.sin(a), 0.7198)) for a in angle]
    round_bolts = [
        moved(hexagon_bolt(0.008), (0.053 * np.cos(a), 0.1258, 0.93 + 0.053 * np.sin(a)), axis="y") for a in np.radians([0, 60, 120])
    ]
    return (
        part("flange", pair, STEEL), part("seal", seal, RUBBER), part("blind_flange", blind, STEEL),
        *(part(f"bolt_{i + 1}", b, ZINC, inspect=True) for i, b in enumerate([*bolts[:4], *round_bolts])), part("far_bolts", join(*bolts[4:]), ZINC),
    )  # fmt: skip


def _tank() -> tuple[Part, ...]:
    shell = moved(sphere(0.135, 160), (0.04, 0.40, 0.78))
    neck = moved(lathe([(0, 0.10), (0.034, 0.10), (0.034, 0.15), (0.030, 0.154), (0.030, 0.175), (0, 0.175)], 80), (0.04, 0.40, 0.78))
    saddle = lathe([(0, 0), (0.085, 0), (0.085, 0.02), (0.07, 0.16), (0, 0.16)], 96)
    label = sphere(0.1356, 160)
    patch = label[0][label[1]].mean(axis=1) / 0.1356
    keep = (patch[:, 0] > 0.55) & (np.abs(patch[:, 1]) < 0.3) & (np.abs(patch[:, 2] - 0.1) < 0.2)
    return (
        part("tank", join(shell, neck), Material(0.6, 0.6)), part("saddle", moved(saddle, (0.04, 0.40, 0.518)), Material(0.25, 0.8)),
        part("label", (label[0] + [0.04, 0.40, 0.78], label[1][keep]), PAPER),
    )  # fmt: skip


def _small() -> tuple[Part, ...]:
    """Valve, gauge, plugs and sensors."""
    wheel = moved(
        join(
            torus(0.036, 0.005, 72),
            cylinder(0.010, 0.012),
            rotated(box((0.068, 0.008, 0.005), (0, 0, 0.003)), "z", 30),
            rotated(box((0.068, 0.008, 0.005), (0, 0, 0.0035)), "z", 120),
        ),
        (0.105, -0.20, 0.72),
        axis="x",
    )
    stem = moved(join(cylinder(0.016, 0.045, 64), moved(cylinder(0.007, 0.055), (0, 0, 0.043))), (0.018, -0.20, 0.72), axis="x")
    gauge = moved(
        lathe([(0, 0), (0.030, 0), (0.032, 0.003), (0.032, 0.022), (0.029, 0.024), (0.028, 0.020), (0, 0.020)], 96),
        (0.062, 0.06, 1.055),
        axis="x",
    )
    dial = moved(cylinder(0.0265, 0.0006, 96), (0.0821, 0.06, 1.055), axis="x")
    plug = moved(cylinder(0.011, 0.016, 6), (0.041, 0.0, 0), axis="x")
    plugs = [(plug[0] + [0, y, 0.93], plug[1]) for y in (-0.14, 0.06)]
    sensor = join(cylinder(0.012, 0.022, 64), moved(cylinder(0.008, 0.030, 48), (0, 0, 0.021)))
    sensors = [moved(sensor, (0.0, y, 0.970)) for y in (-0.17, -0.09)]
    pads = [moved(cylinder(0.020, 0.012, 64), (-0.1242, y, z), axis="x") for y, z in ((-0.36, 0.82), (0.12, 0.60), (-0.08, 1.07))]
    plate = rotated(box((0.004, 0.10, 0.08), (-0.118, -0.36, 1.04), 3), "y", 2, (-0.118, -0.36, 1.04))
    return (
        part("valve_wheel", wheel, Material(0.2, 0.7), inspect=True), part("valve_stem", stem, BRASS), part("gauge", gauge, Material(0.08, 0.6), inspect=True),
        part("dial", dial, PAPER), *(part(f"plug_{i + 1}", p, PAINT, inspect=True) for i, p in enumerate(plugs)),
        *(part(f"sensor_{i + 1}", s, PAINT, inspect=True) for i, s in enumerate(sensors)),
        *(part(f"pad_{i + 1}", p, RUBBER, inspect=True) for i, p in enumerate(pads)), part("sign", plate, PAPER),
    )  # fmt: skip


def _straight(a: tuple[float, float, float], b: tuple[float, float, float], n: int = 24) -> Float:
    return np.linspace(np.asarray(a), np.asarray(b), n)


def _joined(pieces: list[Float]) -> Float:
    """Pieces of a path joined, without repeated points."""
    path = np.concatenate(pieces)
    return np.asarray(path[np.append(True, np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-9)])
