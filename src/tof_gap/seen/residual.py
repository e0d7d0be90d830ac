# SPDX-License-Identifier: Apache-2.0
"""What a session shows: residuals at the solved poses, their floor, and the pixels to fit on."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, median_filter

from tof_core.config import param
from tof_core.cores import in_threads
from tof_scene.maps import concavity_map
from tof_sensor.frame import Context, Frame, amplitude_gain, ideal_frame, lambert_amplitude
from tof_sensor.geometry import image_flow

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering


@dataclass(frozen=True, slots=True)
class EvidenceConfig:
    """Which pixels speak."""

    pixels: int = param(3000, "pixels of a view used in fits, drawn evenly", low=200, high=200_000)
    gross_mm: float = param(
        60.0, "residuals beyond this, and beyond five scatters, are counted apart, never fitted", unit="mm", low=5.0, high=1e4
    )
    edge_px: int = param(2, "pixels this near a depth edge are counted apart", unit="px", low=0, high=10)
    grazing_deg: float = param(80.0, "flatter than this is left out", unit="deg", low=30.0, high=90.0)
    seed: int = param(0, "seed of the draw", low=0)


@dataclass(frozen=True, slots=True, eq=False)
class ViewEvidence:
    """One view at its reference pose.

    residual (H, W) metres of z, NaN where either side is missing; sigma (H, W) metres, scatter of
    the view's depth that neighbours agree on; smooth, edge, gross (H, W) masks; pixels (n,) flat
    indices for fits; concavity (H, W) share of a pixel's sky that the scene fills, NaN where not asked for.
    """

    view: View
    frame: Frame
    residual: Float
    sigma: Float
    smooth: Mask
    edge: Mask
    gross: Mask
    pixels: Ints
    concavity: Image

    @property
    def rendering(self) -> Rendering:
        """The CAD at the reference pose."""
        return self.frame.rendering


def gather(
    views: Sequence[View],
    renderings: Sequence[Rendering],
    caster: Raycaster,
    config: EvidenceConfig,
    *,
    sky: bool = False,
    wider_px: int = 0,
) -> tuple[ViewEvidence, ...]:
    """Residuals of all views against the CAD rendered at their reference poses; `sky`: concavity too; `wider_px`: of still views' edges."""

    def one(view: View, frame: Frame) -> ViewEvidence:
        hollow = concavity_map(caster, frame.rendering, CONCAVITY_STRIDE) if sky else np.full(frame.depth.shape, np.nan, np.float32)
        return _of_view(view, frame, config, hollow, wider_px)

    rng = np.random.default_rng(config.seed)  # One draw after the other: the same pixels whichever view is ready first.
    return tuple(
        replace(v, pixels=_drawn(v.smooth, config.pixels, rng)) for v in in_threads(one, views, ideal_frames(views, renderings, caster))
    )


def ideal_frames(views: Sequence[View], renderings: Sequence[Rendering], caster: Raycaster) -> list[Frame]:
    """What a perfect sensor would give for each view of a session, with the amplitude that was measured."""
    start, gain = min(v.stamp_ns for v in views), _gain(views, renderings)

    def one(view: View, rendering: Rendering) -> Frame:
        context = Context(
            temperature=view.temperature,
            time_s=(view.stamp_ns - start) * 1e-9,
            twist=_twist(view),
            caster=caster,
        )
        amplitude = None if view.amplitude is None else view.amplitude.astype(np.float64)
        return ideal_frame(rendering, context, amplitude, gain)

    return in_threads(one, views, renderings)


def _gain(views: Sequence[View], renderings: Sequence[Rendering]) -> float:
    """The camera's unit of amplitude, by which views that have none are to be compared with those that have."""
    lit = [v.amplitude is not None and bool(np.isfinite(v.amplitude).any()) for v in views]
    if all(lit) or not any(lit):
        return 1.0
    seen = [(v.amplitude, r) for v, r, has in zip(views, renderings, lit, strict=True) if has]
    gains = [amplitude_gain(a.astype(np.float64), lambert_amplitude(r)) for a, r in seen if a is not None]
    return float(np.median([g for g in gains if g is not None] or [1.0]))


