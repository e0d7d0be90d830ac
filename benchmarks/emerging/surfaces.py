# SPDX-License-Identifier: Apache-2.0
"""Bodies as they really are: moved, bent, missing, foreign; with an infrared albedo that the scene file does not state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from trimesh.remesh import subdivide_to_size

from tof_core import se3
from tof_virtual.body import Body
from tof_virtual.sight import World

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from benchmarks.emerging.device import Device
    from tof_core.arrays import Float
    from tof_virtual.sight import Rays

WAVES = 6
"""Plane waves of which the texture is made."""
GLASS_INDEX = 1.52
BENT_PIECES = 24
"""Edges of a bent part are at most this fraction of its length: chords are within 0.2 % of the sagitta (a quarter of 1 / 12**2)."""
FOREIGN = "foreign"
"""Name of the box that the CAD lacks."""


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """The real world of a session.

    `world` has stated albedos (N faces). `factor` (bodies,) is the true albedo over the stated one; `waves` (WAVES, 4) wave
    vectors in rad/m and phases of the texture; `texture` its relative size. `gloss` (bodies,) mirror-like reflectance,
    `translucent_m` (bodies,) mean way of light within. `pane` (4, 3): corner, two sides and unit normal of a glass pane,
    or empty; `pane_m` the way that it adds at normal incidence.
    """

    world: World
    factor: Float
    waves: Float
    texture: float
    gloss: Float
    gloss_rough: float
    translucent_m: Float
    pane: Float
    pane_m: float
    subject: str

    def albedo(self, rays: Rays) -> Float:
        """True albedo (N,) where rays end; 0 where they meet nothing."""
        return self.albedo_at(rays.points, rays.face)

    def albedo_at(self, points: Float, face: NDArray[np.int32]) -> Float:
        """True albedo (N,) of points (N, 3) on faces (N,), 0 where the face is -1."""
        soup = self.world.soup
        body = soup.body[face]
        out = soup.albedo[face] * self.factor[body]
        if self.texture > 0:
            phase = np.nan_to_num(points) @ self.waves[:, :3].T + self.waves[:, 3] + 7.0 * body[:, None]
            out = out * (1 + self.texture * np.sqrt(2 / WAVES) * np.sin(phase).sum(axis=1) / 2)
        return np.where(face >= 0, np.clip(out, 0.01, 0.97), 0.0)

    def crosses(self, start: Float, end: Float) -> Float:
        """Extra way (N,) of light from points `start` (N, 3) or (3,) to `end` (N, 3) through the glass pane."""
        if not self.pane.size:
            return np.zeros(len(end))
        corner, u, v, normal = self.pane
        d = end - start
        slope = d @ normal
        t = ((corner - start) @ normal) / np.where(np.abs(slope) > 1e-9, slope, np.inf)
        at = start + t[:, None] * d - corner
        within = (t > 0) & (t < 1)
        for side in (u, v):
            share = at @ side / (side @ side)
            within &= (share > 0) & (share < 1)
        cosine = np.abs(slope) / np.maximum(np.linalg.norm(d, axis=1), 1e-12)
        return np.where(within, self.pane_m / np.sqrt(1 - (1 - cosine**2) / GLASS_INDEX**2), 0.0)


def surfaces(bodies: Sequence[Body], shares: Float, device: Device, beside: Body | None = None) -> Surfaces:
    """The world of one device's session; `shares` (bodies,): share of all pixels that each body fills; `beside`: a body of one view alone."""
    w = device.world
    rng = np.random.default_rng([device.serial, 23])
    chosen = _choose(shares, rng)
    moved = _choose(shares, rng, count=w.moved_parts)
    factor = 1 + w.albedo_off * rng.uniform(-1, 1, len(bodies))
    directions = rng.normal(0, 1, (WAVES, 3))
    length = np.exp(rng.uniform(np.log(0.02), np.log(0.2), WAVES))
    waves = 2 * np.pi * directions / np.linalg.norm(directions, axis=1)[:, None] / length[:, None]
    real = list(bodies)
    for k in moved:
        real[k] = _moved(real[k], 1e-3 * w.moved_mm, rng)
    real[chosen[0]] = _bent(real[chosen[0]], 1e-3 * w.bent_mm, rng)
    small = _choose(np.where(shares < 0.15, shares, 0), rng)[0]
    foreign = _foreign(bodies, w.foreign_m, rng)
    if foreign is not None:
        real.append(foreign)
        factor = np.append(factor, 1.0)
    if w.missing:
        del real[small]
        factor = np.delete(factor, small)
    if beside is not None:
        real.append(beside)
        factor = np.append(factor, 1.0)
    names = [b.name for b in real]
    subject = bodies[chosen[0]].name
    mark = np.array([float(n == subject) for n in names])
    return Surfaces(
        world=World.of(real),
        factor=factor,
        waves=np.concatenate([waves, rng.uniform(0, 2 * np.pi, (WAVES, 1))], axis=1),
        texture=w.texture,
        gloss=w.gloss * mark,
        gloss_rough=w.gloss_rough,
        translucent_m=1e-3 * w.translucent_mm * mark,
        pane=_pane(bodies, rng) if w.pane_mm > 0 else np.zeros((0, 3)),
        pane_m=1e-3 * w.pane_mm * (GLASS_INDEX - 1),
        subject=subject,
    )


