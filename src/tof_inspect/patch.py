# SPDX-License-Identifier: Apache-2.0
"""Pixels of a view that a part may cover, and their predicted depth for a motion of the part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_inspect.evidence import log_amplitude

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_inspect.config import InspectConfig
    from tof_inspect.evidence import Seen
    from tof_inspect.shared import SharedErrors
    from tof_inspect.without import Without
    from tof_scene.raycast import Raycaster

MIXED = 0.3
"""Standard deviation of the depth of a pixel at an outline, as a share of the depth step: uniform distribution between both sides."""


def at(shift: Float) -> Float:
    """A motion (4, 4) by a shift (3,)."""
    T = np.eye(4)
    T[:3, 3] = shift
    return T


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Pixels of one view that the part may cover.

    view: index of the view; rays (n, 3) in the cell from origin; z, scale (n,): depth minus the estimated error of the camera, standard
    deviation of the rest; behind (n,): depth without the part; columns (n, k): of the camera's error; cell (n,): cell of neighbours; even
    (n,): every second row and column; place (n,): flat index in the box of pixels (h, w); pixel: angle of a pixel, radians.
    """

    view: int
    origin: Float
    rays: Float
    z: Float
    scale: Float
    behind: Float
    columns: Float
    cell: Ints
    even: Mask
    place: Ints
    box: tuple[int, int]
    pixel: float

    def thinned(self) -> Patch:
        """The patch with every second row and column."""
        k = self.even
        return Patch(
            self.view, self.origin, self.rays[k], self.z[k], self.scale[k], self.behind[k], self.columns[k], self.cell[k], k[k], self.place[k], self.box, self.pixel
        )  # fmt: skip

    def softened(self, depth: Float) -> Patch:
        """The patch with larger scale at the outlines of a predicted depth (n,), where pixels measure a mixture of both sides."""
        image = np.full(self.box, np.nan)
        image.ravel()[self.place] = depth
        gap = np.zeros(self.box)
        gap[1:-1] = np.nan_to_num(np.abs(image[2:] + image[:-2] - 2 * image[1:-1]))
        gap[:, 1:-1] = np.maximum(gap[:, 1:-1], np.nan_to_num(np.abs(image[:, 2:] + image[:, :-2] - 2 * image[:, 1:-1])))
        return replace(self, scale=np.hypot(self.scale, MIXED * gap.ravel()[self.place]))

    def inner(self, on: Mask) -> Mask:
        """Pixels (n,) on the part whose eight neighbours are on it, too."""
        from scipy import ndimage

        image = np.zeros(self.box, bool)
        image.ravel()[self.place] = on
        return np.asarray(ndimage.binary_erosion(image, np.ones((3, 3), bool)).ravel()[self.place])


def patch_of(seen: Seen, part: Float, margin: float, bare: Without, config: InspectConfig, errors: SharedErrors) -> Patch | None:
    """Pixels of a view that the part may cover; None if there are none."""
    T = errors.pose(seen.number)
    camera = seen.view.camera
    inside = se3.apply(se3.inverse(T), part)
    if (inside[:, 2] < 0.05).any():
        return None
    uv = camera.project(inside)
    pad = margin * camera.fx / inside[:, 2].mean() + 2
    low, high = np.nanmin(uv, axis=0) - pad, np.nanmax(uv, axis=0) + pad
    rows = np.arange(max(int(low[1]), 0), min(max(int(high[1]) + 1, 0), camera.height))
    cols = np.arange(max(int(low[0]), 0), min(max(int(high[0]) + 1, 0), camera.width))
    index = (rows[:, None] * camera.width + cols).ravel()
    index = index[(np.isfinite(seen.view.depth) & np.isfinite(seen.sigma)).ravel()[index]]
    if not len(index):
        return None
    row, col = np.divmod(index, camera.width)
    z, in_camera = seen.view.depth.ravel()[index].astype(float), camera.rays()[row, col]
    columns = errors.columns(seen.number, z * np.linalg.norm(in_camera, axis=1), log_amplitude(seen.view, index), index)
    rays = in_camera @ T[:3, :3].T
    return Patch(
        view=seen.number,
        origin=T[:3, 3],
        rays=rays,
        z=z - errors.bias(seen.number, columns),
        scale=np.maximum(np.hypot(seen.sigma.ravel()[index], config.shared_mm * 1e-3), 1e-4),
        behind=bare.cast(T[:3, 3], rays).t,
        columns=columns,
        cell=(row // config.cell_px) * camera.width + col // config.cell_px,
        place=(row - rows[0]) * len(cols) + col - cols[0],
        box=(len(rows), len(cols)),
        pixel=camera.pixel_angle,
        even=((row - row[0]) % 2 == 0) & ((col - cols[0]) % 2 == 0),
    )


def moved_hits(motion: Float, patch: Patch, alone: Raycaster, centre: Float) -> tuple[Float, Mask, Float]:
    """Depth (n,) with the part moved by `motion` about its centre, which rays hit the part, and its normals (n, 3)."""
    back = se3.inverse(about(motion, centre))
    hits = alone.cast(se3.apply(back, patch.origin), patch.rays @ back[:3, :3].T)
    first = np.isfinite(hits.t) & ~(patch.behind < hits.t)
    normal = hits.normal @ back[:3, :3]
    return np.where(first, hits.t, patch.behind), first, normal


def about(motion: Float, centre: Float) -> Float:
    """A motion about a point as a motion about the origin."""
    return np.asarray(at(centre) @ motion @ at(-centre))


def cost_of(motion: Float, patches: Sequence[Patch], alone: Raycaster, centre: Float) -> float:
    """Robust misfit of all pixels around the part, in units of log likelihood."""
    return sum(misfit(p, moved_hits(motion, p, alone, centre)[0]) for p in patches)


def misfit(patch: Patch, depth: Float) -> float:
    """Robust misfit of a predicted depth (n,), in units of log likelihood."""
    u = np.nan_to_num((patch.z - depth) / patch.scale, nan=5.0)
    return float(np.minimum(0.5 * u * u, 6.0).sum())


def linearised(motion: Float, p: Patch, alone: Raycaster, centre: Float) -> tuple[Float, Float, Float, Mask]:
    """Residual (k,), Jacobian (k, 6) for a left perturbation about the part's centre, weight (k,), and mask (n,) of these pixels."""
    depth, on, normal = moved_hits(motion, p, alone, centre)
    facing = np.einsum("ij,ij->i", normal, p.rays)
    on &= (np.abs(facing) > 0.2 * np.linalg.norm(p.rays, axis=1)) & np.isfinite(depth)
    arm = p.origin + p.rays[on] * depth[on, None] - centre
    n = normal[on] / facing[on, None]
    e = p.z[on] - depth[on]
    u = e / p.scale[on]
    w = np.where(np.abs(u) < 5.0, (1.0 - (u / 5.0) ** 2) ** 2, 0.0) / p.scale[on] ** 2
    return e, np.concatenate([n, np.cross(arm, n)], axis=1), w, on
