# SPDX-License-Identifier: Apache-2.0
"""What a session can show of an effect, from its true maps alone: what no pose within the robot's priors makes, over the noise.

To first order a small motion (t, w) of the camera changes the depth of a surface with normal n, seen at point p along the ray r
(r_z = 1), by -(n . t + (p x n) . w) / (n . r).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.arrays import Float

SHARE = 0.25
"""Least share of a map's energy that must stand after the pose."""
LEFT_MM = 0.3
"""Least RMS of what stands, over affected pixels; smaller is within what healthy cameras do."""
CHI2 = 100.0
"""Least chi-square of what stands over the noise."""
IMPLAUSIBLE = 40.0
"""Chi-square of a pose under the robot's priors beyond which the pose that would make the map is itself seen to be wrong."""
ALIKE = 0.87
"""Cosine of two maps after the pose beyond which one leaves less than a quarter of the other: they are one to any observer."""
LOST = 0.005
"""Least share of pixels for an effect that shows as lost, wrapped or mixed pixels."""
GROSS = frozenset({"phase_wrap", "flying_pixels", "quantization", "time_sync", "motion", "radial_depth"})
"""Effects that no smooth field makes."""
SMOOTH_M = 0.1
"""A map's values beyond are jumps, and no part of a smooth field."""
STEP = 3
"""Every third row and column of the maps."""
GRAZING = 0.1
"""Least cosine between ray and normal."""
HAND_EYE_MM, HAND_EYE_DEG = 2.0, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Pose freedom of a session: rows (n, 6) per view of pixels `index`, and normal equations' parts by station, view and hand-eye."""

    rows: list[Float]
    index: list[Any]
    of_base: list[Float]
    station: Any
    prior: Float

    def project(self, maps: list[Float], weights: list[Float]) -> tuple[list[Float], float]:
        """What stands of maps (n,) per view after the best pose, and the prior's penalty for that pose."""
        S = int(self.station.max()) + 1
        size = 6 * (S + len(self.rows) + 1)
        H, g = np.diag(self.prior.copy()), np.zeros(size)
        blocks = []
        for v, J in enumerate(self.rows):
            s = 6 * int(self.station[v])
            at = np.concatenate([np.arange(s, s + 6), np.arange(6 * (S + v), 6 * (S + v + 1)), np.arange(size - 6, size)])
            full = np.concatenate([J @ self.of_base[v], J, J], axis=1)
            blocks.append((at, full))
            H[np.ix_(at, at)] += full.T @ (weights[v][:, None] * full)
            g[at] += full.T @ (weights[v] * maps[v])
        x = np.linalg.lstsq(H, g, rcond=1e-12)[0]
        left = [m - full @ x[at] for m, (at, full) in zip(maps, blocks, strict=True)]
        return left, float(x @ (self.prior * x))


def poses(arrays: Mapping[str, Any], meta: Mapping[str, Any]) -> Poses:
    """Pose columns at the true geometry, with the robot's priors."""
    c = meta["config"]
    V, H, W = arrays["depth"].shape
    f = 0.5 * c["camera"]["width"] / np.tan(np.radians(c["camera"]["fov_deg"]) / 2)
    v, u = np.mgrid[0:H:STEP, 0:W:STEP]
    ray = np.stack([(u - 0.5 * (W - 1)) / f, (v - 0.5 * (H - 1)) / f, np.ones(u.shape)], axis=-1).reshape(-1, 3)
    rows, index, of_base = [], [], []
    for k in range(V):
        z = arrays["depth"][k, ::STEP, ::STEP].ravel().astype(float)
        n = arrays["normal"][k, ::STEP, ::STEP].reshape(-1, 3).astype(float)
        slope = np.einsum("ij,ij->i", n, ray)
        good = np.flatnonzero(np.isfinite(z) & (np.abs(slope) > GRAZING * np.linalg.norm(ray, axis=1)))
        p = z[good, None] * ray[good]
        rows.append(-np.concatenate([n[good], np.cross(p, n[good])], axis=1) / slope[good, None])
        index.append(good)
        T = arrays["T_cell_camera"][k]
        # A base error turns the world about the camera's station; to the camera it is a twist of its own frame.
        body = np.eye(4)
        body[:3, 3] = arrays["T_robot"][k][:3, 3]
        of_base.append(se3.adjoint(se3.inverse(T) @ body))
    station = np.unique(arrays["station"], return_inverse=True)[1]
    return Poses(rows, index, of_base, station, _prior(c["robot"], int(station.max()) + 1, V))


def _prior(robot: Mapping[str, float], stations: int, views: int) -> Float:
    """Inverse variances (unknowns,) of bases, arms, hand-eye: metres, then radians."""

    def of(mm: float, deg: float) -> Float:
        return 1 / np.repeat([1e-3 * mm, np.radians(deg)], 3) ** 2

    # a base is drawn evenly up to its largest error, about a mark a metre or two away from the camera
    base = of(max(robot["base_max_mm"], 1.0) + 1e3 * 1.5 * np.radians(robot["base_deg"]), max(robot["base_deg"], 0.05))
    arm = of(robot["arm_mm"] / np.sqrt(3), robot["arm_deg"] / np.sqrt(3))
    return np.concatenate([np.tile(base, stations), np.tile(arm, views), of(HAND_EYE_MM / np.sqrt(3), HAND_EYE_DEG / np.sqrt(3))])


