# SPDX-License-Identifier: Apache-2.0
"""Where the world is not as the CAD has it, for the labels of a session."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_sim_label.reasons import LabelReason
from tof_sim_label.sigma import label_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Bytes, Image
    from tof_core.camera import Camera
    from tof_core.capture import Posed, View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering
    from tof_scene.world.seen import Seen
    from tof_scene.world.surprises import Surprises
    from tof_sim_label.config import LabelConfig


FAR_M = 0.05
"""Residual of which no more is counted: what is farther from the CAD is another surface."""


def session_surprises(views: Sequence[View], posed: Sequence[Posed], caster: Raycaster, config: LabelConfig) -> Surprises:
    """What the views of a session say together; a view whose pose was refused says nothing."""
    from tof_scene.render import render
    from tof_scene.world.surprises import Surprises, find_surprises

    def seen(view: View, pose: Posed) -> Seen:
        rendering = render(caster, pose.seen_by(view.camera), pose.T_cell_camera, footprints=False)
        return seen_of(view, rendering, pose, config)

    accepted = [k for k, p in enumerate(posed) if p.accepted]
    seen_as_measured = [seen(views[k], posed[k]) for k in accepted]
    found = find_surprises(converted(seen_as_measured, [views[k].camera for k in accepted]), caster, config.world)
    pixels = [np.zeros(v.depth.shape, np.uint8) for v in views]
    for k, codes in zip(accepted, found.pixels, strict=True):
        pixels[k] = codes
    return Surprises(tuple(pixels), found.missing, found.foreign).of_views(accepted)


def missing_named(posed: Sequence[Posed], world: Surprises, names: Sequence[str]) -> list[Posed]:
    """The poses, whose verdicts call a part missing that the solution took for one out of its place; names (P,) of the scene's parts."""
    from tof_align.verdict import apart_in_words
    from tof_scene.world.words import missing_in_words

    gone = [m.part for m in world.missing]

    def named(pose: Posed) -> Posed:
        mine = [p for p in gone if len(pose.apart) and pose.apart[p] > 0]
        if not mine:
            return pose
        rest = pose.apart.copy()
        rest[mine] = 0.0
        words = "; ".join(filter(None, [missing_in_words([names[p] for p in mine]), apart_in_words(names, rest)]))
        return replace(pose, verdict=pose.verdict.replace(apart_in_words(names, pose.apart), words), apart=rest)

    return [named(p) for p in posed]


def converted(views: Sequence[Seen], stated: Sequence[Camera]) -> list[Seen]:
    """The views with z along the rays of the lens that each was seen through.

    A camera turns distance into z by the lens that it states, or by the one that it has: whichever leaves less. At the corners of a lens of
    0.5 % the two differ by centimetres, which would be foreign objects.
    """
    longer = [camera.ray_length() / seen.camera.ray_length() for seen, camera in zip(views, stated, strict=True)]
    other = [replace(seen, depth=(seen.depth * ratio).astype(seen.depth.dtype)) for seen, ratio in zip(views, longer, strict=True)]
    as_measured, as_converted = (sum(float(np.nansum(np.minimum(np.abs(s.residual), FAR_M))) for s in each) for each in (views, other))
    return other if as_converted < as_measured else list(views)


def seen_of(view: View, rendering: Rendering, posed: Posed, config: LabelConfig, sigma: Image | None = None) -> Seen:
    """A view beside its rendering at a solved pose.

    The uncertainty is of pose and CAD without what the solution finds parts to stand off (`Posed.parts`): a part that stands
    elsewhere is what is looked for, and must not excuse itself. A label less certain than its limit is masked anyway, and
    allows no more than that. `sigma` (H, W), metres: that uncertainty, where the caller has it.
    """
    from tof_scene.world.seen import Seen

    sigma = label_sigma(rendering, posed.cov_right, config) if sigma is None else sigma
    return Seen(
        camera=rendering.camera,
        T_cell_camera=rendering.T_cell_camera,
        depth=view.depth,
        noise=view.sigma,
        cad=rendering.depth,
        cad_sigma=np.minimum(sigma, config.max_sigma_mm * 1e-3),
        part=rendering.part,
        reason=view.reason,
        amplitude=view.amplitude,
        apart=np.append(posed.parts, 0.0)[rendering.part].astype(np.float32) if len(posed.parts) else None,
    )


def why_not(world: Bytes) -> Bytes:
    """(H, W) `LabelReason` of pixels by the codes of `tof_scene.world.surprises`."""
    from tof_scene.world import surprises as codes

    table = np.zeros(256, np.uint8)
    table[codes.ABSENT], table[codes.BEHIND] = LabelReason.ABSENT, LabelReason.BEHIND
    table[codes.DISPLACED] = LabelReason.DISPLACED
    table[[codes.BEFORE, codes.OBJECT]] = LabelReason.FOREIGN
    return np.asarray(table[world])
