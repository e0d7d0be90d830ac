# SPDX-License-Identifier: Apache-2.0
"""Missing parts and foreign objects are set apart before poses and effects are solved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.session import solve_session
from tof_core import se3
from tof_core.errors import RefusedError
from tof_gap.seen.world import without_world, world_of
from tof_gap.solve.start import Start, check_fit, observe
from tof_gap.solve.stray import arm_error

if TYPE_CHECKING:
    from tof_align.chain import Chain
    from tof_align.config import AlignConfig
    from tof_core.arrays import Float, Mask
    from tof_gap.config import GapConfig
    from tof_gap.limits.solve import StrayLimits
    from tof_scene.raycast import Raycaster
    from tof_scene.world.surprises import Surprises


def set_apart(begun: Start, caster: Raycaster, config: GapConfig, align: AlignConfig) -> tuple[Surprises, Start]:
    """Missing parts and foreign objects at the first poses, and the start without their pixels.

    Raises:
        RefusedError: the session fits the scene nowhere. This is checked first, as without the pixels that do not fit, any floor would fit.
    """
    check_fit(begun.evidence, config.solve.start)
    world, limits = world_of(begun.evidence, caster, config.world), config.solve.stray
    seen = bool(world.missing or world.foreign)
    if (seen and off_the_robot(begun.chain, limits).any()) or misfits(begun, limits).any():
        begun = _beside_objects(begun, caster, config, align)
        world = world_of(begun.evidence, caster, config.world)
        seen = bool(world.missing or world.foreign)
    if not seen:
        return world, begun
    begun.hand_over()  # Frees these images before the views are rendered again.
    views = without_world(begun.views, world, config.world.rim_px)
    return world, Start(views, begun.chain, observe(views, caster, begun.chain, config, footprints=False))


def off_the_robot(chain: Chain, limits: StrayLimits) -> Mask:
    """(V,) views whose arm the robot's prior excludes; none where poses have covariances of their own."""
    if chain.root is not None:
        return np.zeros(len(chain.arm), bool)
    return np.asarray(_off(chain) > limits.sigma)


def misfits(begun: Start, limits: StrayLimits) -> Mask:
    """(V,) views that leave many pixels far off at a first pose far from the robot's; none where poses are given.

    A pose between the CAD and an object that fills much of the view fits neither.
    """
    if begun.chain.root is not None:
        return np.zeros(len(begun.evidence), bool)
    off = [np.abs(v.residual[np.isfinite(v.residual) & ~v.edge]) > limits.misfit_mm * 1e-3 for v in begun.evidence]
    many = np.array([o.mean() if o.size else 0.0 for o in off]) > limits.misfit_share
    return np.asarray(many & (_off(begun.chain) > limits.misfit_sigma))


def _off(chain: Chain) -> Float:
    """(V,) arm errors of a chain, in standard deviations of the robot's prior."""
    return arm_error(np.array([se3.log(arm) for arm in chain.arm]) / chain.priors.arm)


def _beside_objects(begun: Start, caster: Raycaster, config: GapConfig, align: AlignConfig) -> Start:
    """The start at the poses of the session solution, which allows for objects and displaced parts.

    An object before a part that fills most of a view is taken for the part: the first pose of the view moves it onto the CAD, where
    nothing contradicts. The session solution costs several times the first poses, and is asked only where the robot excludes them, or
    where they fit neither.
    """
    try:
        chain = solve_session(begun.views, caster, align).chain
    except RefusedError:
        return begun
    begun.hand_over()
    return Start(begun.views, chain, observe(begun.views, caster, chain, config, footprints=False))
