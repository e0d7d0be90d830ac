# SPDX-License-Identifier: Apache-2.0
"""Sessions of other cameras, parts, robots and strengths: what a diagnosis that was fitted to three scenes would stumble over."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap_check.cases import MOVING, PAIRABLE, SINGLE, Case
from tof_scene.builtin.shapes import Solid, box, cylinder, join, moved, rotated, sphere
from tof_scene.mesh_file import load_mesh
from tof_scene.scene import Material, Part, Scene
from tof_scene.scene_file import save_scene

CAD = Path(__file__).resolve().parents[3] / "shared" / "data" / "cad"
SIZES = ((160, 120), (176, 144), (224, 171), (240, 180), (256, 192), (320, 240))
KINDS = ("null", "null", "single-usual", "single-usual", "single-usual", "pair", "pair", "left-out")
LEAST, MOST = 0.5, 2.5
"""Strengths against the usual one."""


def draw_wide(count: int, seed: int) -> list[Case]:
    """`count` cases, each by its own number: more of them leave the first as they are."""
    return [_case(number, np.random.default_rng([seed, number])) for number in range(count)]


def scenes() -> tuple[str, ...]:
    """Boxes, and the CAD of others where it lies beside the checkout."""
    return ("boxes", "assembly", "mould") if CAD.is_dir() else ("boxes",)


def _case(number: int, rng: np.random.Generator) -> Case:
    kind, scene = _pick(rng, KINDS), scenes()[number % len(scenes())]
    number_of = {"null": 0, "pair": 2}.get(kind, 1)
    chosen = rng.choice(SINGLE if kind.startswith("single") else PAIRABLE, number_of, replace=False)
    effects = {str(name): 1.0 if kind == "left-out" else float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST)))) for name in chosen}
    left_out = next(iter(effects)) if kind == "left-out" else ""
    settings = _settings(rng, scene, moving=bool(MOVING & set(effects)))
    mhz = settings["camera.modulation_mhz"]
    return Case(f"case{number:04d}", kind, scene, effects, left_out, int(rng.integers(1, 2**31)), mhz, settings)


def _pick(rng: np.random.Generator, of: tuple[Any, ...]) -> Any:
    return of[int(rng.integers(len(of)))]


LOOK = {"boxes": ("-0.05,0,0.12", 5.0, 60.0), "assembly": ("0,0,0.03", 15.0, 70.0), "mould": ("0,0,0.15", 10.0, 60.0)}
"""Of each scene the point looked at, and the lowest and highest elevation."""


def _settings(rng: np.random.Generator, scene: str, *, moving: bool) -> dict[str, Any]:
    """A camera, a robot and a plan, as keys of the virtual robot's configuration."""
    width, height = _pick(rng, SIZES)
    target, low, high = LOOK[scene]
    return {
        "camera.width": width,
        "camera.height": height,
        "camera.fov_deg": float(rng.uniform(45, 72)),
        "camera.modulation_mhz": float(_pick(rng, (50.0, 60.0, 80.0, 100.0, 120.0))),
        "camera.signal_ke": float(np.exp(rng.uniform(np.log(70), np.log(200)))),
        "camera.ambient_ke": float(rng.uniform(20, 150)),
        "camera.contrast": float(rng.uniform(0.5, 0.9)),
        "robot.base_min_mm": 10.0,
        "robot.base_max_mm": float(rng.uniform(20, 50)),
        "robot.base_deg": float(rng.uniform(0.5, 2)),
        "robot.arm_mm": float(rng.uniform(0.5, 1.5)),
        "plan.views": _pick(rng, (8, 10, 12, 12, 16)),
        "plan.stations": _pick(rng, (1, 2, 2, 3)),
        "plan.captures": 1 if moving else _pick(rng, (1, 1, 1, 3)),
        "plan.range_min_m": float(rng.uniform(0.4, 0.6)),
        "plan.range_max_m": float(rng.uniform(1.0, 1.5)),
        "plan.elevation_min_deg": low,
        "plan.elevation_max_deg": high,
        "plan.azimuth_deg": float(rng.uniform(35, 70)),
        "plan.target": target,
        "plan.pause_s": _pick(rng, (0.0, 10.0, 30.0)),
        "plan.tf_rate_hz": _pick(rng, (50.0, 100.0)),
        "plan.capture_moving": moving,
        "output.encoding": _pick(rng, ("16UC1", "32FC1")),
    }