CONCAVITY_STRIDE = 6
"""Pixels between those whose sky is looked at."""
STANDING = 1e-4
"""Velocities below this (m/s, rad/s) are rounding of TF."""


def _twist(view: View) -> Float:
    """(6,) velocity of the camera, zero where it stands or TF does not tell."""
    twist = None if view.robot is None else view.robot.twist
    return np.zeros(6) if twist is None or np.abs(twist).max() < STANDING else twist


def _of_view(view: View, frame: Frame, config: EvidenceConfig, concavity: Image, wider_px: int) -> ViewEvidence:
    residual = view.depth.astype(np.float64) - frame.depth
    smeared = smear(frame)
    edge = spoiled(frame, config.edge_px, wider_px, smeared)
    flat = frame.rendering.incidence > np.radians(config.grazing_deg)
    # Rounding to coarse steps hides scatter from neighbours that round alike.
    white = scatter(residual, (np.abs(residual) < LOST_M) & ~edge & ~flat, frame.amplitude)
    sigma = np.maximum(white, depth_step(view.depth.astype(np.float64)) / np.sqrt(12))
    gross = np.abs(residual) > np.maximum(config.gross_mm * 1e-3, np.minimum(GROSS_SIGMA * sigma, LOST_M))
    if smeared:
        edge |= streaks(residual, sigma, ~edge & ~gross)
    smooth = np.isfinite(residual) & ~edge & ~gross & ~flat
    return ViewEvidence(view, frame, residual, sigma, smooth, edge, gross, np.zeros(0, np.int64), concavity)


def _drawn(smooth: Mask, pixels: int, rng: np.random.Generator) -> Ints:
    """(n,) flat indices of pixels to fit on, in order."""
    index = np.flatnonzero(smooth)
    return np.sort(rng.choice(index, min(pixels, len(index)), replace=False))


GROSS_SIGMA = 5.0
"""Scatters within which nothing is gross, however weak the light..."""
LOST_M = 0.3
"""... but for what is so far off that it is another surface, or a turn that was lost."""
EXPOSURE_S = 0.2
"""How long a camera may look at most: four taps of some tens of milliseconds."""
TREMBLE_PX = 0.25
"""Smear below which the camera is taken to stand."""
SMEAR_SHARE = 0.04
"""Of the image's width, more than which no edge band grows: something must be left to look at."""


def smear(frame: Frame) -> int:
    """Pixels by which edges smear while the camera moves through an exposure."""
    if not frame.context.twist.any() or not frame.valid.any():
        return 0
    reach = EXPOSURE_S * np.quantile(np.hypot(*image_flow(frame))[frame.valid], 0.9)
    # TF that trembles is no motion.
    return 0 if reach < TREMBLE_PX else min(int(np.ceil(reach)), round(SMEAR_SHARE * frame.camera.width))


def spoiled(frame: Frame, width: int, wider: int, smeared: int) -> Mask:
    """(H, W) pixels that mixing or smear may reach: `width` around depth edges; by `smeared` farther, and around creases, in a moving view.

    `wider` is for still views alone: of moving ones enough is given up.
    """
    return edge_band(frame, width + smeared, creases=True) if smeared else edge_band(frame, width + wider)


STREAK_SIGMA = 5.0
"""Scatters off its neighbourhood from which a pixel of a moving view is on a streak..."""
STREAK_PX = 9
"""... of which the neighbourhood, so many pixels wide, holds less than half."""


def streaks(residual: Float, sigma: Float, keep: Mask) -> Mask:
    """(H, W) thin marks of a moving view: rims and low steps smear as edges do, and no band foretells all of them."""
    keep = keep & np.isfinite(residual)
    if not keep.any():
        return np.zeros(keep.shape, bool)
    nearest = distance_transform_edt(~keep, return_distances=False, return_indices=True)
    around = median_filter(residual[tuple(nearest)], size=STREAK_PX, mode="nearest")
    off = np.abs(residual - around) > STREAK_SIGMA * sigma
    return np.asarray(binary_dilation(off & keep))


