# SPDX-License-Identifier: Apache-2.0
"""Absent parts, foreign objects and sensor errors, told apart in views of a plate with a block on it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.reasons import Reason
from tof_scene.builtin.shapes import box
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene import Part, Scene
from tof_scene.world.foreign import _Cloud, _joined
from tof_scene.world.limits import WorldLimits
from tof_scene.world.seen import Seen
from tof_scene.world.surprises import ABSENT, BEFORE, BEHIND, DISPLACED, NONE, OBJECT, find_surprises, view_surprises
from tof_scene.world.words import described, lines, of_views
from tof_virtual.plan import look_at

if TYPE_CHECKING:
    from tof_core.arrays import Float

CAMERA = Camera(width=96, height=72, fx=90.0, fy=90.0, cx=47.5, cy=35.5)
LIMITS = WorldLimits()
NOISE_M = 0.002
EYES = ((0.0, -0.6, 0.8), (0.5, -0.4, 0.8), (-0.5, -0.3, 0.9), (0.3, 0.5, 0.9), (-0.3, 0.5, 0.7), (0.0, 0.1, 1.0))
PLATE = Part("plate", *box((1.6, 1.6, 0.02), (0, 0, -0.01)))
BLOCK = Part("block", *box((0.12, 0.12, 0.1), (0.15, 0.0, 0.05)))
CRATE = Part("crate", *box((0.1, 0.14, 0.12), (-0.15, 0.05, 0.06)))


def scene(*parts: Part) -> Raycaster:
    return Raycaster(Scene("cell", parts))


def views(real: Raycaster, cad: Raycaster, bias: Float | float = 0.0) -> list[Seen]:
    """What the real parts give from all eyes, with noise and a bias, beside the CAD."""
    rng, out = np.random.default_rng(4), []
    for eye in EYES:
        T = look_at(np.array(eye), np.zeros(3))
        true, drawn = render(real, CAMERA, T), render(cad, CAMERA, T, footprints=False)
        measured = (true.depth + bias + rng.normal(0, NOISE_M, CAMERA.shape)).astype(np.float32)
        noise, pose = np.full(CAMERA.shape, NOISE_M, np.float32), np.full(CAMERA.shape, 0.001, np.float32)
        valid = np.where(np.isfinite(measured), Reason.VALID, Reason.NO_RETURN).astype(np.uint8)
        out.append(Seen(CAMERA, T, measured, noise, drawn.depth, pose, drawn.part, valid))
    return out


def wrong(seen: list[Seen], real: Raycaster) -> list[np.ndarray]:
    """Pixels whose CAD is more than 15 mm off the real surface."""
    return [np.abs(render(real, CAMERA, s.T_cell_camera, footprints=False).depth - s.cad) > 0.015 for s in seen]


def test_a_world_that_is_its_cad_has_no_surprise_in_spite_of_sensor_errors() -> None:
    cad = scene(PLATE, BLOCK)
    ramp = 0.012 * np.linspace(-1, 1, CAMERA.width)  # a smooth error of the sensor
    found = find_surprises(views(cad, cad, 0.008), cad, LIMITS)
    assert all((p == NONE).all() for p in found.pixels)
    assert (found.missing, found.foreign) == ((), ())
    tilted = find_surprises(views(cad, cad, 0.3 * ramp), cad, LIMITS)
    assert np.mean([(p != NONE).mean() for p in tilted.pixels]) < 0.002


def test_an_absent_part_is_named_and_none_of_its_pixels_stays() -> None:
    real, cad = scene(PLATE), scene(PLATE, BLOCK)
    seen = views(real, cad)
    found = find_surprises(seen, cad, LIMITS)
    assert [(m.part, len(m.views)) for m in found.missing] == [(1, len(EYES))]
    assert found.foreign == ()
    for codes, s, off in zip(found.pixels, seen, wrong(seen, real), strict=True):
        assert (codes[s.part == 1] == ABSENT).all()
        assert (codes[off] == NONE).mean() < 0.02
        assert (codes[~off & (s.part == 0)] != NONE).mean() < 0.02
    assert lines(described(found, cad.scene)) == ["missing part: block; views 1 to 6 see what lies behind its place"]


def test_a_foreign_object_is_found_where_it_stands_with_its_size() -> None:
    real, cad = scene(PLATE, BLOCK, CRATE), scene(PLATE, BLOCK)
    seen = views(real, cad)
    found = find_surprises(seen, cad, LIMITS)
    assert found.missing == ()
    (crate,) = found.foreign
    assert not crate.moves
    assert crate.views == tuple(range(len(EYES)))
    np.testing.assert_allclose(crate.centre_m, [-0.15, 0.05, 0.06], atol=0.015)
    np.testing.assert_allclose(crate.size_m, [0.1, 0.14, 0.12], atol=0.03)
    for codes, s, off in zip(found.pixels, seen, wrong(seen, real), strict=True):
        assert (codes[off] == OBJECT).mean() > 0.98
        assert (codes[~off & np.isfinite(s.cad)] != NONE).mean() < 0.02
    (line,) = lines(described(found, cad.scene))
    assert line.startswith("foreign object: ")
    assert line.endswith("seen in views 1 to 6")


def raised(height_m: float, shape: str) -> Part:
    """The plate with an area of some 12 cm that stands `height_m` out: a bump without an end, or the end of the plate."""
    grid = np.linspace(-0.8, 0.8, 81)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid, indexing="ij"))
    z = height_m * (np.exp(-((x + 0.15) ** 2 + (y - 0.05) ** 2) / (2 * 0.07**2)) if shape == "bump" else np.clip((-0.1 - x) / 0.2, 0, 1))
    corner = (np.arange(80)[:, None] * 81 + np.arange(80)).ravel()
    faces = np.concatenate([np.stack([corner, corner + 81, corner + 1], 1), np.stack([corner + 1, corner + 81, corner + 82], 1)])
    return Part("plate", np.stack([x, y, z], axis=1), faces)


@pytest.mark.parametrize("height_m", [0.014, 0.018])
def test_a_flat_object_ends_in_a_step(height_m: float) -> None:
    board = Part("board", *box((0.12, 0.16, height_m), (-0.15, 0.05, height_m / 2)))
    cad = scene(PLATE, BLOCK)
    (found,) = find_surprises(views(scene(PLATE, BLOCK, board), cad), cad, LIMITS).foreign
    assert not found.moves
    np.testing.assert_allclose(found.centre_m, [-0.15, 0.05, height_m], atol=0.012)
    np.testing.assert_allclose(found.size_m[:2], [0.12, 0.16], atol=0.03)


def test_a_flat_object_may_lie_across_parts() -> None:
    """A board of 16 cm across a strip of 8 cm and the plates at either side: none of the three surrounds it."""
    left, right = Part("left", *box((0.61, 1.6, 0.02), (-0.495, 0, -0.01))), Part("right", *box((0.91, 1.6, 0.02), (0.345, 0, -0.01)))
    strip = Part("strip", *box((0.08, 1.6, 0.02), (-0.15, 0, -0.01)))
    board = Part("board", *box((0.16, 0.12, 0.016), (-0.15, 0.05, 0.008)))
    cad = scene(left, strip, right, BLOCK)
    (found,) = find_surprises(views(scene(left, strip, right, BLOCK, board), cad), cad, LIMITS).foreign
    np.testing.assert_allclose(found.centre_m, [-0.15, 0.05, 0.016], atol=0.012)
    np.testing.assert_allclose(found.size_m[:2], [0.16, 0.12], atol=0.03)


def test_two_parts_whose_ends_are_bent_are_no_object() -> None:
    """The plate's end, and a second plate beside it, rise as one: each comes back to its CAD."""
    flat, risen = raised(0.0, "end"), raised(0.018, "end")

    def half(part: Part, side: int) -> Part:
        mine = side * part.vertices[part.faces].mean(axis=1)[:, 1] > 0
        return Part(f"plate {side}", part.vertices, part.faces[mine])

    cad, real = (scene(half(part, 1), half(part, -1), BLOCK) for part in (flat, risen))
    assert find_surprises(views(real, cad), cad, LIMITS).foreign == ()


