# SPDX-License-Identifier: Apache-2.0
"""The built-in scenes: the same each time, of a size that bags and tests can carry, seen whole, well-conditioned."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_scene.solids import camera, looking
from tof_core.errors import UsageError
from tof_scene.builtin import builtin_names, make_builtin, write_builtin
from tof_scene.builtin.shapes import box, cylinder, lathe, sheet, sphere, tube
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.topology import edges_of

if TYPE_CHECKING:
    from pathlib import Path

    from tof_scene.builtin.shapes import Solid

EYES = ((1.0, 0.0, 0.95), (0.8, -0.35, 1.1), (0.75, 0.35, 0.9), (0.6, 0.05, 0.9))


def volume(solid: Solid) -> float:
    """Positive when the faces look outward."""
    a, b, c = (solid[0][solid[1][:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize(("solid", "expected"), [
    (box((1, 2, 3), (4, 5, 6), 3), 6.0),
    (sphere(0.5, 200), 4 / 3 * np.pi * 0.125),
    (cylinder(0.5, 2.0, 200), np.pi * 0.5),
    (tube(np.linspace((0, 0, 0), (0, 0, 2), 5), 0.5, 200), np.pi * 0.5),
    (lathe([(0, 0), (0.5, 0), (0.5, 1), (0, 1)], 200, (1.0, 0.5)), np.pi * 0.25 + 2 + 2 * 0.5 * 2 + 2 * 0.5 * 1),
    (sheet((1, 1), (20, 20), 0.01, lambda uv: np.column_stack([uv, 0 * uv[:, 0]]), [(0.5, 0.5, 0.2)]), 0.01 * (1 - np.pi * 0.04)),
])  # fmt: skip
def test_solids_are_closed_look_outward_and_hold_their_volume(solid: Solid, expected: float) -> None:
    assert volume(solid) == pytest.approx(expected, rel=0.01)
    edges = edges_of(*solid, np.zeros(len(solid[1]), np.int16))
    assert (edges.faces[:, 1] >= 0).all()


@pytest.mark.parametrize("name", builtin_names())
def test_built_in_scenes_are_the_same_each_time_and_small(name: str, tmp_path: Path) -> None:
    scene = make_builtin(name)
    assert scene.digest == make_builtin(name).digest
    assert 20_000 <= sum(len(part.faces) for part in scene.parts) <= 200_000
    write_builtin(name, tmp_path)
    assert sum(file.stat().st_size for file in tmp_path.rglob("*.stl")) < 5e6


@pytest.mark.parametrize("name", builtin_names())
def test_built_in_scenes_have_dark_and_bright_patches_and_parts_to_inspect(name: str) -> None:
    scene = make_builtin(name)
    albedo = [part.material.albedo for part in scene.parts]
    assert min(albedo) < 0.1
    assert max(albedo) > 0.8
    inspected = [np.ptp(part.vertices, axis=0).max() for part in scene.parts if part.inspect]
    assert len(inspected) >= 10
    assert 0.005 <= min(inspected) <= max(inspected) <= 0.14
    assert any(part.inspect and part.material == other.material for part in scene.parts for other in scene.parts if not other.inspect)


@pytest.mark.parametrize("name", builtin_names())
def test_most_pixels_hit_and_all_six_degrees_of_freedom_show(name: str) -> None:
    """Point-to-plane normal matrix over the subject (not room or table), 1 mm against 1 mm at 0.3 m lever."""
    caster = Raycaster(make_builtin(name))
    for eye in EYES:
        cam = camera(112, 84)
        view = render(caster, cam, looking(eye, (0, 0, 0.8)), footprints=False)
        assert np.isfinite(view.depth).mean() > 0.97
        near = np.isfinite(view.depth) & (view.part >= 2)
        p, n = cam.points(view.depth)[near], view.normal[near].astype(float)
        p -= p.mean(axis=0)
        J = np.concatenate([n, np.cross(p, n) / 0.3], axis=1)
        weakest = np.sqrt(np.linalg.eigvalsh(J.T @ J / len(J))[0])
        assert weakest > 0.04, f"{name} from {eye}"


@pytest.mark.parametrize("name", builtin_names())
def test_each_inspected_part_is_seen_from_somewhere(name: str) -> None:
    scene = make_builtin(name)
    caster = Raycaster(scene)
    seen = np.zeros(len(scene.parts), int)
    for eye in (*EYES, (0.5, -0.3, 1.2), (0.5, 0.3, 1.2), (0.8, 0.0, 1.3)):
        part = render(caster, camera(400, 300), looking(eye, (0, 0, 0.8)), footprints=False).part
        seen = np.maximum(seen, np.bincount(part[part >= 0], minlength=len(seen)))
    assert [p.name for p, n in zip(scene.parts, seen, strict=True) if p.inspect and n < 8] == []


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(UsageError, match="use one of body_section, housing, pipework"):
        make_builtin("castle")
