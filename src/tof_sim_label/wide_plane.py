# SPDX-License-Identifier: Apache-2.0
"""A second opinion on z or radial, from planes that lie in pieces: a table to both sides of a box.

A plane's inverse z is linear in the normalised image coordinates (x, y). Read the right way, a wide
flat surface holds together as one plane; read the wrong way, its depth is off by the length L of the
ray and only pieces of it fit one. So under each reading the plane is sought whose inliers would bend
most if the other reading were true, and the two are compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Mask
    from tof_core.camera import Camera

TOLERANCES = (0.005, 0.01, 0.015)
"""Relative distances from the plane within which a pixel is on it; the answers are averaged."""
PIXELS = 6000
"""Pixels looked at."""
TRIES = 600
"""Planes through three pixels that are tried; the KEPT with most support are refined."""
KEPT = 40
FEWEST = 60
"""Pixels that make a plane."""
CLEAR = 1.25
"""One reading's planes must say so many times more than the other's."""
LEAST_BEND = 8e-3
"""Metres (RMS) by which the plane must bend under the other reading: less, and any dome is a plane."""


@dataclass(frozen=True, slots=True)
class Bend:
    """How far the widest plane of the better reading bends under the other: RMS in metres; share of the valid pixels on it."""

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
    """Of one reading's best plane: summed squared relative bend, pixels, RMS bend in metres."""

    total: float = 0.0
    pixels: int = 0
    bend: float = 0.0


def wide_bend(depth: Image, camera: Camera) -> Bend | None:
    """Which reading of depth (H, W) metres the widest planes speak for; None where they do not."""
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
    """The plane of one reading whose inliers say most about the other."""
    rng = np.random.default_rng(0)
    A = pixels.plane * z[:, None]  # a plane n is A @ n = 1, relative distances from it A @ n - 1
    three = A[rng.integers(len(z), size=(TRIES, 3))]
    three = three[np.abs(np.linalg.det(three)) > 1e-9]
    few = A[rng.choice(len(z), min(len(z), 1500), replace=False)]
    planes = np.linalg.solve(three, np.ones((len(three), 3, 1)))[..., 0]
    support = (np.abs(few @ planes.T - 1.0) < tolerance).sum(axis=0)
    best = _Widest()
    for plane in planes[np.argsort(-support)[:KEPT]]:
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
    """What remains of log L on these pixels once the best plane has taken its part."""
    length, A = pixels.log_length[inlier], pixels.plane[inlier] * z[inlier, None]
    rest = length - A @ np.linalg.lstsq(A, length, rcond=None)[0]
    return _Widest(float(rest @ rest), int(inlier.sum()), float(np.sqrt(np.mean((rest * z[inlier]) ** 2))))
