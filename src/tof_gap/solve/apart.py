# SPDX-License-Identifier: Apache-2.0
"""Missing parts and foreign objects are set apart before poses and effects are solved."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.seen.world import without_world, world_of
from tof_gap.solve.start import Start, check_fit, observe

if TYPE_CHECKING:
    from tof_gap.config import GapConfig
    from tof_scene.raycast import Raycaster
    from tof_scene.world.surprises import Surprises


def set_apart(begun: Start, caster: Raycaster, config: GapConfig) -> tuple[Surprises, Start]:
    """Missing parts and foreign objects at the first poses, and the start without their pixels.

    Raises:
        RefusedError: the session fits the scene nowhere. This is checked first, as without the pixels that do not fit, any floor would fit.
    """
    check_fit(begun.evidence, config.solve.start)
    world = world_of(begun.evidence, caster, config.world)
    if not (world.missing or world.foreign):
        return world, begun
    begun.hand_over()  # Frees these images before the views are rendered again.
    views = without_world(begun.views, world, config.world.rim_px)
    return world, Start(views, begun.chain, observe(views, caster, begun.chain, config, footprints=False))
