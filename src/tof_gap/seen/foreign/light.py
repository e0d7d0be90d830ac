# SPDX-License-Identifier: Apache-2.0
"""Another camera's light as a bias that is new in every capture: it looks like arm errors along the optical axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc, fdtrc

from tof_gap.seen.evidence.residual import over_mean
from tof_gap.seen.finding import CONFIDENT, Finding, most
from tof_gap.seen.foreign.stripes import weakness
from tof_sensor.effects.interference import Interference
from tof_sensor.geometry import beside_poses, pose_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.foreign import ForeignLightLimits
    from tof_gap.seen.evidence.view import ViewEvidence

ALONG, ACROSS = 2, (0, 1)
"""Axes of the camera's frame: along the optical axis, and across it."""


def foreign_light(
    views: Sequence[ViewEvidence],
    arms: Float,
    arms_sd: Float,
    camera_covs: Float,
    limits: ForeignLightLimits,
    named_m: float = 0.0,
    lines_m: Float | float = 0.0,
) -> Finding | None:
    """`interference` where arm errors along the optical axis exceed those across it, and a smooth field is left in nearly every view.

    Another camera's modulated light adds a phasor with a phase of its own in every capture (docs/effects.md). Most of the depth error
    that the phasor makes looks like a step of the camera along its optical axis, and the arm's error absorbs it. No other effect is
    random from capture to capture, and an arm errs across the axis too. The rest is a smooth field, smaller than these steps; a loose mount
    leaves none.
    Weak foreign light stays within the arm's prior: then the field must exceed the errors of the named effects' maps, and it must be there
    beside any error of the poses. Poses that follow an error of the CAD leave a field, too.

    Args:
        views: at the solution's poses, less all smooth bias.
        arms: (V, 6) arm errors in the camera's frame, metres and radians.
        arms_sd: (V, 6) their standard deviations by the robot's prior.
        camera_covs: (V, 6, 6) of the estimated poses, in the camera's frame.
        limits: largest probability by chance at which the effect is believed.
        named_m: metres, sizes of the named effects together (root of the sum of squares).
        lines_m: (V,) metres RMS of the smooth field that the noise of whole rows and columns makes in each view.
    """
    beyond = along_the_view(arms, arms_sd, limits)
    if not beyond and (not _across_known(camera_covs, arms_sd, limits) or _by_arm(arms, arms_sd) > limits.chance_across_fields):
        return None
    fields = [field(v, limits) for v in views]
    least_m = np.maximum(0.0 if beyond else limits.field_share * named_m, lines_m)
    if not in_most_views(views, fields, limits, least_m) or not (beyond or _beside_poses(views, limits)):
        return None
    size = float(np.sqrt(np.mean(arms[:, ALONG] ** 2)))
    if size < np.median(explained_m(views, fields)):
        return None
    share = np.stack([np.where(v.smooth, np.hypot(f, size), np.nan) for v, f in zip(views, fields, strict=True)])
    each = over_mean(views) * size  # Every capture has a phase of its own.
    note = f"every capture is off along the view by an amount of its own, {1e3 * each:.1f} mm RMS"
    return Finding(
        interference(views, each, duty=1.0), CONFIDENT, share=share, common=np.stack(fields), note=note, posed_m=size, structure=True
    )


def beside_light(cameras: Float, arms: Float, arms_sd: Float, posed_m: float) -> Float:
    """(V, 4, 4) T_cell_camera without the steps along the optical axis that foreign light makes of depth errors.

    A step of the camera is the sum of the arm's error, known by the robot's prior, and of one by light. What is expected of the light is
    the share of its variance in that of all steps.

    Args:
        cameras: (V, 4, 4) T_cell_camera, steps included.
        arms: (V, 6) steps in the camera's frame, metres and radians.
        arms_sd: (V, 6) standard deviations of the arm's errors by the robot's prior.
        posed_m: metres RMS of the steps along the optical axis where foreign light was found, else 0.
    """
    if posed_m == 0.0:
        return cameras
    by_light = np.maximum(1.0 - (arms_sd[:, ALONG] / posed_m) ** 2, 0.0) * arms[:, ALONG]
    out = cameras.copy()
    out[:, :3, 3] -= by_light[:, None] * cameras[:, :3, ALONG]
    return out


def along_the_view(arms: Float, arms_sd: Float, limits: ForeignLightLimits) -> bool:
    """Whether arm errors (V, 6) along the optical axis exceed both the robot's prior and the errors across the axis."""
    along = float(((arms / arms_sd)[:, ALONG] ** 2).sum())
    return bool(chdtrc(len(arms), along) < limits.chance and _by_arm(arms, arms_sd) < limits.chance_across)


def _across_known(camera_covs: Float, arms_sd: Float, limits: ForeignLightLimits) -> bool:
    """Whether the views determine the cameras' places across the axis: else the estimated errors there are near zero, whatever the arm did."""
    sd = np.sqrt(np.diagonal(camera_covs, axis1=1, axis2=2))
    return bool(np.median((sd / arms_sd)[:, ACROSS]) < limits.across_known)


def _by_arm(arms: Float, arms_sd: Float) -> float:
    """Probability of errors along the optical axis as large as these, given those across it (F test)."""
    square, count = (arms / arms_sd) ** 2, len(arms)
    along, across = float(square[:, ALONG].sum()), float(square[:, ACROSS].sum())
    return float(fdtrc(2 * count, count, along / count / max(across / (2 * count), 1e-12))) if across > 0 else 0.0


