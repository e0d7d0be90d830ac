# SPDX-License-Identifier: Apache-2.0
"""Rigid motions: 4x4 float64 matrices `T_target_source` that map source points into target.

Twists are ordered (x, y, z, rotX, rotY, rotZ) as in REP 103, metres and radians.
A *right* perturbation is `T @ exp(xi)` (axes of the source frame); a *fixed-axes* one moves
the translation by (x, y, z) and turns about the origin of the source with axes of the target
frame, which is what `PoseWithCovariance` means.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import TransformError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tof_core.arrays import Float


def skew(v: ArrayLike) -> Float:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    v = np.asarray(v, float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    return out - np.swapaxes(out, -1, -2)


def so3_exp(w: ArrayLike) -> Float:
    """Rotation matrix (3, 3) of a rotation vector (3,) in radians (Rodrigues)."""
    w = np.asarray(w, float)
    angle = float(np.linalg.norm(w))
    K = skew(w)
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + a * K + b * K @ K)


def so3_log(R: ArrayLike) -> Float:
    """Rotation vector (3,) in radians of a rotation matrix (3, 3), stable up to pi."""
    x, y, z, w = quat_from_matrix(R)
    v = np.array([x, y, z])
    n = float(np.linalg.norm(v))
    if n < 1e-12:
        return 2.0 * v
    return np.asarray(2.0 * np.arctan2(n, w) / n * v)


def exp(xi: ArrayLike) -> Float:
    """Motion (4, 4) of a twist (6,)."""
    xi = np.asarray(xi, float)
    w = xi[3:]
    angle2 = float(w @ w)
    K = skew(w)
    if angle2 < 1e-12:
        V = np.eye(3) + 0.5 * K + K @ K / 6.0
    else:
        angle = np.sqrt(angle2)
        V = np.eye(3) + 2 * np.sin(0.5 * angle) ** 2 / angle2 * K + (angle - np.sin(angle)) / (angle2 * angle) * K @ K
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = so3_exp(w), V @ xi[:3]
    return T


def log(T: ArrayLike) -> Float:
    """Twist (6,) of a motion (4, 4); the inverse of `exp`."""
    T = np.asarray(T, float)
    w = so3_log(T[:3, :3])
    K = skew(w)
    angle2 = float(w @ w)
    if angle2 < 1e-12:
        c = 1.0 / 12.0
    else:
        half = 0.5 * np.sqrt(angle2)
        c = (1.0 - half / np.tan(half)) / angle2  # by half angles: 1 - cos loses all digits for small turns
    V_inv = np.eye(3) - 0.5 * K + c * K @ K
    return np.concatenate([V_inv @ T[:3, 3], w])


def inverse(T: ArrayLike) -> Float:
    """`T_source_target` (..., 4, 4) of `T_target_source` (..., 4, 4)."""
    T = np.asarray(T, float)
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out = np.zeros_like(T)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -(R_t @ T[..., :3, 3, None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def adjoint(T: ArrayLike) -> Float:
    """Adjoint (6, 6): `T @ exp(xi) == exp(adjoint(T) @ xi) @ T`."""
    T = np.asarray(T, float)
    R = T[:3, :3]
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = R
    out[:3, 3:] = skew(T[:3, 3]) @ R
    return out


def apply(T: ArrayLike, points: ArrayLike) -> Float:
    """Points (..., 3) of the source frame in the target frame."""
    T = np.asarray(T, float)
    return np.asarray(np.asarray(points, float) @ T[:3, :3].T + T[:3, 3])


def as_se3(name: str, T: ArrayLike) -> Float:
    """`T` as float64 (4, 4); a TransformError with `name` where it is no rigid motion.

    Rotations off by rounding (1e-4) are projected back; anything else is refused.
    """
    T = np.array(T, float)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        msg = f"is no finite 4x4 matrix (shape {T.shape})"
        raise TransformError(msg, where=name)
    R = T[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-4 or np.linalg.det(R) < 0 or np.abs(T[3] - [0, 0, 0, 1]).max() > 1e-9:
        msg = "is no rigid motion (its 3x3 part is no rotation)"
        raise TransformError(msg, where=name)
    U, _, Vt = np.linalg.svd(R)
    T[:3, :3] = U @ Vt
    return T


def from_quat(xyz: ArrayLike, xyzw: ArrayLike) -> Float:
    """Motion (4, 4) of a translation (3,) and a quaternion (x, y, z, w), normalised here."""
    q = np.asarray(xyzw, float)
    n = float(np.linalg.norm(q))
    if not np.isfinite(n) or n < 1e-6:
        msg = f"quaternion {tuple(np.asarray(xyzw).tolist())} has no direction"
        raise TransformError(msg)
    x, y, z, w = q / n
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = np.asarray(xyz, float)
    return T


def quat_from_matrix(R: ArrayLike) -> Float:
    """Unit quaternion (x, y, z, w), w >= 0, of a rotation (3, 3) (Shepperd)."""
    R = np.asarray(R, float)
    d = np.array([R[0, 0], R[1, 1], R[2, 2], np.trace(R[:3, :3])])
    i = int(np.argmax(d))
    q = np.empty(4)
    if i == 3:
        q[:] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1 + d[3]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i] = 1 + 2 * d[i] - d[3]
        q[j], q[k], q[3] = R[j, i] + R[i, j], R[k, i] + R[i, k], R[k, j] - R[j, k]
    q /= np.linalg.norm(q)
    return q if q[3] >= 0 else -q


def interpolate(T0: ArrayLike, T1: ArrayLike, share: float) -> Float:
    """Motion between T0 (share 0) and T1 (share 1): linear in translation, slerp in rotation."""
    T0, T1 = np.asarray(T0, float), np.asarray(T1, float)
    out = np.eye(4)
    out[:3, :3] = T0[:3, :3] @ so3_exp(share * so3_log(T0[:3, :3].T @ T1[:3, :3]))
    out[:3, 3] = (1 - share) * T0[:3, 3] + share * T1[:3, 3]
    return out


def distance(T0: ArrayLike, T1: ArrayLike) -> tuple[float, float]:
    """Distance of two motions: metres between the origins, degrees between the axes."""
    T0, T1 = np.asarray(T0, float), np.asarray(T1, float)
    angle = np.linalg.norm(so3_log(T0[:3, :3].T @ T1[:3, :3]))
    return float(np.linalg.norm(T1[:3, 3] - T0[:3, 3])), float(np.degrees(angle))


def cov_fixed_axes(T: ArrayLike, cov_right: ArrayLike) -> Float:
    """Covariance (6, 6) of a right perturbation, as PoseWithCovariance wants it (fixed axes)."""
    R = np.asarray(T, float)[:3, :3]
    M = np.zeros((6, 6))
    M[:3, :3] = M[3:, 3:] = R
    return np.asarray(M @ np.asarray(cov_right, float) @ M.T)


def cov_right(T: ArrayLike, cov_fixed: ArrayLike) -> Float:
    """The inverse of `cov_fixed_axes`."""
    return cov_fixed_axes(np.asarray(T, float).T, cov_fixed)
