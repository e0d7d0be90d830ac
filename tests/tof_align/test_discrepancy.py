# SPDX-License-Identifier: Apache-2.0
"""Columns of what nobody modelled: what they can say, and with which prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.expanded import local_columns, shared_columns
from tests.tof_align.made import CONFIG, one_view, section
from tof_align.config import DiscrepancyConfig
from tof_align.discrepancy import (
    CHORD_45,
    FACE_LENGTHS,
    LOCAL,
    SHARED,
    basis_of,
    farthest_points,
    inflation,
    shared_inflation,
    surface_columns,
)
from tof_align.limits import SharedLimits
from tof_align.linearise import Linearised, linearise
from tof_align.pixels import take_pixels
from tof_align.view_columns import columns_of

D = DiscrepancyConfig()


@pytest.fixture(scope="module")
def lin() -> Linearised:
    view, truth = one_view(section(), np.zeros(6))
    return linearise(take_pixels(view, CONFIG.weights), truth.T_cell_camera, section(), CONFIG.weights)


def part(columns: np.ndarray, sizes: tuple[int, ...], kind: int) -> np.ndarray:
    ends = np.cumsum((0, *sizes))
    return columns[:, ends[kind] : ends[kind + 1]]


def left_over(columns: np.ndarray, y: np.ndarray) -> float:
    """Share of the variance of y that columns and a constant cannot say."""
    A = np.column_stack([columns, np.ones(len(y))])
    return float(np.var(y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) / np.var(y))


def test_wiggling_is_said_by_range_and_amplitude_bias_by_amplitude(lin: Linearised) -> None:
    basis = basis_of([lin], D)
    columns = shared_columns(basis, lin)
    reach = lin.depth * lin.ray_length
    wave = 3e-3 * np.sin(2 * np.pi * reach / 0.375)
    assert left_over(part(columns, basis.shared, SHARED.index("range")), wave) < 0.002
    assert lin.log_amplitude is not None
    assert left_over(part(columns, basis.shared, SHARED.index("amplitude")), lin.log_amplitude) < 1e-3
    assert left_over(part(columns, basis.shared, SHARED.index("amplitude")), np.sin(40 * lin.point[:, 1])) > 0.5


def test_the_covariance_with_the_surface_holds_to_a_millionth_in_single_precision(lin: Linearised) -> None:
    """Half of it decays within a correlation length of place and normal, half within five of place."""
    basis = basis_of([lin], D)
    centres, places = basis.centres, np.concatenate([lin.point / basis.object_m, lin.normal / CHORD_45], axis=1)
    apart = places[:, None] - centres[None]
    place, facing = (apart[..., :3] ** 2).sum(2), (apart[..., 3:] ** 2).sum(2)
    exact = 0.5 * np.exp(-np.sqrt(place + facing)) + 0.5 * np.exp(-np.sqrt(place / FACE_LENGTHS**2 + facing))
    np.testing.assert_allclose(surface_columns(basis, lin), exact, rtol=0, atol=1e-6)
    assert exact.max() > 0.9


def test_a_coefficient_of_one_means_one_metre_rms(lin: Linearised) -> None:
    basis = basis_of([lin], D)
    columns = shared_columns(basis, lin)
    for kind in ("range", "amplitude", "object"):
        variance = (part(columns, basis.shared, SHARED.index(kind)) ** 2).sum(axis=1)
        assert 0.4 < np.median(variance) < 1.1, kind
    assert (part(local_columns(basis, lin), basis.local, LOCAL.index("offset")) == 1.0).all()


def test_values_all_alike_still_make_columns(lin: Linearised) -> None:
    few = {
        name: getattr(lin, name)[:1].repeat(2, axis=0)
        for name in ("residual", "depth", "ray", "point", "normal", "part", "cell", "log_amplitude")
    }
    alike = replace(lin, **few)
    columns = shared_columns(basis_of([alike], D), alike)
    assert np.isfinite(columns).all()
    np.testing.assert_array_equal(columns[0], columns[1])


def test_every_views_columns_follow_one_basis(lin: Linearised) -> None:
    basis = basis_of([lin], D)
    half = replace(
        lin, depth=lin.depth[::2], ray=lin.ray[::2], point=lin.point[::2], normal=lin.normal[::2], cell=lin.cell[::2],
        residual=lin.residual[::2], part=lin.part[::2], log_amplitude=None if lin.log_amplitude is None else lin.log_amplitude[::2],
    )  # fmt: skip
    np.testing.assert_allclose(shared_columns(basis, half), shared_columns(basis, lin)[::2], atol=1e-12)
    np.testing.assert_allclose(local_columns(basis, half), local_columns(basis, lin)[::2], atol=1e-12)


def test_switched_off_there_are_no_columns(lin: Linearised) -> None:
    basis = basis_of([lin], DiscrepancyConfig(enabled=False))
    assert shared_columns(basis, lin).shape == (len(lin.residual), 0)
    assert local_columns(basis, lin).shape == (len(lin.residual), 0)


def test_a_view_without_amplitude_has_no_amplitude_columns(lin: Linearised) -> None:
    basis = basis_of([replace(lin, log_amplitude=None)], D)
    assert basis.shared[SHARED.index("amplitude")] == 0


def test_farthest_points_cover_a_square_from_corner_to_corner() -> None:
    points = np.random.default_rng(0).uniform(size=(4000, 2))
    chosen = farthest_points(points, 16)
    far = np.linalg.norm(points[:, None] - chosen[None], axis=-1).min(axis=1)
    assert far.max() < 0.27


def test_white_noise_does_not_inflate_and_neighbours_that_err_together_do(lin: Linearised) -> None:
    rng = np.random.default_rng(0)
    n = len(lin.residual)
    weight = np.full(n, 1e6)
    assert inflation(lin, 1e-3 * rng.normal(size=n), weight, SharedLimits()) == pytest.approx(1.0, abs=0.25)
    assert inflation(lin, 3e-3 * rng.normal(size=n), weight, SharedLimits()) == pytest.approx(9.0, rel=0.25)
    y, x = np.divmod(lin.cell, lin.raster[1])
    together = 1e-3 * rng.normal(size=(40, 40))[y // 4, x // 4]
    assert inflation(lin, together, weight, SharedLimits()) > 6.0


def test_more_centres_describe_more_of_what_sticks_to_the_surface(lin: Linearised) -> None:
    few, many = (columns_of(lin, basis_of([lin], d)).beyond({"object": 2e-3}, SharedLimits()) for d in (D, replace(D, centres=200)))
    assert (many**2).mean() < 0.6 * (few**2).mean()


def test_white_noise_is_not_inflated_and_what_neighbours_share_counts_once() -> None:
    assert shared_inflation(980.0, 1000.0, 30.0) == 1.0
    assert shared_inflation(1000.0, 1000.0, 30.0) == 1.0
    assert shared_inflation(1100.0, 1000.0, 30.0) == pytest.approx(4.0)
