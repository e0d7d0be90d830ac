# SPDX-License-Identifier: Apache-2.0
"""Geometric effects: parts off their CAD, a lens off its calibration, a camera off its mount, stamps, motion."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from typing_extensions import override

from tof_core import se3
from tof_virtual.effect import Effect

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_virtual.body import Body
    from tof_virtual.config import VirtualConfig
    from tof_virtual.session import Session


def direction(rng: np.random.Generator) -> Float:
    """A random direction (3,)."""
    v = rng.normal(0, 1, 3)
    return np.asarray(v / np.linalg.norm(v))


def moving(config: VirtualConfig) -> VirtualConfig:
    """The same session, captured while the hand moves."""
    return replace(config, plan=replace(config.plan, capture_moving=True))


class CadDeviation(Effect):
    """A few parts stand off their CAD by a rigid motion and are bowed along their longest axis."""

    name, unit, start, limit = "cad_deviation", "m of displacement", 4e-3, 0.04
    local = geometric = deforms = True

    @override
    def prepare(self, session: Session) -> None:
        rng = self.rng(1)
        share = session.shares()
        seen = np.flatnonzero(share > 0.01)
        seen = seen if seen.size else np.array([int(np.argmax(share))])
        count = int(rng.integers(1, max(2, seen.size // 3 + 1)))
        chosen = sorted(rng.choice(seen, min(count, seen.size), replace=False).tolist())
        self._parts = {k: self._twist(session, k, rng) for k in chosen}
        self._names = [session.bodies[k].name for k in chosen]

    def _twist(self, session: Session, part: int, rng: np.random.Generator) -> tuple[Float, float]:
        """Direction of motion (6,), mostly along the part's mean normal toward the robot, and the share of bow."""
        soup = session.nominal.soup
        faces = np.flatnonzero(soup.body == part)
        corners = soup.corners[faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        facing = np.radians(session.config.plan.facing_deg)
        toward = np.array([np.cos(facing), np.sin(facing), 0.4])
        weight = area * np.clip(soup.normals[faces] @ toward, 0, None)
        normal = weight @ soup.normals[faces] + 1e-9 * toward
        t = rng.choice([-1, 1]) * (0.8 * normal / np.linalg.norm(normal) + 0.4 * direction(rng))
        lever = max(0.5 * float(np.ptp(corners.reshape(-1, 3), axis=0).max()), 0.02)
        return np.concatenate([t, 0.7 * direction(rng) / lever]), float(rng.uniform(0.4, 1.0) * rng.choice([-1, 1]))

    @override
    def params(self) -> dict[str, Any]:
        return {
            "parts": self._names,
            "twists": [(self.size * t).tolist() for t, _ in self._parts.values()],
            "bow_m": [self.size * b for _, b in self._parts.values()],
        }

    @override
    def deform(self, bodies: Sequence[Body]) -> Sequence[Body]:
        return [self._bend(b, *self._parts[k]) if k in self._parts else b for k, b in enumerate(bodies)]

    def _bend(self, body: Body, twist: Float, bow: float) -> Body:
        vertices, faces = refine(np.asarray(body.vertices, float), np.asarray(body.faces))
        centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        local = vertices - centre
        _, axes = np.linalg.eigh(np.cov(local.T))
        along = local @ axes[:, 2]
        shape = (along / max(np.abs(along).max(), 1e-9)) ** 2 - 1 / 3
        bent = local + self.size * bow * shape[:, None] * axes[:, 0]
        return replace(body, vertices=se3.apply(se3.exp(self.size * twist), bent) + centre, faces=faces)


def refine(vertices: Float, faces: NDArray[Any], pieces: int = 10, most: int = 30_000) -> tuple[Float, NDArray[np.int32]]:
    """Quarter all triangles until none is longer than a tenth of the body, so that a plate can bend."""
    limit = np.ptp(vertices, axis=0).max() / pieces
    while len(faces) * 4 <= most:
        corners = vertices[faces]
        if np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() <= limit:
            break
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        ends, which = np.unique(edges, axis=0, return_inverse=True)
        middle = len(vertices) + which.reshape(-1, 3)
        vertices = np.concatenate([vertices, vertices[ends].mean(axis=1)])
        (a, b, c), (d, e, f) = faces.T, middle.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))])
    return vertices, faces.astype(np.int32)


class Intrinsics(Effect):
    """The lens differs from CameraInfo: focal length, principal point, radial distortion, in a random mixture."""

    name, unit, start, limit = "intrinsics", "1 = 1 % focal length, 3 px, k1 of 0.02", 0.5, 6.0
    geometric = True

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._focal, self._k1 = rng.normal(0, 0.01), rng.normal(0, 0.02)
        self._shift = 3.0 * rng.normal(0, 1, 2)

    @override
    def params(self) -> dict[str, Any]:
        return {"focal": self.size * self._focal, "principal_px": (self.size * self._shift).tolist(), "k1": self.size * self._k1}

    @override
    def true_camera(self, camera: Camera) -> Camera:
        f, (du, dv) = 1 + self.size * self._focal, self.size * self._shift
        return replace(
            camera,
            fx=camera.fx * f,
            fy=camera.fy * f,
            cx=camera.cx + du,
            cy=camera.cy + dv,
            distortion=(self.size * self._k1, 0.0, 0.0, 0.0, 0.0),
        )


class HandEye(Effect):
    """The camera's mounting on the hand differs from TF: one constant X, 0.1 degree per millimetre."""

    name, unit, start, limit = "hand_eye", "m", 3e-3, 0.03
    geometric = True

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._twist = np.concatenate([direction(rng), np.radians(100.0) * direction(rng)])

    @override
    def params(self) -> dict[str, Any]:
        return {"twist": (self.size * self._twist).tolist()}

    @override
    def hand_eye(self) -> Float:
        return se3.exp(self.size * self._twist)


class TimeSync(Effect):
    """Images are stamped early or late, so that TF is looked up at another time; visible in motion only."""

    name, unit, start, limit = "time_sync", "s", 0.02, 0.2
    geometric = True

    @override
    @classmethod
    def adapt(cls, config: VirtualConfig) -> VirtualConfig:
        return moving(config)

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._sign = float(rng.choice([-1, 1]))

    @override
    def params(self) -> dict[str, Any]:
        return {"stamp_error_s": self.stamp_error_s()}

    @override
    def stamp_error_s(self) -> float:
        return self._sign * self.size


class Motion(Effect):
    """The four taps are exposed one after the other while the hand moves."""

    name, unit, start, limit = "motion", "s between taps", 0.01, 0.06

    @override
    @classmethod
    def adapt(cls, config: VirtualConfig) -> VirtualConfig:
        # each capture is rendered five times: fewer rays at the edges keep it fast
        return moving(replace(config, camera=replace(config.camera, subsamples=min(config.camera.subsamples, 3))))

    @override
    def params(self) -> dict[str, Any]:
        return {"tap_interval_s": self.size, "speed_m_s": self.config.plan.speed_m_s, "turn_deg_s": self.config.plan.turn_deg_s}

    @override
    def tap_interval_s(self) -> float:
        return self.size
