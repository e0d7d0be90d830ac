# SPDX-License-Identifier: Apache-2.0
"""Change of lighting between two images of one scene, from the surfaces that both see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import robust_stds

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_inspect.config import ColourConfig
    from tof_inspect.picture import Picture
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Current minus reference tones as a function of the surface normal: terms (4, 3), coefficients of 1 and of the unit normal in the cell.

    sigma (3,): measured standard deviation of the residual (cast shadows, lamps at finite distance, gloss).
    """

    terms: Float
    sigma: Float

    def change(self, normals: Float) -> Float:
        """Changes of the tones (n, 3) for normals (n, 3)."""
        return np.asarray(_basis(normals) @ self.terms)


def fit_light(caster: Raycaster, then: Picture, now: Picture, fixed: Mask, config: ColourConfig) -> Light | None:
    """Fit by least absolute deviations to a raster of pixels on `fixed` parts; None where too few are visible in both images."""
    step = max(1, int(np.sqrt(now.camera.width * now.camera.height / config.light_pixels)))
    rows, cols = (a.ravel() for a in np.mgrid[step // 2 : now.camera.height : step, step // 2 : now.camera.width : step])
    hits, points = now.look(caster, rows, cols)
    use = np.flatnonzero((hits.part >= 0) & fixed[hits.part])
    change = now.tones[rows[use], cols[use]] - then.recall(caster, points[use])
    known = np.isfinite(change).all(axis=1)
    if int(known.sum()) < config.light_pixels // 50:
        return None
    X, y = _basis(hits.normal[use[known]]), change[known]
    terms = np.zeros((4, 3))
    for k in range(3):
        terms[:, k] = _least_absolute(X, y[:, k])
    return Light(terms, np.maximum(robust_stds(y - X @ terms, 0.0), config.floors))


def _basis(normals: Float) -> Float:
    return np.concatenate([np.ones((len(normals), 1)), normals], axis=1)


def _least_absolute(X: Float, y: Float, rounds: int = 12, least: float = 0.02) -> Float:
    """Iteratively reweighted least squares; the coefficients of the normal are slightly damped."""
    weight = np.ones(len(y))
    terms = np.zeros(X.shape[1])
    for _ in range(rounds):
        H = (X * weight[:, None]).T @ X + 1e-3 * weight.sum() * np.diag([0.0, 1, 1, 1])
        terms = np.linalg.solve(H, X.T @ (weight * y))
        weight = 1.0 / np.maximum(np.abs(y - X @ terms), least)
    return terms