@pytest.mark.parametrize("shape", ["bump", "end"])
def test_a_part_that_is_bent_comes_back_to_its_place_and_is_no_object(shape: str) -> None:
    cad = scene(PLATE, BLOCK)
    found = find_surprises(views(scene(raised(0.018, shape), BLOCK), cad), cad, LIMITS)
    assert sum(int((p != NONE).sum()) for p in found.pixels) > 500
    assert found.foreign == ()


def test_an_object_that_leans_on_a_part_approaches_it_gradually() -> None:
    """A wedge of 14 x 14 cm rises from the plate to 12 cm: half of it is less than 6 cm before the plate, and one side alone ends in a step."""
    foot = [[-0.07, -0.07, 0.0], [0.07, -0.07, 0.0], [0.07, 0.07, 0.0], [-0.07, 0.07, 0.0]]
    top = [[0.07, -0.07, 0.12], [0.07, 0.07, 0.12]]
    faces = np.array([[0, 1, 4], [3, 5, 2], [0, 4, 5], [0, 5, 3], [1, 2, 5], [1, 5, 4]], np.int32)
    wedge = Part("wedge", np.array([*foot, *top]) + np.array([-0.15, 0.05, 0.0]), faces)
    cad = scene(PLATE, BLOCK)
    (found,) = find_surprises(views(scene(PLATE, BLOCK, wedge), cad), cad, LIMITS).foreign
    assert len(found.views) > 1
    np.testing.assert_allclose(found.centre_m[:2], [-0.15, 0.05], atol=0.03)


