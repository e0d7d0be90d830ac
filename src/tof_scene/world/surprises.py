# SPDX-License-Identifier: Apache-2.0
"""Differences from the CAD over all views of a session: pixels, absent parts, foreign objects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from tof_scene.world.absent import missing_parts
from tof_scene.world.bias import session_bias
from tof_scene.world.contradiction import EIGHT, allowance, contradictions, smooth_spread, strays
from tof_scene.world.displaced import parts_elsewhere
from tof_scene.world.foreign import foreign_objects

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Bytes, Float, Mask
    from tof_scene.raycast import Raycaster
    from tof_scene.world.absent import Missing
    from tof_scene.world.foreign import Foreign
    from tof_scene.world.limits import WorldLimits
    from tof_scene.world.seen import Seen

NONE, BEFORE, BEHIND, ABSENT, OBJECT, DISPLACED = 0, 1, 2, 3, 4, 5
"""Codes of `Surprises.pixels`: agrees with the CAD, measured before it, measured behind it, on an absent part, on a foreign object, on
a displaced part."""


@dataclass(frozen=True, slots=True, eq=False)
class Surprises:
    """pixels: (H, W) uint8 per view, the codes above; missing: absent parts; foreign: foreign objects."""

    pixels: tuple[Bytes, ...]
    missing: tuple[Missing, ...]
    foreign: tuple[Foreign, ...]

    def of_views(self, numbers: Sequence[int]) -> Surprises:
        """The same with view v renumbered to `numbers[v]`, for views selected from a session."""
        missing = (replace(m, views=tuple(numbers[v] for v in m.views)) for m in self.missing)
        foreign = (replace(f, views=tuple(numbers[v] for v in f.views)) for f in self.foreign)
        return Surprises(self.pixels, tuple(missing), tuple(foreign))


def find_surprises(views: Sequence[Seen], caster: Raycaster, limits: WorldLimits) -> Surprises:
    """Find contradictions view by view, then combine the views: an absent part is absent in all, an object is at one place in all."""
    bias = _bias(views, limits)
    spread = smooth_spread(views, bias, limits)
    sides = [contradictions(v, b, spread, limits) for v, b in zip(views, bias, strict=True)]
    before, behind = [s[0] for s in sides], [s[1] for s in sides]
    measured = [v.depth - b for v, b in zip(views, bias, strict=True)]
    missing = missing_parts(views, behind, measured, spread, caster, limits)
    moved = parts_elsewhere(views, behind, caster.scene, limits)
    objects = foreign_objects(views, before, measured, limits)
    elsewhere = [o for o in objects if any(part.may_be(o, limits) for part in moved)]
    foreign = tuple(o for o in objects if o not in elsewhere)
    gone = [m.part for m in missing]
    pixels = []
    for number, seen in enumerate(views):
        code = np.zeros(seen.depth.shape, np.uint8)
        code[before[number]], code[behind[number]] = BEFORE, BEHIND
        for things, name in ((elsewhere, DISPLACED), (foreign, OBJECT)):
            here = [f.points for f in things if (len(f.views) > 1 and not f.moves) or number in f.views]
            code[_of_objects(seen, measured[number], before[number], here, spread, limits)] = name
        code[np.isin(seen.part, gone)] = ABSENT
        pixels.append(_with_strays(seen, bias[number], code, limits))
    return Surprises(tuple(pixels), missing, foreign)


def _bias(views: Sequence[Seen], limits: WorldLimits) -> list[Float]:
    """(H, W) sensor error in z per view, metres.

    With a part off its CAD, pixels that contradict the CAD within their own view are left out, since the part fills its bins of range.
    """
    if all(v.in_place(limits).all() for v in views):
        return session_bias(views, limits)
    doubtful = []
    for seen in views:
        own = session_bias([seen], limits)
        before, behind = contradictions(seen, own[0], smooth_spread([seen], own, limits), limits)
        doubtful.append(before | behind)
    return session_bias(views, limits, doubtful)


def view_surprises(seen: Seen, limits: WorldLimits) -> Bytes:
    """(H, W) the codes of a single view."""
    bias = session_bias([seen], limits)
    before, behind = contradictions(seen, bias[0], smooth_spread([seen], bias, limits), limits)
    code = np.where(before, np.uint8(BEFORE), np.where(behind, np.uint8(BEHIND), np.uint8(NONE)))
    return _with_strays(seen, bias[0], code, limits)


def _with_strays(seen: Seen, bias: Float, code: Bytes, limits: WorldLimits) -> Bytes:
    """(H, W) the codes of a view, with single deviating pixels beside the known ones added."""
    stray = strays(seen, bias, code > NONE, limits) & (code == NONE)
    return np.where(stray, np.where(seen.residual < bias, np.uint8(BEFORE), np.uint8(BEHIND)), code)


def _of_objects(seen: Seen, measured: Float, before: Mask, objects: Sequence[Float], spread: float, limits: WorldLimits) -> Mask:
    """(H, W) pixels on objects, given by their points (n, 3): pixels measured at these points, and pixels without a return within the outline."""
    out = np.zeros(seen.depth.shape, bool)
    if not objects:
        return out
    tree = cKDTree(np.concatenate(objects))
    with np.errstate(invalid="ignore"):
        near = ndimage.binary_dilation(before, EIGHT, iterations=3) | (measured < seen.cad)
        doubtful = near & np.isfinite(measured) & (seen.cad - measured > limits.weak * allowance(seen, spread, limits))
    distance, _ = tree.query(seen.points(doubtful, measured), distance_upper_bound=limits.agree_mm * 1e-3)
    out[doubtful] = np.isfinite(distance)
    # Pixels at the rim of an object have no return: its outline is that of the points of all views, projected into this one.
    row, column, depth, inside = seen.pixels_of(np.concatenate(objects))
    outline = np.zeros(seen.depth.shape, bool)
    ahead = inside & (seen.cad[row, column] - depth > 1e-3 * limits.least_mm)
    outline[row[ahead], column[ahead]] = True
    outline = ndimage.binary_closing(outline, EIGHT)
    return np.asarray(out | (outline & ~np.isfinite(measured)))