def drifts_by_chance(drift: Sequence[Float], posed_m: float, limits: ForeignLightLimits) -> bool:
    """Whether foreign light, which shifts each view by an amount of its own, may look like this drift by chance (F test).

    Args:
        drift: (H, W) metres per view that a drift over time adds, the same at all pixels of a view.
        posed_m: metres RMS by which foreign light shifts captures along the optical axis, beside the drift.
        limits: largest probability by chance at which the drift is believed.
    """
    of_view = np.array([np.nanmedian(m) for m in drift])
    of_view = of_view[np.isfinite(of_view)]
    left = len(of_view) - 1 - limits.drift_terms
    if posed_m == 0.0 or left < 1:
        return False
    explained = float(np.sum((of_view - of_view.mean()) ** 2)) / limits.drift_terms
    return bool(fdtrc(limits.drift_terms, left, explained * left / (len(of_view) * posed_m**2)) > limits.chance)


def interference(views: Sequence[ViewEvidence], size_m: float, *, duty: float) -> Interference:
    """The effect with `size_m` metres RMS in a capture at the median amplitude of the views, in the share `duty` of them."""
    reference = float(np.median(np.concatenate([v.frame.amplitude[v.smooth] for v in views])))
    return Interference(burst_m=min(size_m, most(Interference, "burst_m")), duty=duty, reference=reference)


def field(view: ViewEvidence, limits: ForeignLightLimits) -> Float:
    """(H, W) metres of z: the smooth field of foreign light that the pose of a view does not absorb.

    The sum of a linear function of row and column, and of range^2 / cos(incidence) times a quadratic function of the point. The factor
    is the inverse of the camera's own light; phase and strength of the foreign light follow from the distance to its lamp.
    """
    columns = _terms(view, limits)
    seen = view.smooth
    c = _ridged(columns[seen], view.residual[seen], view.mean_sigma[seen], limits)
    return np.asarray(columns @ c)


def _terms(view: ViewEvidence, limits: ForeignLightLimits) -> Float:
    """(H, W, 13) metres of z per unit of each term of the smooth field."""
    h, w = view.residual.shape
    row, column = np.mgrid[:h, :w]
    plain = np.stack([np.ones((h, w)), row / h - 0.5, column / w - 0.5], axis=-1)
    points = np.nan_to_num(view.frame.points)
    x, y, z = np.moveaxis(points - np.median(points[view.smooth], axis=0), -1, 0) if view.smooth.any() else np.zeros((3, h, w))
    way = np.stack([np.ones((h, w)), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], axis=-1)
    return np.concatenate([plain, way * weakness(view, limits.cosine)[..., None]], axis=-1) / view.frame.length[..., None]


def _ridged(columns: Float, errors: Float, sigma: Float, limits: ForeignLightLimits) -> Float:
    """(k,) coefficients of columns (n, k) for errors (n,) of deviations sigma (n,)."""
    X = columns / sigma[:, None]
    scale = np.maximum(np.linalg.norm(X, axis=0), 1e-12)
    X = X / scale
    return np.asarray(np.linalg.solve(X.T @ X + limits.ridge * np.eye(X.shape[1]), X.T @ (errors / sigma)) / scale)


def _beside_poses(views: Sequence[ViewEvidence], limits: ForeignLightLimits) -> bool:
    """Whether nearly every view has a field of `field_mm` or more, of its own beside errors of its pose, in first order."""
    found = []
    for view in views:
        seen, sigma = view.smooth, view.mean_sigma[view.smooth]
        columns = np.column_stack([_terms(view, limits)[seen], view.residual[seen]]) / sigma[:, None]
        columns = beside_poses(columns, pose_columns(view.frame)[seen] / sigma[:, None])
        terms, errors = columns[:, :-1], columns[:, -1]
        left = errors - terms @ _ridged(terms, errors, np.ones(len(errors)), limits)
        found.append((float(errors @ errors - left @ left), float((sigma**-2.0).sum())))
    return _share(found, limits, 0.0) >= limits.field_views


def in_most_views(views: Sequence[ViewEvidence], fields: Sequence[Float], limits: ForeignLightLimits, least_m: Float | float) -> bool:
    """Whether nearly every view has a field of its own, larger than `field_mm` and `least_m`, (V,) or one of all."""
    return _share(_taken(views, fields), limits, least_m) >= limits.field_views


def explained_m(views: Sequence[ViewEvidence], fields: Sequence[Float]) -> Float:
    """(V,) metres RMS of each view's error that its field explains."""
    return np.array([np.sqrt(max(taken, 0.0) / weight) for taken, weight in _taken(views, fields)])


def _share(found: Sequence[tuple[float, float]], limits: ForeignLightLimits, least_m: Float | float) -> float:
    """Share of the views whose field explains more chi-square than chance, or an error of `field_mm` or `least_m`, would."""
    least = np.broadcast_to(np.maximum(limits.field_mm * 1e-3, least_m), len(found))
    return float(np.mean([taken > max(limits.field_chi2, m**2 * weight) for (taken, weight), m in zip(found, least, strict=True)]))


def _taken(views: Sequence[ViewEvidence], fields: Sequence[Float]) -> list[tuple[float, float]]:
    """Of each view, the chi-square that its field explains, and that of an error of 1 m."""
    out = []
    for v, f in zip(views, fields, strict=True):
        weight = 1.0 / v.mean_sigma[v.smooth] ** 2
        out.append((float(((v.residual**2 - (v.residual - f) ** 2)[v.smooth] * weight).sum()), float(weight.sum())))
    return out
