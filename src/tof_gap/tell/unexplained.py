# SPDX-License-Identifier: Apache-2.0
"""What no named effect explains: is it structured, where is it, what does it depend on?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.tell.shrink import BLOCK_PX, SCATTER_KNOWN
from tof_gap.tell.where import by_quantity
from tof_sensor.effect import Evidence
from tof_sensor.effects.phase_wrap import PhaseWrap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.finding import Finding
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.tell.account import Account
    from tof_scene.scene import Scene

STRUCTURED_MM = 0.7
"""Block-mean error above the floor from which what is left has structure worth a name..."""
STRUCTURED_SHARE = 0.12
"""... and its share of the whole gap's energy above the floor."""
MISFIT_SHARE = 0.25
"""Of the chi-square above the floor at the solution's poses, what a sufficient answer may leave at most."""
ARMS_ALIKE = 22.5
"""Chi-square of six that one session in a thousand exceeds: arms that err alike by more are off their mount."""


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What is left above the floor.

    structured: blocks agree that something is left; depends_on: quantities that it varies with, most first; where:
    parts that carry it, most first.
    """

    rmse_mm: float
    structured: bool
    depends_on: tuple[str, ...]
    where: tuple[str, ...]


def look(found: Account, scene: Scene) -> Unexplained:
    """Judge what the named effects leave, against the floor.

    It is structured where block means agree that something is left. Where neighbours err alike by a named noise (steps, rows, beats),
    that much structure is the noise's own. Structured besides: pixels off by more than any bias, away from edges, unless
    `phase_wrap` was named, here and where the solution was linearised; effects that show in noise, loss or edges and may not be
    named; an error that only a free function of an observable describes; small effects that explain much only together; a joint
    fit that leaves a share of what it was to explain; arm errors that are alike in every view.
    """
    solved, figures, gap = found.solved, found.figures, found.gap
    views, left, floor2 = solved.evidence, figures.left(), figures.floors
    block, mean, expected, part = _block_means(views, left, floor2)
    if len(block) == 0:
        return Unexplained(0.0, structured=False, depends_on=(), where=())
    excess2 = np.average(mean**2 - expected, weights=block)
    size = 1e3 * float(np.sqrt(max(excess2, 0.0)))
    before2 = max((gap.before.rmse**2 - gap.floor_mm**2), 1e-9)
    gross_named = any(f.name == PhaseWrap.NAME for f in found.findings)
    gross = 0.0 if gross_named else min(_gross_share(v) for v in (views, solved.linearised))
    blocks_agree = size > np.hypot(STRUCTURED_MM, 1e3 * figures.alike_m) and size**2 > STRUCTURED_SHARE * before2
    depends_on = (*solved.depends_on, "hand") if solved.arms_alike > ARMS_ALIKE else solved.depends_on
    unexplained = misfit(views, figures.residual, left, _noise2(found)) > MISFIT_SHARE
    structured = blocks_agree or gross > GROSS_SHARE or bool(depends_on) or bool(solved.small_together) or unexplained
    energy = np.bincount(part, block * np.maximum(mean**2 - expected, 0), len(scene.parts))
    if found.withheld:
        structured = True
        energy = np.sum([_carried(views, f, len(scene.parts)) for f in found.withheld], axis=0)
    order = [i for i in np.argsort(-energy) if energy[i] > 0.1 * energy.sum()]
    return Unexplained(
        size,
        structured=bool(structured),
        depends_on=(depends_on or _depends_on(views, left, floor2)) if structured else (),
        where=tuple(scene.parts[int(i)].name for i in order[:4]) if structured else (),
    )


def _noise2(found: Account) -> list[Float]:
    """(H, W) m^2 per view that no bias need explain: floor, named noise (not white perhaps, but named), and the pattern's own doubt."""
    nothing = np.zeros((len(found.figures.floors), *found.figures.floors[0].shape))
    named = [np.nan_to_num(f.share) ** 2 for f in found.findings if f.effect.EVIDENCE is Evidence.SCATTER and f.share is not None]
    return [f + s + found.figures.unsure2 for f, s in zip(found.figures.floors, np.sum([nothing, *named], axis=0), strict=True)]


def misfit(views: Sequence[ViewEvidence], before: Sequence[Float], left: Sequence[Float], floor2: Sequence[Float]) -> float:
    """Of what chi-square per pixel exceeds the floor before anything is taken off, the share that is left; 0 where that is no misfit."""

    def excess(errors: Sequence[Float]) -> float:
        each = [(e**2 / f)[v.smooth & np.isfinite(e)] for v, e, f in zip(views, errors, floor2, strict=True)]
        return float(np.concatenate(each).mean()) - 1.0

    after = excess(left)
    return 0.0 if after < SCATTER_KNOWN else after / max(excess(before), after)


GROSS_SHARE = 0.004
"""Pixels away from edges that may be grossly off in a sound session (what stands in the cell beside the CAD)."""


def _carried(views: Sequence[ViewEvidence], finding: Finding, parts: int) -> Float:
    """(parts,) energy of what a finding does, by the part that it does it to."""
    out = np.zeros(parts)
    for v, share in zip(views, finding.share if finding.share is not None else [], strict=False):
        seen = np.isfinite(share) & (v.rendering.part >= 0)
        out += np.bincount(v.rendering.part[seen].astype(np.int64), share[seen] ** 2, parts)
    return out


def _gross_share(views: Sequence[ViewEvidence]) -> float:
    return float(np.mean([(v.gross & ~v.edge).sum() / max((np.isfinite(v.residual) & ~v.edge).sum(), 1) for v in views]))


def _block_means(
    views: Sequence[ViewEvidence],
    left: Sequence[Float],
    floor2: Sequence[Float],
) -> tuple[Float, Float, Float, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Per block and part: pixels, mean error, its variance if errors were white, and the part."""
    n_all, mean_all, var_all, part_all = [], [], [], []
    for v, e, f in zip(views, left, floor2, strict=True):
        seen = np.isfinite(e) & (v.rendering.part >= 0)
        rows, columns = np.nonzero(seen)
        part = v.rendering.part[seen].astype(np.int64)
        key = ((rows // BLOCK_PX) * 1000 + columns // BLOCK_PX) * 1000 + part
        unique, which = np.unique(key, return_inverse=True)
        n = np.bincount(which)
        enough = n >= 40
        n_all.append(n[enough].astype(float))
        mean_all.append((np.bincount(which, e[seen]) / n)[enough])
        var_all.append((np.bincount(which, f[seen]) / n**2)[enough])
        part_all.append((unique % 1000)[enough])
    return np.concatenate(n_all), np.concatenate(mean_all), np.concatenate(var_all), np.concatenate(part_all)


def _depends_on(views: Sequence[ViewEvidence], left: Sequence[Float], floor2: Sequence[Float]) -> tuple[str, ...]:
    """Quantities whose bins' means carry a tenth or more of what is left, most first."""
    carried = {}
    for name, bins in by_quantity(views, left, floor2).items():
        n = np.array([b.pixels for b in bins], float)
        if len(n) < 3:
            continue
        mean, square, floor = (np.array([getattr(b, k) for b in bins]) for k in ("bias_mm", "rmse_mm", "floor_mm"))
        above = max(float(n @ (square**2 - floor**2)), 1e-9)
        carried[name] = float(n @ (mean - np.average(mean, weights=n)) ** 2) / above
    return tuple(k for k, s in sorted(carried.items(), key=lambda kv: -kv[1]) if s > 0.1)[:4]
