# SPDX-License-Identifier: Apache-2.0
"""Configurations, scenes and meshes that somebody else wrote."""

from __future__ import annotations

import contextlib
import difflib
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import from_mapping
from tof_core.errors import ToftwinError
from tof_core.yamlio import parse_yaml
from tof_scene import scene_file
from tof_scene.mesh_file import load_mesh
from tof_scene.scene import Part
from tof_scene.scene_file import load_scene, stl_bytes
from tof_sensor.model import load_model
from toftwin.options import parse_placement, parse_settings
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

CORNERS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
TETRAHEDRON = Part("t", CORNERS, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32))
SUFFIXES = (".stl", ".obj", ".ply", ".glb", ".off")


def config(folder: Path) -> Callable[[bytes], None]:
    """A configuration file, `--set`, `--initial-pose`, or a sensor.yaml, by the first byte."""
    sensor = folder / "sensor.yaml"
    difflib.get_close_matches = lambda *_, **__: []  # what to say of a misspelt key: ten times the work of all the rest

    def run(data: bytes) -> None:
        way, text = data[:1], data[1:].decode("utf-8", "replace")
        with contextlib.suppress(ToftwinError):
            if way == b"s":
                parse_settings(PipelineConfig, text.split("\n"))
            elif way == b"p":
                parse_placement(text, "camera")
            elif way == b"m":
                sensor.write_bytes(data[1:])
                load_model(sensor)
            else:
                from_mapping(PipelineConfig, parse_yaml(text, where="c"), where="c")

    return run


def config_seeds(folder: Path) -> list[bytes]:
    """Each way, said well."""
    del folder
    return [
        b"cpreproc: {iqr: {enable: false}, order: accumulate}\nalign.mode: session\ninput: {depth_scale: 0.001, recover: true}\n",
        b"ca: &a [1, 2.5, .nan, 1e400, 0x7f, 2001-01-01, ~, !!str x]\nb: *a\n? [1]\n: 2\n",
        b"clabel:\n  max_sigma_mm: 5\n  unseen_offset_mm: 99999999999999999999999\n",
        b"salign.mode=per_view\npreproc.iqr.enable=yes\nlabel.max_sigma_mm=1e3",
        b"podom: 1 2 3 0 0 0 1",
        b"p1,2,3",
        b"mschema: toftwin.sensor/1\neffects:\n- {effect: wiggling, a3: 0.01, b3: 0.002}\n- {effect: multipath, strength: 1.0}\n",
    ]


def scene(folder: Path) -> Callable[[bytes], None]:
    """A scene.yaml beside two good meshes (read once: the mesh files are fuzzed by `mesh`)."""
    folder = folder / "scene"
    folder.mkdir()
    (folder / "a.stl").write_bytes(stl_bytes(TETRAHEDRON))
    (folder / "b.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    vars(scene_file)["load_mesh"] = cache(load_mesh)
    path = folder / "scene.yaml"

    def run(data: bytes) -> None:
        path.write_bytes(data)
        with contextlib.suppress(ToftwinError), np.errstate(all="ignore"):
            load_scene(path)

    return run


def scene_seeds(folder: Path) -> list[bytes]:
    """Everything that a scene may say."""
    del folder
    return [
        b"frame: cell\nplaced_in: {frame: odom, pose: [1, 2, 3, 0, 0, 0, 1]}\nparts:\n- {name: a, mesh: a.stl}\n",
        b"frame: c\nparts:\n- name: a\n  mesh: a.stl\n  scale: 0.5\n  pose: {xyz: [1, 2, 3], xyzw: [0, 0, 0, 1]}\n  material: {albedo: 0.5, roughness: 1}\n  inspect: true\n  tolerance_mm: 2\n",
        b"frame: c\nparts:\n- name: b\n  mesh: b.obj\n  pose: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n",
        b"frame: c\nparts: [{name: a, mesh: ../a.stl}, {name: a, mesh: /etc/passwd}, {name: x, mesh: .}]\n",
    ]


def mesh(folder: Path) -> Callable[[bytes], None]:
    """A mesh file; the first byte chooses its suffix."""
    paths = [folder / f"mesh{suffix}" for suffix in SUFFIXES]

    def run(data: bytes) -> None:
        path = paths[data[0] % len(paths) if data else 0]
        path.write_bytes(data[1:])
        with contextlib.suppress(ToftwinError), np.errstate(all="ignore"):
            vertices, faces = load_mesh(path)
            Part("p", vertices, faces)

    return run


def mesh_seeds(folder: Path) -> list[bytes]:
    """One of each kind."""
    import trimesh

    body = trimesh.Trimesh(TETRAHEDRON.vertices, TETRAHEDRON.faces, process=False)
    seeds = [b"\x00" + stl_bytes(TETRAHEDRON)]
    for number, suffix in enumerate(SUFFIXES):
        path = folder / f"seed{suffix}"
        body.export(path)
        seeds.append(bytes([number]) + path.read_bytes())
    ascii_ply = body.export(file_type="ply", encoding="ascii")
    return [*seeds, b"\x00" + body.export(file_type="stl_ascii").encode(), b"\x02" + bytes(ascii_ply)]
