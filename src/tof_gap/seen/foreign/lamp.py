# SPDX-License-Identifier: Apache-2.0
"""Where another camera's lamp stands, by the fringes that its light makes in the views."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.cores import in_threads
from tof_core.stats import beside
from tof_gap.seen.evidence.residual import over_mean
from tof_gap.seen.finding import CONFIDENT, Finding
from tof_gap.seen.foreign.lamp_cells import STEEPEST, Cells, beside_common, beside_loudest_part, cells_of, chi2_of, ridged
from tof_gap.seen.foreign.lamp_light import gains_at, lag_of, waves_from
from tof_gap.seen.foreign.light import field, interference
from tof_sensor.frame import waves_per_m

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_core.camera import Camera
    from tof_gap.limits.foreign import ForeignLampLimits, ForeignLightLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.raycast import Raycaster

FREQUENCY_STEP_MHZ = 20.0
FREQUENCIES_MHZ = tuple(FREQUENCY_STEP_MHZ * n for n in range(1, 7))
"""Modulation frequencies tried, multiples of the first one: fringes of frequencies in between look alike."""
CELL_STEP_M, CELL_REACH_M = 0.5, 1.0
"""Spacing of the places tried in the cell, and how far they extend beyond the measured points."""
HAND_STEP_M, HAND_REACH_M, HAND_LEAST_M = 0.2, 0.6, 0.15
"""The same for places that move with the camera's hand, and their least distance from the lens: the camera's own lamp is nearer."""
SHADOWED = 0.25
"""Share of the places in the cell whose shadows are cast: those that explain most without. A true lamp's place is among them."""
CLEARANCE_M = 2e-3
"""Distance from its surface at which the way from a point to a lamp starts: the mean of a cell's points may lie below a curved one."""
REACH = 0.999
"""Share of the way to a lamp within which a surface casts a shadow."""


@dataclass(frozen=True, slots=True, eq=False)
class ForeignLamp:
    """The lamp of another camera.

    at_m (3,): its place, in the cell or, if `on_hand`, in the camera's frame; mhz: the best of the frequencies tried; share: of the
    views' chi-square beside smooth fields, the part that the lamp explains; hit (V,): views with its light; fields (V, H, W): metres of
    z that the light adds.
    """

    at_m: Float
    on_hand: bool
    mhz: float
    share: float
    hit: Mask
    fields: Float

    @property
    def stated(self) -> str:
        """Where the lamp stands, and which views have its light. Its distance is uncertain beyond a few metres."""
        frame = "on the camera's hand, near" if self.on_hand else "in the cell, within a metre of"
        views = f"{int(self.hit.sum())} of {len(self.hit)} views"
        return f"fringes as of a lamp {frame} ({', '.join(f'{x:.1f}' for x in self.at_m)}) m, in {views}"

    def finding(self, views: Sequence[ViewEvidence], limits: ForeignLightLimits, posed_m: float = 0.0) -> Finding:
        """The finding `interference`, with the light's RMS in the captures that have it; posed_m: metres RMS of it that poses absorbed.

        A smooth field of the same views (`limits`) contains what the model lacks: the lamp's beam, and further lamps.
        """
        lit = np.stack([v.smooth for v in views]) & self.hit[:, None, None]
        rest = [field(replace(v, residual=v.residual - f), limits) for v, f in zip(views, self.fields, strict=True)]
        fields = self.fields + np.stack(rest) * self.hit[:, None, None]
        size = float(np.hypot(np.sqrt(np.mean(fields[lit] ** 2)), posed_m))
        effect = interference(views, over_mean(views) * size, duty=float(self.hit.mean()))
        return Finding(effect, CONFIDENT, share=np.where(lit, np.abs(fields), 0.0), common=fields, note=self.stated, posed_m=posed_m)