def _choose(shares: Float, rng: np.random.Generator, count: int = 1) -> list[int]:
    """Bodies at random, likelier the more of them is seen; none that fills half of the pixels if it can be helped."""
    weight = np.where((shares > 0.01) & (shares < 0.5), shares, 0.0)
    weight = weight if weight.sum() > 0 else np.maximum(shares, 1e-9)
    count = min(count, int((weight > 0).sum()))
    return [int(k) for k in rng.choice(shares.size, count, replace=False, p=weight / weight.sum())]


def _moved(body: Body, distance_m: float, rng: np.random.Generator) -> Body:
    """Shifted by `distance_m` in a random direction, and turned by as much over the body's half length."""
    way, turn = rng.normal(0, 1, 3), rng.normal(0, 1, 3)
    centre = body.vertices.mean(axis=0)
    half = max(0.5 * float(np.ptp(body.vertices, axis=0).max()), 0.05)
    R = se3.so3_exp(distance_m / half * turn / np.linalg.norm(turn))
    moved = (body.vertices - centre) @ R.T + centre + distance_m * way / np.linalg.norm(way)
    return replace(body, vertices=moved) if distance_m > 0 else body


def _bent(body: Body, sagitta_m: float, rng: np.random.Generator) -> Body:
    """Bent along its longest side towards its shortest, so that the middle stands out by `sagitta_m`.

    Faces are divided first: a box has corners alone, and none between its ends that could stand out.
    """
    sign = rng.choice([-1.0, 1.0])
    if sagitta_m <= 0:
        return body
    low, size = body.vertices.min(axis=0), np.ptp(body.vertices, axis=0)
    long, short = int(np.argmax(size)), int(np.argmin(size))
    bent, faces = subdivide_to_size(body.vertices, body.faces, size[long] / BENT_PIECES)
    along = 2 * (bent[:, long] - low[long]) / size[long] - 1
    bent[:, short] += sign * sagitta_m * (1 - along**2)
    return replace(body, vertices=bent, faces=np.asarray(faces, np.int32))


def _foreign(bodies: Sequence[Body], edge_m: float, rng: np.random.Generator) -> Body | None:
    """A box beside what is looked at, standing at its lowest height."""
    points = np.concatenate([b.vertices for b in bodies if b.subject] or [b.vertices for b in bodies])
    low, high = points.min(axis=0), points.max(axis=0)
    place = low + rng.uniform(0.2, 0.8, 3) * (high - low)
    size = edge_m * rng.uniform(0.6, 1.4, 3)
    albedo = float(rng.uniform(0.15, 0.7))
    if edge_m <= 0:
        return None
    place[2] = low[2] + 0.5 * size[2]
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))], np.int32)
    return Body(FOREIGN, place + corners * size, faces, albedo)


def _pane(bodies: Sequence[Body], rng: np.random.Generator) -> Float:
    """Corner, sides and normal (4, 3) of a pane over one half of what is looked at, a little above and before it."""
    points = np.concatenate([b.vertices for b in bodies if b.subject] or [b.vertices for b in bodies])
    low, high = points.min(axis=0), points.max(axis=0)
    left = rng.random() < 0.5
    y0, y1 = (low[1], 0.5 * (low[1] + high[1])) if left else (0.5 * (low[1] + high[1]), high[1])
    corner = np.array([high[0] + 0.03, y0, low[2]])
    top = np.array([0.5 * (low[0] + high[0]), y0, high[2] + 0.05])
    u, v = np.array([0, y1 - y0, 0]), top - corner
    normal = np.cross(u, v)
    return np.stack([corner, u, v, normal / np.linalg.norm(normal)])
