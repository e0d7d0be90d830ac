# SPDX-License-Identifier: Apache-2.0
"""The map by which a driver rectified: where each pixel lies in the sensor's image, before it is rounded to the nearest pixel there.

Rounding moves a ray by the sawtooth of that place. The map is smooth and has few parameters, so that all pixels together know it to
hundredths of a pixel, where each pixel by itself knows its shift to some tenths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from tof_core.camera import distort, distortion_jacobian

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Mask
    from tof_core.camera import Camera

PARAMETERS = 5
"""Focal length over the stated one, k1, k2, p1, p2 of the lens (plumb_bob)."""
FIRST_PX, WIDER = 45.0, 1.5
"""Radius of the disc about the axis in which the map is searched first, and the ratio of each next one's: over 45 px the lens is two numbers."""
SCALES, CURVATURES = (0.85, 1.15), (-0.5, 0.03)
"""Focal lengths over the stated one, and k1, that are tried: drivers keep the focal length to 15 %. A lens with positive k1 is found as the
mirrored sawtooth of one with negative k1."""
STEP_TURNS = 0.2
"""Turns of the sawtooth at the first disc's rim between two values that are tried."""
KEPT = 12, 6
"""Best maps that are refined in the first disc, and in each wider one."""
ALIKE = (0.003, 0.03)
"""Differences of the focal length and of k1 up to which two maps of a disc are one."""
SIMPLEX = (0.002, 0.02, 0.05, 0.003, 0.003)
"""First steps of the parameters by which a map is refined."""
OFFSETS = np.arange(0.0, 1.0, 0.05)
"""Fractions of a pixel of the principal point that are tried."""
SMOOTH_POWER = 3
"""Degree of the smooth shift that is taken out before: another lens than stated, or another mount."""


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """Normal equations of the shift of each pixel, along x and y: weights times products of slopes, and of slopes and error.

    Each array has the shape of the pixels, (H, W) or (n,).
    """

    xx: Float
    xy: Float
    yy: Float
    xe: Float
    ye: Float

    def each(self, of: Callable[[Float], Float]) -> Sums:
        """The sums with `of` applied to each of them."""
        return Sums(*(of(s) for s in (self.xx, self.xy, self.yy, self.xe, self.ye)))

    def at(self, where: Mask) -> Sums:
        """The sums of some pixels."""
        return self.each(lambda s: s[where])

    def explained(self, shift: Float) -> float:
        """Squared error over the noise that shifts (..., 2) explain."""
        x, y = shift[..., 0], shift[..., 1]
        return float((2.0 * (x * self.xe + y * self.ye) - x * x * self.xx - 2.0 * x * y * self.xy - y * y * self.yy).sum())


def rounding(sums: Sums, camera: Camera) -> Float:
    """(H, W, 2) pixels of the rectified image by which rounding moves the ray of each pixel; sums: of (n,) pixels."""
    rays, focal = camera.rays()[..., :2].reshape(-1, 2), np.array([camera.fx, camera.fy])
    sums = _without_smooth(sums, rays)
    found = _searched(sums, rays, focal)
    both = [np.append(p, _offsets(sums, _turns(p, rays, focal))) for p in (found, _mirrored(found))]
    best = max(both, key=lambda p: _explained(p, sums, rays, focal))
    steps = np.append(0.1 * np.array(SIMPLEX), [0.05, 0.05])
    best = _refined(lambda p: -_explained(p, sums, rays, focal), best, steps, tries=600)
    return _in_the_image(best, rays, focal).reshape(*camera.shape, 2)


def _turns(p: Float, rays: Float, focal: Float) -> Float:
    """(n, 2) pixels from each pixel's own place to its place in the sensor's image, up to a constant; rays (n, 2) at z = 1."""
    return np.asarray(focal * (p[0] * distort(rays, tuple(p[1:PARAMETERS])) - rays))


def _sawtooth(turns: Float) -> Float:
    """Pixels to the nearest pixel."""
    return np.asarray(np.round(turns) - turns)


def _in_the_image(p: Float, rays: Float, focal: Float) -> Float:
    """(n, 2) shifts in pixels of the rectified image: those in the sensor's image through the inverse of the map's derivative."""
    by_ray = np.stack(distortion_jacobian(rays, tuple(p[1:PARAMETERS])), axis=-1).reshape(-1, 2, 2)
    derivative = p[0] * by_ray * focal[:, None] / focal
    shift = _sawtooth(_turns(p, rays, focal) + p[PARAMETERS:])
    return np.asarray(np.linalg.solve(derivative, shift[..., None])[..., 0])