def foreign_lamp(views: Sequence[ViewEvidence], caster: Raycaster, limits: ForeignLampLimits) -> ForeignLamp | None:
    """The lamp whose fringes explain most chi-square; None where no place explains much more than the others.

    At a point at range r from the camera and distance d from the lamp, the lamp's light relative to the camera's own has the strength
    cos(i_lamp) r^2 / (cos(i) d^2) and the phase k (d - r), or k (d + 3 r) if its phase changes from tap to tap; k = 2 pi f / c.
    Strength and phase of the beat are new in every view (docs/effects.md). Parts of the scene cast shadows in the lamp's light.

    Args:
        views: at the solution's poses, less all smooth bias.
        caster: the scene.
        limits: share of chi-square from which a lamp is believed.
    """
    cells = [cells_of(v, limits) for v in views]
    if chi2_of(cells) <= limits.chi2 * sum(len(c.error) for c in cells if c is not None):
        return None
    found = _standing_out(cells, caster, limits.share, limits)
    if found is None or (found.on_hand and _in_view(found.at_m, views[0].view.camera)):
        return None
    if not _stands_beside_common(found, beside_loudest_part(beside_common(cells)), caster, limits):
        return None
    hit = found.gains > max(limits.view_chi2, limits.view_share * found.gains.max())
    if hit.sum() < limits.views:
        return None
    fields = [
        _field(v, c, found, caster) if h and c is not None else np.zeros(v.residual.shape)
        for v, c, h in zip(views, cells, hit, strict=True)
    ]
    return ForeignLamp(found.at_m, found.on_hand, found.mhz, found.best / chi2_of(cells), hit, np.stack(fields))


def _in_view(at_m: Float, camera: Camera) -> bool:
    """Whether a place (3,) in the camera's frame lies in its image: a lamp on the hand would be seen there in every view."""
    u, v = camera.project(at_m)
    return bool(0.0 <= u <= camera.width and 0.0 <= v <= camera.height)


def _stands_beside_common(found: _Search, cells: Sequence[Cells | None], caster: Raycaster, limits: ForeignLampLimits) -> bool:
    """Whether a place stands out in these cells, too, and the lamp found before explains enough of them: another error has no one place."""
    gains = _gains(cells, found.at_m[None], None if found.on_hand else caster, on_hand=found.on_hand)
    there = float(gains[:, FREQUENCIES_MHZ.index(found.mhz)].sum())
    return there >= limits.common_share * chi2_of(cells) and _standing_out(cells, caster, limits.common_share, limits) is not None


def _standing_out(cells: Sequence[Cells | None], caster: Raycaster, share: float, limits: ForeignLampLimits) -> _Search | None:
    """The place whose light explains most; None where that is less than `share` of the chi-square, or hardly more than other places."""
    in_cell, on_hand = _search(cells, _places_in_cell(cells), caster), _search(cells, _places_on_hand(), None)
    found = on_hand if on_hand.best > in_cell.best else in_cell
    return None if found.best < max(share * chi2_of(cells), limits.stands_out * in_cell.median) else found


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """The place and the frequency whose light explains most.

    gains (V,): chi-square that they explain in each view; median: chi-square that the median place explains in all views together.
    """

    at_m: Float
    on_hand: bool
    mhz: float
    gains: Float
    median: float

    @property
    def best(self) -> float:
        """Chi-square that the light explains in all views together."""
        return float(self.gains.sum())


def _places_in_cell(cells: Sequence[Cells | None]) -> Float:
    """(n, 3) in the cell."""
    low, high = np.quantile(np.concatenate([c.points for c in cells if c is not None]), [0.02, 0.98], axis=0)
    axes = [np.arange(a - CELL_REACH_M, b + CELL_REACH_M + 1e-9, CELL_STEP_M) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)


def _places_on_hand() -> Float:
    """(n, 3) in the camera's frame."""
    axis = np.arange(-HAND_REACH_M, HAND_REACH_M + 1e-9, HAND_STEP_M)
    places = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    return np.asarray(places[np.linalg.norm(places, axis=1) > HAND_LEAST_M])