def test_what_one_view_alone_sees_moves() -> None:
    real, cad = scene(PLATE, BLOCK, CRATE), scene(PLATE, BLOCK)
    seen = [views(real, cad)[0], *views(cad, cad)[1:]]
    found = find_surprises(seen, cad, LIMITS)
    (crate,) = found.foreign
    assert (crate.moves, crate.views) == (True, (0,))
    (line,) = lines(described(found, cad.scene))
    assert line.startswith("object in some views only: ")
    assert line.endswith("a person, the blur of a moving view, or the halo of a lamp or a bright surface")


@pytest.mark.parametrize(
    ("nearer", "inside", "by_m"),
    [(np.s_[20:22, 8:88], np.s_[20:22, 10:86], 0.1), (np.s_[20:50, 20:60], np.s_[22:48, 22:58], 0.5)],
    ids=["a band of mixed pixels", "a wrapped phase"],
)
def test_what_one_view_measures_before_the_cad_and_is_no_object(
    nearer: tuple[slice, slice], inside: tuple[slice, slice], by_m: float
) -> None:
    cad = scene(PLATE, BLOCK)
    seen = views(cad, cad)
    seen[2].depth[nearer] -= by_m
    found = find_surprises(seen, cad, LIMITS)
    assert found.foreign == ()
    assert (found.pixels[2][inside] == BEFORE).mean() > 0.95


@pytest.mark.parametrize(("of_block", "objects"), [(1.0, 0), (0.6, 1)])
def test_a_part_that_one_view_alone_measures_too_near_is_no_object(of_block: float, objects: int) -> None:
    """As a near, bright part may be: a whole chest, 60 mm too near. Something before a piece of it is an object."""
    cad = scene(PLATE, Part("chest", *box((0.3, 0.3, 0.15), (0.0, 0.0, 0.075))))
    seen = views(cad, cad)
    rows, columns = np.nonzero(seen[2].part == 1)
    nearer = columns <= np.quantile(columns, of_block)
    assert nearer.sum() > 400
    seen[2].depth[rows[nearer], columns[nearer]] -= 0.06
    assert len(find_surprises(seen, cad, LIMITS).foreign) == objects


@pytest.mark.parametrize(("parts", "code"), [((PLATE, BLOCK, CRATE), BEFORE), ((PLATE,), BEHIND)])
def test_one_view_alone_is_judged_by_itself(parts: tuple[Part, ...], code: int) -> None:
    real, cad = scene(*parts), scene(PLATE, BLOCK)
    seen = views(real, cad)
    codes, off = view_surprises(seen[0], LIMITS), wrong(seen, real)[0]
    assert (codes[off] == code).mean() > 0.95
    assert (codes[~off] != NONE).mean() < 0.02


@pytest.mark.parametrize(
    ("numbers", "words"), [([], "no view"), ([3], "view 4"), ([2, 3, 4], "views 3 to 5"), ([0, 4, 3, 7], "views 1, 4, 5, 8")]
)
def test_views_in_words(numbers: list[int], words: str) -> None:
    assert of_views(numbers) == words


