# SPDX-License-Identifier: Apache-2.0
"""Surfaces around a view, and whether the columns of a basis describe those that a view sees."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tests.tof_align.made import CONFIG, at, look, panel, section, session
from tof_align.causal_fit import basis_around, is_new
from tof_align.linearise import Linearised, linearise
from tof_align.pixels import take_pixels
from tof_align.surroundings import described, surroundings
from tof_core import se3

if TYPE_CHECKING:
    from tof_scene.raycast import Raycaster


def seen(caster: Raycaster, number: int = 0) -> Linearised:
    """A view of the section at its true pose."""
    views, truth = session(section(), views=number + 1, stations=1)
    live = take_pixels(views[number], CONFIG.weights, pixels=CONFIG.weights.live_pixels)
    return linearise(live, truth[number].T_cell_camera, caster, CONFIG.weights)


def test_the_surroundings_are_the_surfaces_that_face_places_around_the_middle() -> None:
    view = seen(section())
    around = surroundings(view, section())
    assert set(np.unique(around.part)) >= set(np.unique(view.part))
    bracket = next(k for k, part in enumerate(section().scene.parts) if part.name == "bracket")
    both_sides = around.normal[around.part == bracket][:, 1]
    assert both_sides.min() < -0.5
    assert both_sides.max() > 0.5  # one view sees one of the two faces
    np.testing.assert_allclose(np.linalg.norm(around.normal, axis=1), 1.0, atol=1e-5)


def test_the_chosen_columns_describe_the_view_and_its_neighbours() -> None:
    basis = basis_around(seen(section()), section(), CONFIG)
    for number in (0, 3, 5):
        assert described(basis, seen(section(), number)).mean() > 0.9
        assert not is_new(basis, seen(section(), number))


def test_a_view_of_other_parts_is_new_and_its_columns_keep_those_of_the_camera() -> None:
    far = at(0.0, 3.0, 0.0)
    view = seen(section())
    basis = basis_around(view, section(), CONFIG)
    there = Linearised(**{name: getattr(view, name) for name in Linearised.__dataclass_fields__} | {"point": se3.apply(far, view.point)})
    assert is_new(basis, there)
    again = basis_around(there, section(), CONFIG, basis)
    np.testing.assert_array_equal(again.knots_range, basis.knots_range)
    np.testing.assert_array_equal(again.root_amplitude, basis.root_amplitude)
    assert not np.array_equal(again.centres, basis.centres)


def test_a_scene_of_one_part_has_surfaces_and_no_motion_of_parts() -> None:
    T = look(np.array([0.9, 0.0, 0.8]), np.array([0.0, 0.0, 0.8]))
    views, _ = session(section(), views=1, stations=1)
    view = linearise(take_pixels(views[0], CONFIG.weights), T, panel(), CONFIG.weights)
    assert len(view.residual) > 100
    basis = basis_around(view, panel(), CONFIG)
    assert not len(basis.parts.index)
    assert not is_new(basis, view)