def _without_smooth(sums: Sums, rays: Float) -> Sums:
    """The sums less a polynomial shift over the image: no sawtooth, and larger than one where the lens is not as stated."""
    x, y = rays.T
    powers = np.stack([x**i * y**j for i in range(SMOOTH_POWER + 1) for j in range(SMOOTH_POWER + 1 - i)])

    def rest(weight: Float, error: Float) -> Float:
        normal = (powers * weight) @ powers.T
        normal += 1e-9 * np.trace(normal) * np.eye(len(normal))
        return np.asarray(error - weight * (np.linalg.solve(normal, powers @ error) @ powers))

    return replace(sums, xe=rest(sums.xx, sums.xe), ye=rest(sums.yy, sums.ye))


def _searched(sums: Sums, rays: Float, focal: Float) -> Float:
    """The parameters whose sawtooth, by its first harmonic and of any phase, fits best: in a disc about the axis first, then in wider ones."""
    away = np.hypot(*(rays * focal).T)
    step = STEP_TURNS / FIRST_PX
    curves = np.arange(*CURVATURES, step * (focal.mean() / FIRST_PX) ** 2)
    tried = [np.array([scale, k1, 0.0, 0.0, 0.0]) for scale in np.arange(*SCALES, step) for k1 in curves]
    radius, kept = FIRST_PX, KEPT[0]
    while True:
        inside = away < radius
        of_disc = sums.at(inside), rays[inside], focal
        whole = radius > away.max()
        free = 2 if 2.0 * radius < away.max() else PARAMETERS if whole else 3
        best = _apart(sorted(tried, key=lambda p: -_in_phase(p, *of_disc)))[:kept]
        tried = sorted((_with(p, free, of_disc) for p in best), key=lambda p: -_in_phase(p, *of_disc))
        if whole:
            return tried[0]
        radius, kept = radius * WIDER, KEPT[1]


def _apart(ordered: Sequence[Float]) -> list[Float]:
    """The maps without those that are alike to a better one."""
    out: list[Float] = []
    for p in ordered:
        if all((np.abs(p - better)[:2] > ALIKE).any() for better in out):
            out.append(p)
    return out


def _with(p: Float, free: int, of_disc: tuple[Sums, Float, Float]) -> Float:
    """The parameters with the first `free` ones refined."""
    fitted = _refined(lambda q: -_in_phase(np.append(q, p[free:]), *of_disc), p[:free], np.array(SIMPLEX[:free]), tries=60 * free)
    return np.append(fitted, p[free:])


def _in_phase(p: Float, sums: Sums, rays: Float, focal: Float) -> float:
    """Squared error over the noise that a wave of the map's turns explains, of any phase."""
    along = zip(_turns(p, rays, focal).T, (sums.xe, sums.ye), (sums.xx, sums.yy), strict=True)
    return float(sum(np.abs(error @ np.exp(2j * np.pi * t)) ** 2 / max(weight.sum(), 1e-12) for t, error, weight in along))


def _explained(p: Float, sums: Sums, rays: Float, focal: Float) -> float:
    """Squared error over the noise that the map's sawtooth explains."""
    return sums.explained(_sawtooth(_turns(p, rays, focal) + p[PARAMETERS:]))


def _offsets(sums: Sums, turns: Float) -> Float:
    """(2,) fractions of a pixel along x and y that explain most, each axis by itself."""
    tried = [[sums.explained(_sawtooth(turns + of) * axis) for of in OFFSETS] for axis in np.eye(2)]
    return np.asarray(OFFSETS[np.argmax(tried, axis=1)])


def _mirrored(p: Float) -> Float:
    """The map whose turns are opposite everywhere: its first harmonic is the same, its sawtooth falls where the other's rises."""
    scale = 2.0 - p[0]
    return np.append(scale, -p[0] * p[1:PARAMETERS] / scale)


def _refined(cost: Callable[[Float], float], start: Float, steps: Float, tries: int) -> Float:
    """The parameters of least cost by a simplex of these first steps."""
    simplex = np.vstack([start, start + np.diag(steps)])
    return np.asarray(minimize(cost, start, method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": tries}).x)