def test_a_displaced_part_is_no_foreign_object() -> None:
    moved = Part("block", BLOCK.vertices + np.array([0.05, 0.03, 0.0]), BLOCK.faces)
    real, cad = scene(PLATE, moved), scene(PLATE, BLOCK)
    seen = views(real, cad)
    found = find_surprises(seen, cad, LIMITS)
    assert found.foreign == ()
    assert found.missing == ()
    assert any((codes == DISPLACED).any() for codes in found.pixels)
    kept = [(codes[off] == NONE).mean() for codes, off in zip(found.pixels, wrong(seen, real), strict=True)]
    assert np.mean(kept) < 0.05


def test_the_outline_of_a_part_that_stands_off_is_a_strip_too_narrow_for_a_patch() -> None:
    """A block that stands 8 mm beside its place: the strip before the plate is a pixel wide; it counts only beside the part that stands off."""
    cad = scene(PLATE, BLOCK)
    real = scene(PLATE, Part("block", BLOCK.vertices + np.array([0.0, -0.008, 0.0]), BLOCK.faces))
    seen = views(real, cad)
    apart = [replace(s, apart=np.where(s.part == 1, np.float32(0.008), np.float32(0.0))) for s in seen]
    off = [w & (np.abs(s.residual) > 0.015) for w, s in zip(wrong(seen, real), seen, strict=True)]
    kept = [
        sum(int((w & (p == NONE)).sum()) for w, p in zip(off, find_surprises(s, cad, LIMITS).pixels, strict=True)) for s in (seen, apart)
    ]
    assert kept[0] > 20
    assert kept[1] == 0
    lost = sum(int(((p != NONE) & ~w).sum()) for w, p in zip(wrong(seen, real), find_surprises(apart, cad, LIMITS).pixels, strict=True))
    assert lost < 0.02 * sum(s.depth.size for s in seen)


def test_a_shelf_that_stands_higher_hides_its_place_and_is_no_foreign_object() -> None:
    """No view looks through its place; the session's solution finds it 40 mm off."""
    shelf = Part("shelf", *box((0.3, 0.5, 0.02), (0.1, 0.0, 0.1)))
    raised = Part("shelf", shelf.vertices + np.array([0.0, 0.0, 0.04]), shelf.faces)
    real, cad = scene(PLATE, raised), scene(PLATE, shelf)
    above = views(real, cad)
    assert find_surprises(above, cad, LIMITS).foreign != ()
    solved = [replace(s, apart=np.where(s.part == 1, np.float32(0.043), np.float32(0.0))) for s in above]
    found = find_surprises(solved, cad, LIMITS)
    assert found.foreign == ()
    assert any((codes == DISPLACED).any() for codes in found.pixels)
    crate = views(scene(PLATE, shelf, Part("crate", *box((0.1, 0.14, 0.12), (0.1, 0.05, 0.17)))), cad)
    assert len(find_surprises([replace(s, apart=t.apart) for s, t in zip(crate, solved, strict=True)], cad, LIMITS).foreign) == 1


def test_a_large_part_that_is_turned_is_no_foreign_object_and_states_no_bias() -> None:
    """A table fills its bins of range; the session's solution finds it 18 mm off, less than an object stands out."""
    table = Part("table", *box((0.9, 0.8, 0.1), (0.0, 0.0, 0.2)))
    turned = Part(
        "table", table.vertices + np.array([0.0, 0.0, 0.03]) + 0.04 * table.vertices[:, :1] * np.array([0.0, 0.0, 1.0]), table.faces
    )
    real, cad = scene(PLATE, turned), scene(PLATE, table)
    seen = views(real, cad)
    solved = [replace(s, apart=np.where(s.part == 1, np.float32(0.018), np.float32(0.0))) for s in seen]
    off = [w & np.isfinite(s.depth) for w, s in zip(wrong(seen, real), seen, strict=True)]

    def kept(views: list[Seen]) -> float:
        codes = find_surprises(views, cad, LIMITS).pixels
        return sum(int((w & (p == NONE)).sum()) for w, p in zip(off, codes, strict=True)) / sum(int(w.sum()) for w in off)

    assert kept(seen) > 0.5, "its error is taken for the camera's"
    assert kept(solved) < 0.02
    assert find_surprises(solved, cad, LIMITS).foreign == ()


