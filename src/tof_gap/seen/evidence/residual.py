# SPDX-License-Identifier: Apache-2.0
"""Residuals of the views against the CAD, their noise, and the pixels that fits use."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.ndimage import uniform_filter

from tof_core.cores import in_threads
from tof_gap.seen.evidence.averaged import averaging_error
from tof_gap.seen.evidence.correlation import INDEPENDENT
from tof_gap.seen.evidence.edges import excluded, smear, streaks
from tof_gap.seen.evidence.level import depth_step
from tof_gap.seen.evidence.range_code import range_step
from tof_gap.seen.evidence.rectified import added_depth
from tof_gap.seen.evidence.shared_noise import correlation_of
from tof_gap.seen.evidence.view import ViewEvidence, gross_bound, noise_of
from tof_scene.maps import concavity_map
from tof_scene.rendering import depth_only
from tof_sensor.known import as_ideal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.capture import View
    from tof_gap.limits.evidence import EvidenceLimits, LevelLimits
    from tof_gap.seen.evidence.correlation import NoiseCorrelation
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering
    from tof_sensor.frame import Frame


AROUND_PX = 9
"""Width of the window around a pixel in which right ones are counted: a filter in the camera acts over three pixels or five."""


def gather(
    views: Sequence[View],
    renderings: Sequence[Rendering],
    caster: Raycaster,
    limits: EvidenceLimits,
    *,
    concavity: bool = False,
    wider_px: int = 0,
) -> tuple[ViewEvidence, ...]:
    """Residuals of all views against the CAD rendered at their reference poses.

    Args:
        views: of one camera.
        renderings: of each view.
        caster: the scene.
        limits: which pixels count.
        concavity: whether to compute the concavity, which takes ray casts.
        wider_px: pixels added to the edge bands of still views.
    """
    ideal = as_ideal(views, renderings, caster)

    def one(view: View, rendering: Rendering) -> ViewEvidence:
        frame = ideal(view, rendering)
        filled = concavity_map(caster, frame.rendering, limits.concavity_px) if concavity else _unknown(frame)
        return _of_view(view, frame, limits, filled, wider_px, code_of(view, limits.level))

    found = in_threads(one, views, renderings)
    correlation = correlation_of(found)
    if correlation.correlated:
        found = in_threads(lambda v: _correlated(v, wider_px, correlation), found)
    rng = np.random.default_rng(limits.seed)  # Drawn one after the other: the same pixels whichever view is ready first.
    return tuple(replace(v, pixels=drawn(v.smooth, limits.pixels, rng), correlation=correlation) for v in found)


def noise_again(views: Sequence[ViewEvidence]) -> tuple[ViewEvidence, ...]:
    """The views with the noise of their residuals estimated again, after a pattern that raised it was subtracted."""
    of = correlation_of(views)
    views = [replace(v, correlation=of) for v in views]
    return tuple(replace(v, sigma=single(v.noise_of(v.residual))) for v in views)


def with_codes(views: Sequence[View], limits: LevelLimits) -> list[View]:
    """The views as the camera wrote them, with the step of its codes: depth converted to another lens or reading shows none."""
    return in_threads(lambda v: replace(v, code_m=code_of(v, limits)), views)


def code_of(view: View, limits: LevelLimits) -> float:
    """Metres between the camera's codes, of depth or of range along the ray: as stated, else as seen; 0 without codes."""
    if view.code_m is not None:
        return view.code_m
    return max(depth_step(view.depth.astype(np.float64), limits, view.captures), range_step(view, limits.of_range))


def _of_view(view: View, frame: Frame, limits: EvidenceLimits, concavity: Image, wider_px: int, step_m: float) -> ViewEvidence:
    """The evidence of a view whose neighbouring pixels share no noise."""
    residual = view.depth.astype(np.float64) - frame.depth
    if view.ray_shift is not None:
        residual -= added_depth(frame, view.ray_shift)
    blur_px = smear(frame, limits.blur)
    reached = excluded(frame, limits, wider_px, blur_px)
    sigma, smooth, edge, gross = _sorted_out(residual, view.returned, frame, reached, blur_px, limits, step_m, INDEPENDENT)
    return ViewEvidence(
        view,
        compact(frame),
        single(residual),
        single(sigma),
        smooth,
        edge,
        gross,
        pixels=np.zeros(0, np.int64),
        concavity=concavity,
        step_m=step_m,
        limits=limits,
    )


