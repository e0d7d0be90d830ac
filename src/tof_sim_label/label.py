# SPDX-License-Identifier: Apache-2.0
"""The label of a view: the CAD rendered at the camera's solved pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.reasons import Reason
from tof_sim_label.config import LabelConfig
from tof_sim_label.reasons import LabelReason
from tof_sim_label.sigma import label_sigma
from tof_sim_label.world import seen_of, why_not

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Image, Ints
    from tof_core.capture import Posed, View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering


@dataclass(frozen=True, slots=True, eq=False)
class Label:
    """The depth that every pixel of a view should have measured. All arrays are (H, W).

    depth: z in metres, NaN where the ray misses the CAD; in a pixel that sees two surfaces, the
    one that fills most of it. sigma: standard deviation of depth, metres. mask: uint8, 1 where it
    may be trained on. reason: uint8, why not (`LabelReason`). part: int16 index of the scene's part, -1 none. mixed: share of the second
    surface, 0 to 0.5. incidence: radians.
    """

    depth: Image
    sigma: Image
    mask: Bytes
    reason: Bytes
    part: Ints
    mixed: Image
    incidence: Image
    posed: Posed


def label_view(
    view: View,
    posed: Posed,
    caster: Raycaster,
    config: LabelConfig | None = None,
    world: Bytes | None = None,
    rendering: Rendering | None = None,
) -> Label:
    """Render the label of `view` at a solved pose, with its uncertainty and its mask.

    Args:
        view: the view.
        posed: the solved pose of its camera.
        caster: the scene.
        config: uncertainty and mask.
        world: (H, W) reasons where measurement and CAD contradict each other in all views of the session (`session_surprises`);
            None: this view is judged by itself.
        rendering: of the scene at that pose, where the caller has it.
    """
    from tof_scene.render import render
    from tof_scene.world.surprises import view_surprises

    config = config or LabelConfig()
    rendering = rendering or render(caster, posed.seen_by(view.camera), posed.T_cell_camera)
    sigma = label_sigma(rendering, posed.cov_right, config, posed.parts)
    if world is None:
        without_parts = None if posed.parts.any() else sigma
        world = view_surprises(seen_of(view, rendering, posed, config, without_parts), config.world)
    reason = _reasons(view, rendering, sigma, why_not(world), config, accepted=posed.accepted)
    return Label(
        depth=rendering.depth,
        sigma=sigma,
        mask=(reason == LabelReason.USABLE).astype(np.uint8),
        reason=reason,
        part=rendering.part,
        mixed=rendering.mixed,
        incidence=rendering.incidence,
        posed=posed,
    )


def _reasons(view: View, rendering: Rendering, sigma: Image, world: Bytes, config: LabelConfig, *, accepted: bool) -> Bytes:
    """(H, W) the first reason that applies."""
    if not accepted:
        return np.full(sigma.shape, LabelReason.POSE, np.uint8)
    applies = {
        LabelReason.NO_CAD: ~np.isfinite(sigma),
        LabelReason.ROBOT: view.reason == Reason.SELF,
        LabelReason.GRAZING: rendering.incidence > np.radians(config.max_incidence_deg),
        LabelReason.ABSENT: world == LabelReason.ABSENT,  # Before UNCERTAIN: an absent part appears displaced, which raises sigma, too.
        LabelReason.UNCERTAIN: sigma > config.max_sigma_mm * 1e-3,
    }
    return np.select(list(applies.values()), [np.uint8(code) for code in applies], world)
