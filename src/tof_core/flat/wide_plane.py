# SPDX-License-Identifier: Apache-2.0
"""Whether an image holds z or radial distance, from planes in separate pieces, such as a table on both sides of a box.

A plane's inverse z is linear in the normalised image coordinates (x, y). Under the right assumption
a wide flat surface fits one plane; under the wrong one its depth is off by the length L of the ray,
and only pieces of it fit a plane. Under each assumption, the plane is searched whose inliers would
bend most under the other, and the two are compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Mask
    from tof_core.camera import Camera

TOLERANCES = (0.005, 0.01, 0.015)
"""Relative distances from the plane within which a pixel is an inlier; the results are averaged."""
PIXELS = 6000
"""Most pixels used."""
TRIES = 600
"""Candidate planes through three pixels each; the KEPT with most inliers are refined."""
KEPT = 40
FEWEST = 60
"""Least number of inliers of a plane."""
CLEAR = 1.25
"""Least ratio of the summed squared bend of the two assumptions."""
LEAST_BEND = 8e-3
"""Least RMS bend of the plane under the other assumption, metres; with less, any dome counts as a plane."""


@dataclass(frozen=True, slots=True)
class Bend:
    """Bend of the widest plane under the rejected assumption: RMS in metres; share of the valid pixels on the plane."""

    radial: bool
    metres: float
    share: float


@dataclass(frozen=True, slots=True, eq=False)
class _Pixels:
    """plane (n, 3): 1, x, y; log_length (n,) of the ray's length; depth (n,) as stored."""

    plane: Float
    log_length: Float
    depth: Float


@dataclass(frozen=True, slots=True)
class _Widest:
    """Best plane of one assumption: summed squared relative bend, inliers, RMS bend in metres."""

    total: float = 0.0
    pixels: int = 0
    bend: float = 0.0


def wide_bend(depth: Image, camera: Camera) -> Bend | None:
    """The assumption that the widest planes in depth (H, W), metres, support; None where they support neither."""
    pixels = _sample(depth, camera)
    if len(pixels.depth) < FEWEST:
        return None
    as_z = [_widest(pixels, pixels.depth, t) for t in TOLERANCES]
    as_radial = [_widest(pixels, pixels.depth * np.exp(-pixels.log_length), t) for t in TOLERANCES]
    if not all(w.total > 0 for w in (*as_z, *as_radial)):
        return None
    ratio = float(np.exp(np.mean([np.log(r.total / z.total) for r, z in zip(as_radial, as_z, strict=True)])))
    best = as_radial[1] if ratio > 1 else as_z[1]
    if max(ratio, 1 / ratio) < CLEAR or best.bend < LEAST_BEND:
        return None
    return Bend(ratio > 1, best.bend, best.pixels / len(pixels.depth))


def _sample(depth: Image, camera: Camera) -> _Pixels:
    """Valid pixels evenly through the image, PIXELS at most."""
    v, u = np.nonzero(np.isfinite(depth) & np.isfinite(camera.ray_length()))
    some = np.linspace(0, len(v) - 1, min(len(v), PIXELS)).astype(int)
    v, u = v[some], u[some]
    return _Pixels(camera.rays()[v, u][:, [2, 0, 1]], np.log(camera.ray_length()[v, u]), depth[v, u].astype(float))


def _widest(pixels: _Pixels, z: Float, tolerance: float) -> _Widest:
    """The plane under one assumption with the largest bend under the other."""
    rng = np.random.default_rng(0)
    A = pixels.plane * z[:, None]  # a plane n is A @ n = 1, relative distances from it A @ n - 1
    three = A[rng.integers(len(z), size=(TRIES, 3))]
    three = three[np.abs(np.linalg.det(three)) > 1e-9]
    few = A[rng.choice(len(z), min(len(z), 1500), replace=False)]
    planes = np.linalg.solve(three, np.ones((len(three), 3, 1)))[..., 0]
    support = (np.abs(few @ planes.T - 1.0) < tolerance).sum(axis=0)
    best = _Widest()
    for plane in planes[np.argsort(-support, kind="stable")[:KEPT]]:
        inlier = _refined(A, plane, tolerance)
        if inlier.sum() >= FEWEST:
            best = max(best, _bend(pixels, z, inlier), key=lambda w: w.total)
    return best


def _refined(A: Float, plane: Float, tolerance: float, rounds: int = 5) -> Mask:
    inlier = np.abs(A @ plane - 1.0) < tolerance
    for _ in range(rounds):
        if inlier.sum() < FEWEST:
            break
        plane = np.asarray(np.linalg.lstsq(A[inlier], np.ones(int(inlier.sum())), rcond=None)[0], float)
        inlier = np.abs(A @ plane - 1.0) < tolerance
    return np.asarray(inlier)


def _bend(pixels: _Pixels, z: Float, inlier: Mask) -> _Widest:
    """Bend of the inliers: the residual of log L after the best plane is removed."""
    length, A = pixels.log_length[inlier], pixels.plane[inlier] * z[inlier, None]
    rest = length - A @ np.linalg.lstsq(A, length, rcond=None)[0]
    return _Widest(float(rest @ rest), int(inlier.sum()), float(np.sqrt(np.mean((rest * z[inlier]) ** 2))))