def _search(cells: Sequence[Cells | None], places: Float, caster: Raycaster | None) -> _Search:
    """The best of the places: in the cell, with the shadows that its parts cast; without `caster` on the hand, where own and foreign light see alike.

    Shadows take a ray for each place and cell: those of the places that explain most without any are cast.
    """
    on_hand = caster is None
    plain = _gains(cells, places, None, on_hand=on_hand)
    total = plain.sum(axis=0)
    best = np.argsort(total.max(axis=0), kind="stable")[-max(1, round(SHADOWED * len(places))) :]
    gains, tried = (plain, places) if on_hand else (_gains(cells, places[best], caster, on_hand=False), places[best])
    frequency, place = np.unravel_index(int(np.argmax(gains.sum(axis=0))), gains.shape[1:])
    return _Search(tried[place], on_hand, FREQUENCIES_MHZ[int(frequency)], gains[:, frequency, place], float(np.median(total)))


def _gains(cells: Sequence[Cells | None], places: Float, caster: Raycaster | None, *, on_hand: bool) -> Float:
    """(V, frequencies, places) chi-square that a lamp's light explains, with shadows where `caster` is given."""

    def of_view(c: Cells | None) -> Float:
        if c is None:
            return np.zeros((len(FREQUENCIES_MHZ), len(places)))
        at, k = c.in_cell(places, on_hand=on_hand), waves_per_m(FREQUENCY_STEP_MHZ)
        each = c.points, c.normals, c.range_m, c.cosine, lag_of(k, c.range_m), c.sigma, c.smooth, c.error
        return np.asarray(gains_at(at, k, len(FREQUENCIES_MHZ), *each, reached(c.points, c.normals, at, caster)))

    return np.stack(in_threads(of_view, cells))


def reached(points: Float, normals: Float, places: Float, caster: Raycaster | None) -> Mask:
    """(places, n) whether the way from a lamp at each place (places, 3) to points (n, 3) of surfaces is free; all in the cell.

    Without `caster` nothing casts a shadow.
    """
    if caster is None:
        return np.ones((len(places), len(points)), bool)
    one = np.tile(np.arange(len(points), dtype=np.int32), len(places))
    other = np.repeat(np.arange(len(places), dtype=np.int32), len(points))
    starts = np.ascontiguousarray(points + CLEARANCE_M * normals)
    free = ~caster.blocked_between(starts, np.ascontiguousarray(places, np.float64), one, other, REACH)
    return np.asarray(free.reshape(len(places), len(points)))


def _field(view: ViewEvidence, c: Cells, found: _Search, caster: Raycaster) -> Float:
    """(H, W) metres of z that the lamp's light adds to a view; 0 where the CAD has no surface."""
    at, k = c.in_cell(found.at_m, on_hand=found.on_hand), waves_per_m(found.mhz)
    shading = None if found.on_hand else caster
    lit = reached(c.points, c.normals, at[None], shading)[0]
    waves = waves_from(at, k, c.points, c.normals, c.range_m, c.cosine, lag_of(k, c.range_m), lit)
    B = beside(c.smooth, waves.T / c.sigma[:, None])
    strength = np.linalg.solve(ridged(B.T @ B), B.T @ c.error)
    R, t = c.T[:3, :3], c.T[:3, 3]
    points, normals = (np.nan_to_num(a).reshape(-1, 3).astype(np.float64) @ R.T for a in (view.frame.points, view.rendering.normal))
    cosine = np.maximum(np.nan_to_num(np.cos(view.rendering.incidence)).ravel().astype(np.float64), STEEPEST)
    range_m = np.nan_to_num(view.frame.radial).ravel().astype(np.float64)
    lit = reached(points + t, normals, at[None], shading)[0]
    all_waves = waves_from(at, k, points + t, normals, range_m, cosine, lag_of(k, range_m), lit)
    return np.asarray((strength @ all_waves).reshape(view.residual.shape) / view.frame.length)