def write_scene(name: str, folder: Path, seed: int) -> Path:
    """The drawn scene as scene.yaml with its meshes; what stands on the table is inspected, and has an albedo of its own."""
    rng = np.random.default_rng(seed)
    solids = {"boxes": _boxes, "assembly": _assembly, "mould": _mould}[name](rng)
    around = ("table", "wall")
    albedo = {part: 0.3 if part in around else round(float(rng.uniform(0.12, 0.75)), 2) for part in solids}
    parts = [Part(part, *solid, Material(albedo[part]), inspect=part not in around) for part, solid in solids.items()]
    return save_scene(Scene("cell", tuple(parts)), folder)


def _boxes(rng: np.random.Generator) -> dict[str, Solid]:
    """Boxes, posts and domes of any size on a table before a wall."""
    out = {"table": box((2, 2, 0.02), (0, 0, -0.01)), "wall": box((0.02, 1.6, 0.9), (-0.5, 0, 0.45))}
    for i in range(int(rng.integers(5, 10))):
        height, radius = rng.uniform(0.04, 0.4), rng.uniform(0.02, 0.1)
        block = box((*rng.uniform(0.05, 0.25, 2), height), (0, 0, height / 2))
        solid = _pick(rng, (block, block, cylinder(radius, height), moved(sphere(max(radius, 0.05)), (0, 0, 0.6 * radius))))
        out[f"part_{i}"] = moved(rotated(solid, "z", rng.uniform(0, 180)), (rng.uniform(-0.3, 0.35), rng.uniform(-0.4, 0.4), 0))
    return out


def _assembly(rng: np.random.Generator) -> dict[str, Solid]:
    """NIST's insert (ARIAC) with the units that go onto it beside it."""
    floor = -0.012
    out = {"table": box((1.8, 1.6, 0.02), (0, 0, floor - 0.01))}
    for name in ("insert_base", "mounts", "hardware", "pipe_1", "pipe_2", "screen"):
        out[name] = load_mesh(CAD / "ariac" / f"assembly_insert_{name}.stl")
    beside = {
        "pump": (("base", "enclosure"), (0.40, 0.12, 0.0)),
        "regulator": (("base", "long_peg", "short_peg"), (0.38, -0.15, 0.0)),
        "battery": (("base", "cap", "pins"), (-0.42, 0.15, 0.02)),
        "sensor": (("base", "peg"), (-0.40, -0.18, 0.0)),
    }
    for name, (pieces, at) in beside.items():
        unit = join(*(load_mesh(CAD / "ariac" / f"{name}_{name}_{piece}.stl") for piece in pieces))
        out[name] = moved(rotated(unit, "z", rng.uniform(-90, 90)), np.add(at, (0, 0, floor)))
    return out


def _mould(rng: np.random.Generator) -> dict[str, Solid]:
    """A mould block and a thin panel behind it (collaborative-robotic-sanding)."""
    panel = rotated(rotated(load_mesh(CAD / "crs_part_2.stl"), "z", 90), "y", 65)
    return {
        "table": box((2.2, 2.0, 0.02), (0, 0, -0.01)),
        "mould": moved(load_mesh(CAD / "crs_mold.stl"), (-0.33, -0.33, 0.051)),
        "panel": moved(panel, (-0.55, 0, 0.35)),
        "post": moved(cylinder(0.03, 0.4), (0.2, 0.55, 0)),
        "block": moved(rotated(box((0.12, 0.2, 0.09), (0, 0, 0.045)), "z", rng.uniform(0, 90)), (0.45, -0.2, 0)),
    }
