# SPDX-License-Identifier: Apache-2.0
"""The solution of a session for the report: poses, named effects, their maps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.raycast import Raycaster
    from tof_sensor.effect import Effect


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """One named effect.

    effects: its instances (one per part where parts differ); std: deviations of their parameters, in the same order; ties: effects
    that could stand in for it; confidence: 0 to 1; suspected: whether too few views show it for an assertion.
    """

    name: str
    effects: tuple[Effect, ...]
    std: tuple[dict[str, float], ...]
    ties: tuple[str, ...]
    confidence: float
    suspected: bool = False

    @property
    def verdict(self) -> str:
        """`a`, or `a|b` for effects that the session cannot distinguish."""
        return "|".join(sorted({self.name, *self.ties}))

    def divided(self, kept: Effect, apart: Effect, std: dict[str, float]) -> tuple[Named, Named]:
        """Two effects in place of this one, of a single instance: `kept`, and `apart` with the deviations `std` of its parameters.

        Each could stand in for the other; named together, they are no tie.
        """
        ties = tuple(name for name in self.ties if name != apart.NAME)
        return replace(self, effects=(kept,), ties=ties), Named(apart.NAME, (apart,), (std,), ties, self.confidence)


ANY_PART = -1
"""The part of an effect of all parts."""


@dataclass(frozen=True, slots=True)
class Bound:
    """What an effect that is not named stays below: metres RMS over all drawn pixels, or over the pixels of its `part`."""

    below_m: float
    part: int = ANY_PART


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Indices of the views that coefficients are fitted to, and of the held-out views, on which every figure is stated.

    others: the other sets that could be held out instead; all sets together are all views.
    """

    fit: tuple[int, ...]
    held_out: tuple[int, ...]
    others: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """Poses and effects of a session at one joint solution.

    camera: as CameraInfo states it; caster: the scene; chain: the poses that figures are stated at, without hand-eye and lateness, which are effects;
    cameras (V, 4, 4): T_cell_camera with both; camera_covs (V, 6, 6): of the cameras' right perturbations; hand_eye (4, 4): X;
    evidence: the views at `chain`; linearised: the views where the solution was linearised last, without the CAD's surfaces;
    named: the effects; maps: (H, W) metres of z per named effect and view; sizes: metres, RMS over the pixels that each named effect
    affects, as the held-out views confirm it; tied: pairs of an effect and of one that could stand in for it (None: hand-eye);
    bare: the views at the estimated true poses, less all smooth bias (free functions included, pixel offsets of a pattern not), from
    which noise, loss and edges are read; unnamed_m: metres, sizes of the free functions together (root of the sum of squares);
    depends_on: their observables, most first;
    small_together: effects that each explain little and together much, and are therefore not named;
    small: effects and observables within a healthy camera's tolerance or the stated calibration, and therefore not named; small_m: their
    sizes in metres, as those of the named ones, where they are known;
    within: the effects of a healthy camera's tolerance, whose bias is subtracted from the views;
    arms_alike: chi-square (6 degrees of freedom) of the mean arm error;
    arms (V, 6): arm errors in the camera's frame, metres and radians; arms_sd (V, 6): their standard deviations by the robot's prior;
    split: views fitted to and held out.
    """

    camera: Camera
    caster: Raycaster
    chain: Chain
    cameras: Float
    camera_covs: Float
    hand_eye: Float
    evidence: tuple[ViewEvidence, ...]
    linearised: tuple[ViewEvidence, ...]
    named: tuple[Named, ...]
    maps: Mapping[str, Sequence[Float]]
    sizes: Mapping[str, float]
    tied: tuple[tuple[Effect | None, Effect | None], ...]
    bare: tuple[ViewEvidence, ...]
    unnamed_m: float
    depends_on: tuple[str, ...]
    small_together: tuple[str, ...]
    small: tuple[str, ...]
    small_m: dict[str, float]
    within: tuple[Named, ...]
    arms_alike: float
    arms: Float
    arms_sd: Float
    split: Split

    def names(self, effect: str) -> bool:
        """Whether an effect is among the named ones."""
        return any(n.name == effect for n in self.named)
