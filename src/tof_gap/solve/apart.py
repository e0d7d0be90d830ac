# SPDX-License-Identifier: Apache-2.0
"""Missing parts and foreign objects are set apart before poses and effects are solved; thin objects on parts once poses are known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tof_align.session import solve_session
from tof_core import se3
from tof_core.errors import RefusedError
from tof_gap.seen.world import without_world, world_of
from tof_gap.solve.start import Start, check_fit, observe
from tof_gap.solve.stray import arm_error
from tof_scene.world.surprises import OBJECT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Chain
    from tof_align.config import AlignConfig
    from tof_core.arrays import Float, Mask
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.limits.solve import StrayLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solved import Solved
    from tof_scene.raycast import Raycaster
    from tof_scene.world.foreign import Foreign
    from tof_scene.world.surprises import Surprises

POSED_MM, THIN_MM, LIES_MM = 1.0, 3.0, 4.0
"""Where poses are known: error of the rendered depth, least contradiction, and by how much a thin object stands out of its part at least. At the
poses found, depth was off by 0.96 mm at most in 90 % of 22 sessions; three times that is no error of the poses."""
AROUND = 0.5
"""Distance from a thin object, over the diagonal of its box, within which no pixel is evidence: of a box that stands out of a crate by 0 to 10 mm,
a strip on a second side was too narrow to be found."""


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


def thin_apart(world: Surprises, views: Sequence[View], solved: Solved, config: GapConfig) -> tuple[Surprises, Start] | None:
    """`world` with the objects on parts that stand out too little to be found at first poses, and the start without their pixels; None without any.

    A nameplate, a tag or a cable on a part resembles a bend of the part, but ends in a step.

    Args:
        world: what was set apart before.
        views: without that.
        solved: their solution, whose poses and bias make the objects stand out.
        config: limits of objects at first poses; those of thin ones are `POSED_MM`, `THIN_MM` and `LIES_MM`.
    """
    closer = replace(config.world, pose_mm=POSED_MM, world=replace(config.world.world, least_mm=THIN_MM, lies_mm=LIES_MM))
    searched = world_of([_less_bias(v) for v in solved.bare], solved.caster, closer).foreign
    found = [thing for thing in searched if len(thing.views) > 1]  # What a single view shows stands out far, and was found before.
    if not found:
        return None
    pixels = tuple(np.where(_around(v, found), np.uint8(OBJECT), old) for v, old in zip(solved.bare, world.pixels, strict=True))
    both = replace(world, pixels=pixels, foreign=(*world.foreign, *found))
    without = without_world(views, both, config.world.rim_px)
    return both, Start(without, solved.chain, observe(without, solved.caster, solved.chain, config, footprints=False))


def _less_bias(view: ViewEvidence) -> ViewEvidence:
    """The view as it would be measured without the bias that its residual is less."""
    return replace(view, view=replace(view.view, depth=(view.frame.depth + view.residual).astype(np.float32)))


def _around(view: ViewEvidence, things: Sequence[Foreign]) -> Mask:
    """(H, W) pixels whose place on the CAD lies near one of these objects: what is thin, or flush with a part on one side, is not seen whole."""
    drawn = np.isfinite(view.rendering.depth)
    out = np.zeros(drawn.shape, bool)
    points = se3.apply(view.rendering.T_cell_camera, view.view.camera.points(view.rendering.depth)[drawn])
    for thing in things:
        reach = AROUND * float(np.linalg.norm(thing.size_m))
        distance, _ = cKDTree(thing.points).query(points, distance_upper_bound=reach)
        out[drawn] |= np.isfinite(distance)
    return out


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