def test_the_sides_of_an_object_that_one_view_alone_faces_are_the_objects() -> None:
    real, cad = scene(PLATE, Part("crate", *box((0.3, 0.3, 0.3), (0.0, 0.0, 0.15)))), scene(PLATE)
    found = find_surprises(views(real, cad), cad, LIMITS)
    (crate,) = found.foreign
    assert not crate.moves
    np.testing.assert_allclose(crate.size_m, [0.3, 0.3, 0.3], atol=0.04)


def test_an_object_that_stood_there_for_some_views_is_one() -> None:
    """Two views show a crate that the other four see through."""
    real, cad = scene(PLATE, BLOCK, CRATE), scene(PLATE, BLOCK)
    seen = [*views(real, cad)[:2], *views(cad, cad)[2:]]
    found = find_surprises(seen, cad, LIMITS)
    (crate,) = found.foreign
    assert (crate.moves, crate.views) == (True, (0, 1))
    np.testing.assert_allclose(crate.centre_m[:2], [-0.15, 0.05], atol=0.03)
    assert "seen in views 1, 2 and in no other view" in lines(described(found, cad.scene))[0]


def test_pixels_of_an_object_that_one_view_measures_wrong_are_no_moving_object() -> None:
    """Every third pixel of a chest is 40 mm too near in one view: other views see through their place, and yet they lie among the chest's."""
    real, cad = scene(PLATE, Part("chest", *box((0.3, 0.3, 0.15), (0.0, 0.0, 0.075)))), scene(PLATE)
    seen = views(real, cad)
    of_chest = np.flatnonzero(seen[0].cad - seen[0].depth > 0.02)
    assert len(of_chest) > 400
    seen[0].depth.ravel()[of_chest[::3]] -= 0.04
    (chest,) = find_surprises(seen, cad, LIMITS).foreign
    assert not chest.moves
    np.testing.assert_allclose(chest.centre_m, [0.0, 0.0, 0.075], atol=0.03)


def test_a_hand_beside_an_object_moves_and_is_not_the_object() -> None:
    cad = scene(PLATE, BLOCK)
    hand = Part("hand", *box((0.16, 0.1, 0.1), (-0.16, -0.1, 0.2)))
    seen = [views(scene(PLATE, BLOCK, CRATE, hand), cad)[0], *views(scene(PLATE, BLOCK, CRATE), cad)[1:]]
    found = sorted(find_surprises(seen, cad, LIMITS).foreign, key=lambda f: f.moves)
    assert [f.moves for f in found] == [False, True]
    np.testing.assert_allclose(found[0].centre_m, [-0.15, 0.05, 0.06], atol=0.015)
    assert found[1].centre_m[2] > 0.15


@pytest.mark.parametrize(("away_m", "through", "joined"), [(0.09, 0.0, True), (0.2, 0.0, False), (0.09, 0.5, False)])
def test_a_far_side_that_one_view_alone_faces_is_at_most_half_the_objects_size_away(away_m: float, through: float, joined: bool) -> None:  # noqa: FBT001
    """The front of a box, 20 x 10 cm, seen by two views, and a piece of its side behind: nearer than half of the 22 cm diagonal."""
    front = np.stack(np.meshgrid([0.0], np.linspace(-0.1, 0.1, 21), np.linspace(0, 0.1, 11), indexing="ij"), -1).reshape(-1, 3)
    side = np.array([-away_m, 0.0, 0.05]) + np.stack(np.meshgrid(*[np.linspace(-0.005, 0.005, 4)] * 3), -1).reshape(-1, 3)
    points, of_side = np.concatenate([front, side]), np.arange(len(front) + len(side)) >= len(front)
    view, pixel = np.where(of_side, 2, np.arange(len(points)) % 2), np.stack([np.arange(len(points)), 9 * of_side], 1)
    seen_through = of_side & (np.arange(len(points)) % 2 < 2 * through)
    cloud = _Cloud(points, view, pixel, np.full(len(points), 0.1), ~of_side, seen_through, np.ones(3, int))
    whole, left = _joined(cloud, [np.flatnonzero(~of_side)], [np.flatnonzero(of_side)], 0.05, LIMITS.rim_px)
    assert (len(whole), len(left)) == ((1, 0) if joined else (1, 1))
    assert len(whole[0]) == (len(points) if joined else len(front))