def _correlated(view: ViewEvidence, wider_px: int, correlation: NoiseCorrelation) -> ViewEvidence:
    """The evidence of a view whose neighbouring pixels share noise, once this is known; what lies near edges does not depend on it.

    The CAD's curved surfaces are seen as the camera's average shows them; what is interpolated between samples lies between these.
    """
    blur_px = smear(view.frame, view.limits.blur)
    reached = excluded(view.frame, view.limits, wider_px, blur_px) if blur_px else view.edge  # A moving view's edges include streaks.
    averaged_px = 1 if correlation.interpolated else correlation.window_px
    bent, beside_creases = averaging_error(view.rendering, view.frame.length, averaged_px)
    residual = view.residual.astype(np.float64) - bent
    returned = view.view.returned
    sigma, smooth, edge, gross = _sorted_out(residual, returned, view.frame, reached, blur_px, view.limits, view.step_m, correlation)
    smooth &= ~beside_creases
    return replace(view, residual=single(residual), sigma=single(sigma), smooth=smooth, edge=edge, gross=gross, correlation=correlation)


def _sorted_out(
    residual: Float,
    returned: Float,
    frame: Frame,
    reached: Mask,
    blur_px: int,
    limits: EvidenceLimits,
    step_m: float,
    correlation: NoiseCorrelation,
) -> tuple[Float, Mask, Mask, Mask]:
    """Sigma in metres, and the masks of smooth, edge and gross pixels, all (H, W); reached (H, W): pixels that mixing or blur may reach."""
    grazing = frame.rendering.incidence > np.radians(limits.grazing_deg)
    keep = (np.abs(residual) < limits.gross_most_mm * 1e-3) & ~reached & ~grazing
    sigma = noise_of(residual, keep, frame.amplitude, step_m, limits.level, correlation)
    gross = np.abs(residual) > gross_bound(sigma, limits)
    edge = reached | streaks(residual, sigma, ~reached & ~gross, limits.blur) if blur_px else reached
    smooth = np.isfinite(residual) & ~edge & ~gross & ~grazing & ~survivors(np.where(gross, 0.0, returned), frame.depth, limits)
    return sigma, smooth, edge, gross


def survivors(right: Float, cad: Float, limits: EvidenceLimits) -> Mask:
    """(H, W) pixels around which most of what the CAD has is lost or gross: survivors of a failure, such as of unwrapping.

    What is left there is what a filter in the camera let pass, up to centimetres off. The mean of a dwell hides such loss: a pixel that
    is lost in four of five captures has a mean in most dwells.

    Args:
        right: (H, W) share of the captures in which a pixel returns, 0 where the mean's error is gross.
        cad: (H, W) metres, NaN off the CAD.
        limits: the least share.
    """
    there = np.isfinite(cad)
    if right[there].min(initial=1.0) == 1.0:
        return np.zeros(there.shape, bool)
    around, of = (uniform_filter(image.astype(np.float32), AROUND_PX) for image in (np.where(there, right, 0.0), there))
    return np.asarray(around < limits.survivors * of)


def compact(frame: Frame) -> Frame:
    """An ideal frame in a tenth of the memory: it shares the rendering's depth, has single precision, and no noise and loss.

    Results of rays and lengths are in double precision as before.
    """
    none, rendering = np.broadcast_to(0.0, frame.depth.shape), frame.rendering
    if not rendering.mixed.any():  # Rendered without footprints, or of one surface: there is no second one.
        rendering = replace(rendering, mixed=np.broadcast_to(np.float32(0), none.shape), second=_unknown(frame))
    return replace(
        frame, rendering=rendering, depth=cast("Float", rendering.depth), amplitude=single(frame.amplitude), sigma=none, missing=none
    )


def single(image: Float) -> Float:
    """An image in single precision, to be kept for every view; results computed from it with poses or rays are in double precision."""
    return cast("Float", image.astype(np.float32))


def without_geometry(view: ViewEvidence) -> ViewEvidence:
    """A view whose columns are computed already: residual, noise and masks stay, and of the frame the camera, pose and surroundings."""
    frame, none = view.frame, _unknown(view.frame)
    rendering = replace(depth_only(frame.camera, none), T_cell_camera=frame.rendering.T_cell_camera)
    frame = replace(frame, rendering=rendering, depth=cast("Float", none), amplitude=cast("Float", none))
    return replace(view, frame=frame, concavity=none)


def _unknown(frame: Frame) -> Image:
    """An image of NaN that takes no memory."""
    return np.broadcast_to(np.float32(np.nan), frame.depth.shape)


def drawn(smooth: Mask, pixels: int, rng: np.random.Generator) -> Ints:
    """(n,) flat indices of the pixels to fit, in order."""
    index = np.flatnonzero(smooth)
    return np.sort(rng.choice(index, min(pixels, len(index)), replace=False))


def less(evidence: Sequence[ViewEvidence], maps: Sequence[Sequence[Float]]) -> tuple[ViewEvidence, ...]:
    """The views with residuals less some maps, (H, W) metres per map and view."""
    if not maps:
        return tuple(evidence)
    return tuple(replace(e, residual=single(e.residual - sum(np.nan_to_num(m[v]) for m in maps))) for v, e in enumerate(evidence))


def over_mean(views: Sequence[ViewEvidence]) -> float:
    """Noise of one capture over that of a dwell's mean, from which noise of rows and pixels is estimated."""
    return float(np.sqrt(np.median([v.view.captures for v in views])))
