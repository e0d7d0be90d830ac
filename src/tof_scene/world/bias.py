# SPDX-License-Identifier: Apache-2.0
"""Rough sensor errors of a session: the parts of the residuals that depend on range, on amplitude and on the view.

Medians are insensitive to differences from the CAD that fill less than half of a bin. Kinds are fitted in turn (backfitting).
The result serves to detect differences from the CAD and is no sensor model.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import group_medians

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_scene.world.limits import WorldLimits
    from tof_scene.world.seen import Seen

ROUNDS = 3
BINS = 16
"""Bins of equal counts over range and over amplitude: each holds a sixteenth of all pixels."""
BIN_PIXELS = 60
"""Fewest pixels of a bin; with fewer, its value is 0."""
PIXELS = 200_000
"""Most pixels of a session that are used."""


def session_bias(views: Sequence[Seen], limits: WorldLimits, doubtful: Sequence[Mask] | None = None) -> list[Float]:
    """(H, W) sensor error in z per view, metres; 0 where nothing is measured.

    A single view has too few surfaces for functions of range or amplitude: a constant only. Parts off their CAD by the session's
    solution are left out, since a large part fills most bins at its range, and so are the pixels `doubtful` (H, W).
    """
    known = [v.in_place(limits) & (np.abs(np.nan_to_num(v.residual, nan=np.inf)) < limits.bias_most_mm * 1e-3) for v in views]
    known = known if doubtful is None else [k & ~d for k, d in zip(known, doubtful, strict=True)]
    step = max(1, sum(int(k.sum()) for k in known) // PIXELS)
    r = np.concatenate([v.residual[k][::step] for v, k in zip(views, known, strict=True)])
    if not len(r):
        return [np.zeros(v.depth.shape) for v in views]
    keys = [_KINDS[k] for k in range(len(_KINDS) if len(views) > 1 else 1)]
    samples = [np.concatenate([key(n, v)[k][::step] for n, (v, k) in enumerate(zip(views, known, strict=True))]) for key in keys]
    fits = _backfit(r, samples, len(views))
    return [
        np.where(np.isfinite(v.residual), sum(fit(key(n, v)) for key, fit in zip(keys, fits, strict=True)), 0.0).astype(np.float32)
        for n, v in enumerate(views)
    ]


def _view(number: int, seen: Seen) -> Float:
    return np.full(seen.depth.shape, float(number))


def _range(_number: int, seen: Seen) -> Float:
    return np.asarray(np.nan_to_num(seen.cad), float)


def _amplitude(_number: int, seen: Seen) -> Float:
    if seen.amplitude is None:
        return np.zeros(seen.depth.shape)
    return np.asarray(np.log(np.maximum(np.nan_to_num(seen.amplitude.astype(float)), 1e-6)))


_KINDS = (_view, _amplitude, _range)


class _Steps:
    """A piecewise linear function through values at bin centres."""

    def __init__(self, centres: Float, values: Float) -> None:
        self.centres, self.values = centres, values

    def __call__(self, x: Float) -> Float:
        return np.asarray(np.interp(x, self.centres, self.values))


def _backfit(r: Float, samples: Sequence[Float], views: int) -> list[_Steps]:
    """One function per kind of sample (n,), each fitted to the residuals (n,) minus the other functions."""
    bins = [_bins(x, views if k == 0 else 0) for k, x in enumerate(samples)]
    share = [np.zeros(len(r)) for _ in samples]
    fits = [_Steps(np.zeros(1), np.zeros(1)) for _ in samples]
    for _ in range(ROUNDS):
        for k, (x, (which, centres)) in enumerate(zip(samples, bins, strict=True)):
            fits[k] = _Steps(centres, group_medians(r - sum(share) + share[k], which, len(centres), BIN_PIXELS))
            share[k] = fits[k](x)
    return fits


def _bins(x: Float, views: int) -> tuple[Ints, Float]:
    """Bin of each sample and the bins' centres: one per view, or of equal counts."""
    if views:
        return x.astype(np.int64), np.arange(float(views))
    edges = np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))
    if len(edges) < 2:
        return np.zeros(len(x), np.int64), edges[:1]
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    return which, 0.5 * (edges[1:] + edges[:-1])