def separability(arrays: Mapping[str, Any], meta: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Of each effect: `share` of its energy and `left_mm` RMS after the pose, `chi2` over the noise, `gap_share`, `rivals`, and the verdict.

    `pose_chi2` is how implausible the pose is that would make the map.
    `gap_share` is its share of the energy of all biases; `rivals` are the session's other effects whose maps look the same.
    """
    free = poses(arrays, meta)
    noise = [np.maximum(_local_rms(arrays["noise"][k]), 2e-4) for k in range(len(free.rows))]
    weights = [1 / n[::STEP, ::STEP].ravel()[i] ** 2 for n, i in zip(noise, free.index, strict=True)]
    effects = sorted({c["effect"].replace(" ", "_") for c in meta["causes"].values()})
    out: dict[str, dict[str, Any]] = {}
    left: dict[str, Float] = {}
    energy = {}
    for effect in effects:
        true = next((arrays[f"{kind}_{effect}"] for kind in ("bias", "loss", "noise") if f"{kind}_{effect}" in arrays), None)
        if true is None:
            out[effect] = {"separable": True}
            continue
        smooth = [_smooth(true[k], i) for k, i in enumerate(free.index)]
        energy[effect] = float(np.nansum(np.clip(np.nan_to_num(true.astype(float)), -SMOOTH_M, SMOOTH_M) ** 2))
        stood, penalty = free.project(smooth, weights)
        total = sum(float(w @ m**2) for w, m in zip(weights, smooth, strict=True))
        chi2 = penalty + sum(float(w @ m**2) for w, m in zip(weights, stood, strict=True))
        left[effect] = np.concatenate([np.sqrt(w) * m for w, m in zip(weights, stood, strict=True)])
        one = np.concatenate(stood)
        touched = np.abs(np.concatenate(smooth)) > 0.1 * np.percentile(np.abs(np.concatenate(smooth)), 99.5)
        rest = 1e3 * float(np.sqrt(np.mean(one[touched] ** 2))) if touched.any() else 0.0
        seen = np.isfinite(true)
        gross = float((np.abs(true[seen]) > (0.5 if f"loss_{effect}" in arrays else 1e-3)).mean())
        shows = gross > LOST if effect in GROSS or f"bias_{effect}" not in arrays else False
        smooth_shows = (chi2 >= SHARE * total and rest >= LEFT_MM and chi2 >= CHI2) or penalty >= IMPLAUSIBLE
        out[effect] = {
            "share": chi2 / max(total, 1e-12),
            "left_mm": rest,
            "chi2": chi2,
            "pose_chi2": penalty,
            "touched": gross,
            "separable": bool(shows or (smooth_shows and f"bias_{effect}" in arrays)),
        }
    whole = sum(energy.values())
    for effect in effects:
        out[effect]["gap_share"] = energy.get(effect, 0.0) / whole if whole > 0 else 1.0
        rivals = [o for o in left if o != effect and effect in left and _cosine(left[effect], left[o]) > ALIKE]
        out[effect]["rivals"] = rivals
        out[effect]["separable"] = bool(out[effect]["separable"] and not rivals)
    return out


def correlation(free: Poses, named: Float, true: Float, *, as_is: bool = False) -> float:
    """Correlation of two maps (V, H, W) over the session after each lost what bases, arms and hand-eye can make of it; as_is: or whole."""
    pair = []
    both = [np.isfinite(named[k, ::STEP, ::STEP].ravel()[i] * true[k, ::STEP, ::STEP].ravel()[i]) for k, i in enumerate(free.index)]
    for maps in (named, true):
        values = [_smooth(maps[k], i) for k, i in enumerate(free.index)]
        weights = [b / 1e-3**2 for b in both]
        left = values if as_is else free.project(values, weights)[0]
        pair.append(np.concatenate([x[b] for x, b in zip(left, both, strict=True)]))
    return _cosine(pair[0], pair[1])


def _smooth(image: Any, index: Any) -> Float:
    """A map at the pixels of the pose columns; nothing where it jumps or is not known."""
    values = image[::STEP, ::STEP].ravel()[index].astype(float)
    return np.where(np.isfinite(values) & (np.abs(values) < SMOOTH_M), values, 0.0)


def _local_rms(noise: Any) -> Float:
    """RMS of a view's noise (H, W) within 9 x 9 pixels."""
    from scipy.ndimage import uniform_filter

    known = np.isfinite(noise) & (np.abs(np.nan_to_num(noise)) < SMOOTH_M)
    square = uniform_filter(np.where(known, noise, 0.0).astype(float) ** 2, 9)
    share = uniform_filter(known.astype(float), 9)
    return np.asarray(np.where(share > 0.05, np.sqrt(np.maximum(square, 0.0) / np.maximum(share, 0.05)), 1.0))


def _cosine(a: Float, b: Float) -> float:
    return float(a @ b / np.sqrt((a @ a) * (b @ b) + 1e-30))
