# SPDX-License-Identifier: Apache-2.0
"""Label sigma against many draws of the pose, on a step whose depth is known by formula."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core import se3
from tof_core.camera import Camera
from tof_scene.render import Rendering
from tof_sim_label.config import LabelConfig
from tof_sim_label.sigma import _image_sigma, label_sigma

if TYPE_CHECKING:
    from tof_core.arrays import Float

CAMERA = Camera(width=60, height=40, fx=120.0, fy=120.0, cx=29.05, cy=19.5)
NOTHING_ELSE = LabelConfig(cad_sigma_mm=0.0, unseen_offset_mm=0.0, edge_px=0.0)
NEAR = np.array([np.sin(0.3), 0.0, -np.cos(0.3)])
"""Normal of the near plane through (0, 0, 0.8) that fills x < 0; the far one is 0.1 m behind, upright."""
POSE = np.diag([0.4e-3, 0.4e-3, 0.8e-3, 0.5e-3, 0.5e-3, 0.5e-3]) ** 2
"""Independent errors; signs do not show in what follows from them."""


def coupled(sign: float) -> Float:
    """Covariance (6, 6) of a pose whose turns go with its slides, as they do where a pose is solved: correlation 0.9."""
    root = np.zeros((6, 6))
    root[[0, 1, 2], [0, 1, 2]] = 0.4e-3, 0.4e-3, 0.5e-3
    root[[3, 4, 5], [2, 2, 0]] = 2e-3 * sign, 3e-3 * sign, -1e-3 * sign
    root[[3, 4, 5], [3, 4, 5]] = 0.2e-3
    return root @ root.T


COVARIANCES = {"independent": POSE, "coupled": coupled(1.0), "coupled the other way": coupled(-1.0)}


def step(T: Float, fine: int = 12) -> Rendering:
    """The step seen from T, with `fine` x `fine` rays a pixel: as a renderer would compute it."""
    camera = CAMERA.scaled(fine)
    rays, origin = camera.rays() @ T[:3, :3].T, T[:3, 3]
    near = (NEAR @ (np.array([0.0, 0.0, 0.8]) - origin)) / (rays @ NEAR)
    edge_x = (origin + near[..., None] * rays)[..., 0]
    far = (0.9 - origin[2]) / rays[..., 2]
    on_near = edge_x < 0.0
    h, w = CAMERA.shape
    share = on_near.reshape(h, fine, w, fine).mean(axis=(1, 3))
    centre = np.index_exp[fine // 2 :: fine, fine // 2 :: fine]
    first = share >= 0.5
    depth = np.where(first, near[centre], far[centre])
    second = np.where((share > 0) & (share < 1), np.where(first, far[centre], near[centre]), np.nan)
    normal = np.where(first[..., None], NEAR @ T[:3, :3], np.array([0.0, 0.0, -1.0]) @ T[:3, :3])
    none = np.zeros(CAMERA.shape, np.float32)
    return Rendering(
        CAMERA,
        T,
        depth=depth.astype(np.float32),
        normal=normal.astype(np.float32),
        second=second.astype(np.float32),
        mixed=np.minimum(share, 1 - share).astype(np.float32),
        part=none.astype(np.int16),
        face=none.astype(np.int32),
        incidence=none,
        albedo=none,
    )


def drawn(cov: Float) -> Float:
    """(n, H, W) label errors of 300 poses drawn from a covariance."""
    rng = np.random.default_rng(2)
    true = step(np.eye(4)).depth
    draws = rng.multivariate_normal(np.zeros(6), cov, 300)
    return np.stack([step(se3.exp(xi)).depth - true for xi in draws])


@pytest.fixture(scope="module")
def errors() -> Float:
    """Label errors by `POSE`."""
    return drawn(POSE)


@pytest.mark.parametrize("name", COVARIANCES)
def test_on_a_surface_sigma_is_the_standard_deviation_of_the_label(name: str) -> None:
    cov = COVARIANCES[name]
    sigma = label_sigma(step(np.eye(4)), cov, NOTHING_ELSE)
    inside = np.ones(CAMERA.shape, bool)
    inside[:, 26:34] = False
    ratio = sigma[inside] / drawn(cov).std(axis=0)[inside]
    assert 0.93 < np.median(ratio) < 1.07
    assert ratio.min() > 0.8
    assert ratio.max() < 1.25


def test_what_goes_with_what_changes_the_labels_sigma() -> None:
    """Else the test above could not tell the sign of a turn."""
    one, other = (label_sigma(step(np.eye(4)), coupled(sign), NOTHING_ELSE)[20, 40] for sign in (1.0, -1.0))
    assert max(one, other) > 1.2 * min(one, other)


@pytest.mark.parametrize("name", COVARIANCES)
def test_an_image_point_moves_by_as_many_pixels_as_is_said(name: str) -> None:
    cov, rng = COVARIANCES[name], np.random.default_rng(4)
    draws = rng.multivariate_normal(np.zeros(6), cov, 4000)
    for v, u in ((3, 5), (30, 50), (20, 2)):
        r, z = CAMERA.rays()[v, u], 0.9
        seen = np.stack([se3.inverse(se3.exp(xi)) @ [*(z * r), 1.0] for xi in draws])[:, :3]
        du, dv = (f * (seen[:, i] / seen[:, 2] - r[i]) for i, f in ((0, CAMERA.fx), (1, CAMERA.fy)))
        said = _image_sigma(r, z, np.linalg.cholesky(cov), np.array([CAMERA.fx, CAMERA.fy]), 0.0)
        assert said == pytest.approx(np.sqrt(0.5 * (du.var() + dv.var())), rel=0.05)


def test_at_a_silhouette_sigma_covers_the_step_it_may_take(errors: Float) -> None:
    sigma = label_sigma(step(np.eye(4)), POSE, NOTHING_ELSE)
    edge = np.index_exp[:, 27:33]
    flips = np.abs(errors).max(axis=0)[edge] > 0.05
    assert flips.any(), "the draws do move the silhouette over pixel centres"
    within = (np.abs(errors) <= 2 * sigma)[(slice(None), *edge)].mean()
    assert within > 0.93
    assert (sigma[edge][flips] > 5e-3).mean() > 0.9, "where it may flip, sigma says so"


def test_far_from_any_silhouette_the_step_costs_nothing() -> None:
    seen = step(np.eye(4))
    cut = replace(seen, depth=np.where(np.arange(60) < 24, seen.depth, np.nan).astype(np.float32))
    both, alone = label_sigma(seen, POSE, NOTHING_ELSE), label_sigma(cut, POSE, NOTHING_ELSE)
    np.testing.assert_allclose(both[:, :20], alone[:, :20], rtol=1e-6)


def test_the_offset_no_session_sees_is_in_every_label() -> None:
    seen = step(np.eye(4))
    none = np.zeros((6, 6))
    sigma = label_sigma(seen, none, LabelConfig(cad_sigma_mm=0.0, unseen_offset_mm=5.0, edge_px=0.0))
    np.testing.assert_allclose(sigma * CAMERA.ray_length(), 5e-3, rtol=1e-3, atol=1e-6)


def test_a_cads_tolerance_counts_along_the_ray() -> None:
    seen = step(np.eye(4))
    sigma = label_sigma(seen, np.zeros((6, 6)), LabelConfig(cad_sigma_mm=0.2, unseen_offset_mm=0.0, edge_px=0.0))
    slope = np.abs((seen.normal * CAMERA.rays()).sum(axis=-1))
    np.testing.assert_allclose(sigma[:, :25], (0.2e-3 / slope)[:, :25], rtol=1e-4)


def test_missed_rays_have_no_sigma() -> None:
    seen = step(np.eye(4))
    seen.depth[3, 4] = np.nan
    sigma = label_sigma(seen, POSE, NOTHING_ELSE)
    assert np.isnan(sigma[3, 4])
    assert np.isfinite(sigma).sum() == sigma.size - 1
