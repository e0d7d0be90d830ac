# SPDX-License-Identifier: Apache-2.0
"""Size of a glTF scene by its JSON header: nodes, levels, vertices and bytes, before trimesh allocates for them."""

from __future__ import annotations

import json
import struct
from collections import Counter
from typing import TYPE_CHECKING, Any

from tof_core.bounds import DEEPEST_NODE, LARGEST_ARRAYS, MOST_MESH_ELEMENTS, MOST_NODES
from tof_core.errors import SceneError

if TYPE_CHECKING:
    from pathlib import Path


def check_gltf(path: Path) -> None:
    """Refuse a .gltf or .glb file that is larger than any assembly.

    Raises:
        SceneError: more nodes, levels or vertices than `tof_core.bounds` allow, or no glTF header.
    """
    try:
        header = _header(path)
        nodes, elements, copied = _edges(header), _elements(header), _copied_bytes(header)
    except SceneError as error:
        raise SceneError(error.what, where=path, todo=error.todo) from None
    except Exception as error:  # noqa: BLE001 (a header of any form)
        raise SceneError(
            f"the mesh cannot be read: {type(error).__name__} in its glTF header", where=path, todo="export it again"
        ) from None
    for what, found, most in (
        ("nodes", nodes, MOST_NODES),
        ("vertices and indices", elements, MOST_MESH_ELEMENTS),
        ("bytes in its buffer views", copied, LARGEST_ARRAYS),
    ):
        if found > most:
            raise SceneError(f"the mesh has {found} {what}", where=path, todo=f"up to {most} are read; export it in parts")


def _header(path: Path) -> dict[str, Any]:
    """The JSON of a .gltf file or of a .glb file's first chunk."""
    with path.open("rb") as file:
        if path.suffix.lower() == ".gltf":
            return dict(json.loads(file.read().decode("utf-8-sig")))
        _, _, _, length, _ = struct.unpack("<5I", file.read(20))
        return dict(json.loads(file.read(min(length, path.stat().st_size))))


def _edges(header: dict[str, Any]) -> int:
    """Number of nodes or of parent-child links, the larger; refuses too many levels below the scenes' roots."""
    nodes = header.get("nodes", [])
    children = [node.get("children", []) for node in nodes]
    edges = sum(map(len, children)) + sum(len(scene.get("nodes", [])) for scene in header.get("scenes", []))
    if max(edges, len(nodes)) <= MOST_NODES:
        level = {child for scene in header.get("scenes", []) for child in scene.get("nodes", [])}
        for _ in range(DEEPEST_NODE):
            level = {child for node in level for child in children[node]}
        if level:
            raise SceneError(f"the mesh has nodes more than {DEEPEST_NODE} levels deep", todo="export it flat")
    return max(edges, len(nodes))


def _elements(header: dict[str, Any]) -> int:
    """Vertices and indices of all accessors, plus those of all meshes, counted once per node that uses the mesh."""
    counts = [int(accessor["count"]) for accessor in header.get("accessors", [])]
    if min(counts, default=0) < 0:
        raise ValueError("count")
    shown = Counter(node["mesh"] for node in header.get("nodes", []) if "mesh" in node)
    total = sum(counts)
    for index, mesh in enumerate(header.get("meshes", [])):
        used = [[*p.get("attributes", {}).values(), *([p["indices"]] if "indices" in p else [])] for p in mesh["primitives"]]
        total += sum(counts[accessor] for accessors in used for accessor in accessors) * max(shown[index], 1)
    return total


def _copied_bytes(header: dict[str, Any]) -> int:
    """Bytes of all buffer views; the reader copies each."""
    return sum(int(view["byteLength"]) for view in header.get("bufferViews", []))
