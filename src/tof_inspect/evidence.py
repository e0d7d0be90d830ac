# SPDX-License-Identifier: Apache-2.0
"""Depth as evidence for a part: likelihood of the scene with the part against the scene without it, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_align.pixels import view_sigma
from tof_core.stats import grouped
from tof_scene.render import render

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints, Mask
    from tof_core.camera import Camera
    from tof_core.capture import Posed, View
    from tof_inspect.config import InspectConfig
    from tof_inspect.shared import SharedErrors
    from tof_inspect.without import Without
    from tof_scene.raycast import Raycaster
    from tof_scene.rendering import Rendering


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A view at its pose with the whole CAD rendered.

    number: index of the view in the session; noise (H, W): standard deviation of the measurement, metres along z; sigma (H, W): the same
    with the errors of pose and pixel footprint.
    """

    number: int
    view: View
    posed: Posed
    whole: Rendering
    noise: Float
    sigma: Float


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Evidence of one view for one part.

    pixels: valid pixels of the part where presence and absence differ by `stand_out` times the noise: they make it observable; covered:
    pixels that the part covers by the CAD; log_ratio: log likelihood ratio of present over absent, in which neighbouring pixels count as
    correlated; index (n,): flat indices of the pixels used (no mixed, grazing or rim pixels where there are others); present, absent,
    measured, sigma (n,): metres.
    """

    pixels: int
    covered: int
    log_ratio: float
    index: Ints
    present: Float
    absent: Float
    measured: Float
    sigma: Float


@dataclass(frozen=True, slots=True)
class Ratios:
    """Log likelihood ratios of presence: by depth (at the part's place or displaced), by colour (at its place), by both."""

    depth: float
    colour: float
    fused: float

    @classmethod
    def of(cls, depth: float, colour: float, moved: float = -np.inf) -> Ratios:
        """`moved`: ratio of depth at the best displaced pose, since a displaced part is present.

        Colour is measured at the part's place in the CAD, so it is evidence for that place only.
        """
        return cls(max(depth, moved), colour, max(depth + colour, moved))


def see(view: View, posed: Posed, caster: Raycaster, config: InspectConfig, number: int = 0) -> Seen:
    """Render the whole CAD at the view's pose, with the sigma of each pixel."""
    whole = render(caster, view.camera, posed.T_cell_camera)
    noise = view_sigma(view, config.weights, np.ix_(*map(np.arange, view.depth.shape)))
    slope = np.tan(np.minimum(whole.incidence, np.radians(85.0)))
    footprint = 0.3 * view.camera.pixel_angle * whole.depth * slope
    cov = posed.cov_right
    rays = view.camera.rays()
    along = np.sqrt(np.einsum("ijk,kl,ijl->ij", rays, cov[:3, :3], rays) / view.camera.ray_length() ** 2)
    turn = np.sqrt(np.trace(cov[3:, 3:])) * np.nan_to_num(whole.depth) * slope
    across = np.sqrt(np.trace(cov[:3, :3])) * slope
    sigma = np.sqrt(noise**2 + np.nan_to_num(footprint) ** 2 + along**2 + np.nan_to_num(turn) ** 2 + np.nan_to_num(across) ** 2)
    return Seen(number, view, posed, whole, noise, np.asarray(sigma, float))


def log_amplitude(view: View, index: Ints) -> Float:
    """(n,) natural logarithm of the amplitude of pixels (flat indices), NaN where it is unknown."""
    if view.amplitude is None:
        return np.full(len(index), np.nan)
    a = view.amplitude.ravel()[index].astype(float)
    return np.where(a > 0, np.log(np.where(a > 0, a, 1.0)), np.nan)


def agreement(seen: Seen) -> float:
    """Share of the pixels within 10 mm (or four sigmas) of the CAD; edges and grazing pixels are left out.

    On large faces a pose that is off by centimetres may fit; parts would then be compared with the wrong pixels.
    """
    error = np.abs(seen.view.depth - seen.whole.depth)
    clear = np.isfinite(error) & (seen.whole.mixed < 0.02) & (seen.whole.incidence < np.radians(75.0))
    return float((error[clear] < np.maximum(0.01, 4.0 * seen.noise[clear])).mean()) if clear.any() else 0.0


def weigh(seen: Seen, without: Without, part: int, config: InspectConfig, errors: SharedErrors) -> Evidence:
    """Evidence of one view for one part, from the depth minus the estimated error of the camera.

    The likelihood of a pixel is a Gaussian of its sigma plus a share `outliers` spread over `wide_m` (mirrors, cables, dropouts), which
    bounds the log ratio of a single pixel. The sum over a cell of `cell_px` pixels is divided by the square root of their number, since
    errors within a cell are correlated.
    """
    view, whole = seen.view, seen.whole
    covered = whole.part == part
    present, absent = whole.depth.astype(float), render_at(without, view.camera, seen.posed.T_cell_camera, covered)
    both = covered & view.valid & np.isfinite(present) & np.isfinite(absent)
    gap = np.abs(present - absent)
    outstanding = both & (gap > config.stand_out * seen.noise)
    scale = np.hypot(seen.sigma, config.shared_mm * 1e-3)
    clear = both & (whole.mixed <= config.mixed) & (whole.incidence < np.radians(config.grazing_deg)) & (gap > config.stand_out * scale)
    index = _clearest([clear & eroded(covered), clear, outstanding])
    z = view.depth.ravel()[index].astype(float)
    radial = z * view.camera.ray_length().ravel()[index]
    z -= errors.bias(seen.number, errors.columns(seen.number, radial, log_amplitude(view, index), index))
    s = scale.ravel()[index]
    p, a = present.ravel()[index], absent.ravel()[index]
    ratio = _log_likelihood(z - p, s, config) - _log_likelihood(z - a, s, config)
    return Evidence(int(outstanding.sum()), int(covered.sum()), _together(ratio, index, view.camera.width, config), index, p, a, z, s)


def eroded(mask: Mask) -> Mask:
    """A mask (H, W) without its outermost ring of pixels."""
    from scipy import ndimage

    return np.asarray(ndimage.binary_erosion(mask))


def _clearest(choices: list[Mask], enough: int = 20) -> Ints:
    """Flat indices of the first choice with enough pixels, or of the last."""
    for mask in choices:
        if int(mask.sum()) >= enough:
            return np.flatnonzero(mask)
    return np.flatnonzero(choices[-1])


def render_at(without: Without, camera: Camera, T: Float, where: Mask) -> Float:
    """(H, W) z of the scene without the part at the pixels `where`; NaN elsewhere."""
    out = np.full(where.shape, np.nan)
    rays = camera.rays()[where]
    if len(rays):
        out[where] = without.cast(T[:3, 3], rays @ T[:3, :3].T).t
    return out


def _log_likelihood(error: Float, sigma: Float, config: InspectConfig) -> Float:
    inside = (1.0 - config.outliers) * np.exp(-0.5 * (error / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    return np.asarray(np.log(inside + config.outliers / config.wide_m))


def _together(ratio: Float, index: Ints, width: int, config: InspectConfig) -> float:
    """Sum of log ratios; n pixels of one cell count as the square root of n."""
    if not len(ratio):
        return 0.0
    row, col = np.divmod(index, width)
    cells = grouped(row // config.cell_px, col // config.cell_px)
    return float((cells.sum(ratio) / np.sqrt(cells.count)).sum())
