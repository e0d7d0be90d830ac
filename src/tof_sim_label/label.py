# SPDX-License-Identifier: Apache-2.0
"""The label of a view: the CAD rendered at the camera's solved pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.reasons import Reason
from tof_sim_label.config import LabelConfig
from tof_sim_label.sigma import label_sigma

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Image, Ints, Mask
    from tof_core.capture import Posed, View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering


@dataclass(frozen=True, slots=True, eq=False)
class Label:
    """The depth that every pixel of a view should have measured. All arrays are (H, W).

    depth: z in metres, NaN where the ray misses the CAD; in a pixel that sees two surfaces, the
    one that fills most of it. sigma: standard deviation of depth, metres. mask: uint8, 1 where it
    may be trained on. part: int16 index of the scene's part, -1 none. mixed: share of the second
    surface, 0 to 0.5. incidence: radians.
    """

    depth: Image
    sigma: Image
    mask: Bytes
    part: Ints
    mixed: Image
    incidence: Image
    posed: Posed


def label_view(view: View, posed: Posed, caster: Raycaster, config: LabelConfig | None = None) -> Label:
    """Render the label of `view` at a solved pose, with its uncertainty and its mask."""
    from tof_scene.render import render

    config = config or LabelConfig()
    rendering = render(caster, view.camera, posed.T_cell_camera)
    sigma = label_sigma(rendering, posed.cov_right, config)
    usable = _usable(view, rendering, sigma, config) & posed.accepted
    return Label(
        depth=rendering.depth,
        sigma=sigma,
        mask=usable.astype(np.uint8),
        part=rendering.part,
        mixed=rendering.mixed,
        incidence=rendering.incidence,
        posed=posed,
    )


def _usable(view: View, rendering: Rendering, sigma: Image, config: LabelConfig) -> Mask:
    """Pixels that see the CAD, below the incidence limit and the sigma limit, with no foreign object in front or in its place."""
    on_cad = (sigma <= config.max_sigma_mm * 1e-3) & (rendering.incidence <= np.radians(config.max_incidence_deg))
    return np.asarray(on_cad & (view.reason != Reason.SELF) & ~foreign(view, rendering.depth, sigma, config))


def foreign(view: View, label: Image, sigma: Image, config: LabelConfig) -> Mask:
    """Patches (H, W) measured away from the CAD: a hand in front of the part, or a missing part.

    Labels must keep sensor errors, so only patches that are both far off and large count: mixed
    pixels are thin, and multipath and wiggling stay below `foreign_mm`.
    """
    import cv2

    measured = np.where(np.isfinite(view.sigma), view.sigma, 0.0)
    allowed = config.foreign_mm * 1e-3 + 3.0 * np.hypot(sigma, measured)
    far = (np.abs(view.depth - label) > allowed).astype(np.uint8)
    square = np.ones((3, 3), np.uint8)
    _, patch, stats, _ = cv2.connectedComponentsWithStats(cv2.morphologyEx(far, cv2.MORPH_OPEN, square))
    large = stats[:, cv2.CC_STAT_AREA] >= config.foreign_px
    large[0] = False
    # One more pixel all round: the rim of a patch is mixed pixels.
    return np.asarray(cv2.dilate(large[patch].astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
