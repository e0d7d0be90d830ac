# SPDX-License-Identifier: Apache-2.0
"""Variation of an effect's size from view to view: an error of the camera has the same size in all views."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtri

from tof_gap.seen.evidence.residual import less
from tof_gap.seen.noise.effects import lines_found
from tof_gap.seen.noise.lines import line_noise_by_view
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.noise import Noise
from tof_sensor.geometry import pose_columns
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.limits.report import UnexplainedLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.account import Account


Lines = tuple[int, "Float"]
"""Axis along which pixels share noise, and (V,) metres along the ray of it in each view."""


def uneven(found: Account, limit: UnexplainedLimits, noise: NoiseLimits) -> str | None:
    """The effect whose size varies most over the views, relative to its allowed variation (`Effect.UNEVEN`); None if all are within it.

    A mechanism outside the vocabulary, or another camera's light, makes a known effect win held-out chi-square if its map is similar in
    most views. The fitted size then varies from view to view; that of a constant of the camera does not.
    """
    bare = _less_lamps(found)
    of_lines = any(isinstance(f.effect, Noise) and f.common is not None for f in found.findings)
    lines = [(of.axis, line_noise_by_view(bare, of.axis, noise.lines)) for of in (lines_found(bare, noise) if of_lines else [])]
    smooth = {name: maps for name, maps in found.solved.maps.items() if not EFFECTS[name].SMEARS}
    beyond = {name: spread(bare, maps, limit, lines) / EFFECTS[name].UNEVEN for name, maps in smooth.items()}
    for name in [name for name, share in beyond.items() if share > 1.0]:
        # With poses as they are, an effect lacks what they took of it. Beside free poses, little of it is left, and errors of the
        # other effects' maps weigh more. A constant of the camera is even in one of the two.
        free = spread(bare, smooth[name], limit, lines, arm_and_others(name, smooth, bare, found.solved.arms_sd))
        beyond[name] = min(beyond[name], free / EFFECTS[name].UNEVEN)
    worst = max(beyond, key=beyond.__getitem__, default=None)
    return worst if worst is not None and beyond[worst] > 1.0 else None


def _less_lamps(found: Account) -> Sequence[ViewEvidence]:
    """The views less all effects and less the fringes of another camera's lamp, which differ from view to view.

    The field of light from a lamp that was not placed is fitted freely to each view: taken off, it would hide any unevenness.
    """
    fringes = [list(f.common) for f in found.findings if isinstance(f.effect, Interference) and f.common is not None and not f.structure]
    return less(found.solved.bare, fringes)


def arm_and_others(name: str, maps: Mapping[str, Sequence[Float]], views: Sequence[ViewEvidence], arms_sd: Float) -> Iterator[Float]:
    """Of each view, (H, W, k) metres of z, one standard deviation each of what may be there besides one effect: the arm and the other effects.

    The arm takes what differs from view to view and is alike over a view, and with it the mean of an effect; the others' sizes vary, too.
    """
    others = [(EFFECTS[other].UNEVEN, of) for other, of in maps.items() if other != name]
    for k, (view, sd) in enumerate(zip(views, arms_sd, strict=True)):
        yield np.concatenate([pose_columns(view.frame) * sd, *(share * of[k][..., None] for share, of in others)], axis=-1)


def spread(
    bare: Sequence[ViewEvidence],
    maps: Sequence[Float],
    limit: UnexplainedLimits,
    lines: Sequence[Lines] = (),
    beside: Iterable[Float] | None = None,
) -> float:
    """Standard deviation over the views of an effect's size, over its mean: the part beyond noise, as a lower confidence bound.

    Views are weighted by their information about the size. 0 where fewer than `limit.uneven_views` determine it, or noise explains all.

    Args:
        bare: views less all effects.
        maps: (H, W) metres of z per view that the effect adds.
        limit: how many views are needed, and how sure the least value is.
        lines: noise of whole rows and columns, which many pixels of the map share.
        beside: of each view, (H, W, k) metres of z, one standard deviation each of what may be there besides; None: nothing.
    """
    others = (np.zeros((*m.shape, 0)) for m in maps) if beside is None else beside
    every = enumerate(zip(bare, maps, others, strict=True))
    known = [_size(v, m, [(axis, float(of[k])) for axis, of in lines], other) for k, (v, m, other) in every]
    size, information, noise = (np.array([k[i] for k in known]) for i in range(3))
    whole = float(information.sum())
    if not whole > 0.0:
        return 0.0
    views = whole**2 / float((information**2).sum())
    if views < limit.uneven_views:
        return 0.0
    weight = information / whole
    mean = float(weight @ size)
    variance = float(weight @ (size - mean) ** 2) * views / (views - 1.0)
    least = variance * (views - 1.0) / float(chdtri(views - 1.0, limit.uneven_chance))
    return float(np.sqrt(max(least - float(noise.sum()) / whole, 0.0)) / max(abs(mean), 1e-12))


def _size(view: ViewEvidence, effect: Float, lines: Sequence[tuple[int, float]], beside: Float) -> tuple[float, float, float]:
    """One view's size of an effect, relative to the solution's; the inverse variance of this size for unit noise; the variance of the noise.

    What may be there besides (H, W, k) is estimated with it, from a prior of one standard deviation.
    """
    seen = view.smooth & np.isfinite(effect)
    left = view.residual[seen] / view.sigma[seen]
    columns = np.column_stack([effect[seen], np.nan_to_num(beside[seen])]) / view.sigma[seen, None]
    if not float(columns[:, 0] @ columns[:, 0]) > 0.0:
        return 0.0, 0.0, 0.0
    variance = view.correlation.area * max(1.0, float(left @ left) / len(left))
    prior = variance * np.diag([0.0, *np.ones(beside.shape[-1])])
    of_size = np.linalg.inv(columns.T @ columns + prior)[0]
    lever = columns @ of_size  # What one unit of each pixel's error adds to the size.
    information = 1.0 / float(of_size[0])
    for axis, metres in lines:
        of_line = np.zeros(effect.shape)
        of_line[seen] = lever / (view.sigma[seen] * view.frame.length[seen])
        variance += information * view.correlation.line * metres**2 * float(np.sum(of_line.sum(axis=axis) ** 2))
    return 1.0 + float(lever @ left), information, variance
