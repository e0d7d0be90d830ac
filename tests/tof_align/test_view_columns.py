# SPDX-License-Identifier: Apache-2.0
"""Products of a view's columns are those of the columns written out."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.tof_align.expanded import local_columns, shared_columns
from tests.tof_align.made import CONFIG, one_view, section
from tof_align.bounced import light_in
from tof_align.config import DiscrepancyConfig
from tof_align.discrepancy import LOCAL, SHARED, Basis, basis_of
from tof_align.lens import lens_columns
from tof_align.limits import SharedLimits
from tof_align.linearise import Linearised, linearise
from tof_align.pixels import take_pixels
from tof_align.view_columns import columns_of

RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def lin() -> Linearised:
    view, truth = one_view(section(), np.zeros(6))
    pixels = take_pixels(view, CONFIG.weights)
    bare = linearise(pixels, truth.T_cell_camera, section(), CONFIG.weights)
    return replace(bare, bounced=light_in(bare, pixels, section()).over(bare, pixels), lens=lens_columns(bare, view.camera))


@pytest.fixture(scope="module")
def basis(lin: Linearised) -> Basis:
    return basis_of([lin], DiscrepancyConfig())


def test_every_kind_is_there(basis: Basis) -> None:
    assert all(count > 0 for count in (*basis.shared, *basis.local))


def test_gram_is_that_of_the_columns_written_out(lin: Linearised, basis: Basis) -> None:
    extra, weight = RNG.normal(size=(len(lin.residual), 3)), RNG.uniform(0, 1e6, len(lin.residual))
    weight[::5] = 0.0
    blocks = [lin.jacobian, shared_columns(basis, lin), extra, local_columns(basis, lin), lin.residual[:, None]]
    D = np.concatenate(blocks, axis=1) * np.sqrt(weight)[:, None]
    gram = columns_of(lin, basis, extra).gram(weight)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-12))
    np.testing.assert_allclose(gram / size[:, None] / size, (D.T @ D) / size[:, None] / size, atol=1e-9)


def test_without_a_basis_there_are_camera_extra_and_residual(lin: Linearised) -> None:
    extra, weight = RNG.normal(size=(len(lin.residual), 2)), np.full(len(lin.residual), 1e6)
    D = np.concatenate([lin.jacobian, extra, lin.residual[:, None]], axis=1) * 1e3
    np.testing.assert_allclose(columns_of(lin, None, extra).gram(weight), D.T @ D, rtol=1e-10, atol=1e-6)


def test_what_each_kind_explains_is_its_columns_times_their_coefficients(lin: Linearised, basis: Basis) -> None:
    x, own = RNG.normal(size=sum(basis.shared)), RNG.normal(size=sum(basis.local))
    found = columns_of(lin, basis).unmodelled(x, own)
    assert found.shape == (len(lin.residual), len(SHARED) + len(LOCAL))
    for columns, coefficients, sizes, first in (
        (shared_columns(basis, lin), x, basis.shared, 0),
        (local_columns(basis, lin), own, basis.local, len(SHARED)),
    ):
        ends = np.cumsum((0, *sizes))
        for k, (a, b) in enumerate(pairwise(ends)):
            np.testing.assert_allclose(found[:, first + k], columns[:, a:b] @ coefficients[a:b], atol=1e-9)


def test_what_the_columns_cannot_describe_is_the_rest_of_the_process(lin: Linearised, basis: Basis) -> None:
    start = sum(basis.shared[: SHARED.index("object")])
    described = shared_columns(basis, lin)[:, start : start + basis.shared[SHARED.index("object")]]
    rest = columns_of(lin, basis).beyond({"object": 2e-3}, SharedLimits())
    np.testing.assert_allclose((4e-6 * described**2).sum(axis=1) + rest**2, 4e-6, rtol=1e-6)
    assert (columns_of(lin, basis).beyond({}, SharedLimits()) == 0.0).all()