CREASE = 0.05
"""Relative step of brightness from one pixel to the next that no smooth surface has."""


def edge_band(frame: Frame, width: int, *, creases: bool = False) -> Mask:
    """(H, W) pixels within `width` of a depth edge or of the end of the CAD; `creases`: of where brightness jumps, too."""
    z = frame.depth
    seam = frame.rendering.mixed > 0
    light = np.log(np.maximum(lambert_amplitude(frame.rendering), 1e-12)) if creases else None
    for axis in (0, 1):
        step = np.abs(np.diff(z, axis=axis))
        tilt = np.tan(np.minimum(np.nan_to_num(frame.rendering.incidence, nan=1.4), 1.4)) * frame.camera.pixel_angle
        expected = z * (2.0 * tilt + 2.0 * frame.camera.pixel_angle)
        limit = np.minimum(np.delete(expected, -1, axis), np.delete(expected, 0, axis))
        jump = ~(step < limit)
        if light is not None:
            jump |= np.abs(np.diff(light, axis=axis)) > CREASE
        pad = [(0, 0), (0, 0)]
        pad[axis] = (0, 1)
        seam = seam | np.pad(jump, pad)
        pad[axis] = (1, 0)
        seam = seam | np.pad(jump, pad)
    seam = seam | ~frame.valid
    return binary_dilation(seam, iterations=width) if width else seam


def scatter(residual: Float, smooth: Mask, amplitude: Float, bins: int = 32) -> Float:
    """(H, W) metres: white scatter of the residual, by amplitude.

    Second differences along rows and columns remove anything smooth; their robust size in bins
    of amplitude is the scatter (TOF_EFFECTS A.5). A pixel outside the bins takes the nearest.
    """
    r = np.where(smooth, residual, np.nan)
    samples, light = [], []
    for axis in (0, 1):
        d2 = np.diff(r, n=2, axis=axis) / np.sqrt(6.0)
        middle = np.delete(np.delete(amplitude, 0, axis), -1, axis)
        seen = np.isfinite(d2) & (middle > 0)
        samples.append(d2[seen])
        light.append(np.log(middle[seen]))
    d2_all, log = np.concatenate(samples), np.concatenate(light)
    if len(d2_all) < 50:
        return np.full(residual.shape, 2e-3)
    order = np.argsort(log)
    d2_all, log = d2_all[order], log[order]
    edges = np.unique(np.quantile(log, np.linspace(0, 1, bins + 1)))
    centres, sizes = [], []
    for a, b in itertools.pairwise([0, *np.searchsorted(log, edges[1:-1]), len(log)]):
        if b - a >= 30:
            centres.append(float(log[a:b].mean()))
            sizes.append(robust_std(d2_all[a:b]))
    if not centres:
        return np.full(residual.shape, robust_std(d2_all))
    logs = np.log(np.maximum(amplitude, 1e-12))
    return np.interp(logs, centres, np.maximum(sizes, 1e-5))


def depth_step(depth: Float) -> float:
    """Metres between the codes of a raw depth image: 0 where it is continuous."""
    z = depth[np.isfinite(depth)].astype(np.float64)
    if len(z) < 100:
        return 0.0
    codes = np.unique(np.round(z, 6))
    gaps = np.diff(codes)
    gaps = gaps[gaps > 5e-6]
    if len(gaps) < 5 or len(codes) > 0.5 * len(z):
        return 0.0
    return float(np.median(gaps))


def robust_std(values: Float) -> float:
    """Standard deviation less what lies beyond five of the MAD's scale: outliers go, a mixture's tails stay."""
    around = values - np.median(values)
    mad = 1.4826 * float(np.median(np.abs(around)))
    if mad <= 0:
        return float(values.std())
    core = around[np.abs(around) < 5.0 * mad]
    return float(np.sqrt((core * core).mean()))
