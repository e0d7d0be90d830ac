# SPDX-License-Identifier: Apache-2.0
"""One verdict for each part: present, absent, displaced or not observable, with its probability."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_align.config import AlignConfig
from tof_align.known import known_removed
from tof_align.session import solve_session
from tof_core.errors import RefusedError
from tof_inspect.colour import Colours
from tof_inspect.config import InspectConfig
from tof_inspect.displaced import Fit, fit_part
from tof_inspect.evidence import Evidence, Ratios, agreement, see, weigh
from tof_inspect.picture import Picture
from tof_inspect.place import JUDGED_PLACE, UNSEEN_TODO, Place, place_of
from tof_inspect.reference import ReferenceSession, Standing
from tof_inspect.shared import Left, PosesAlone, SessionErrors
from tof_inspect.without import Split, inspected
from tof_scene.raycast import Raycaster
from tof_scene.scene import Scene

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_align.known import Bias
    from tof_align.session import SessionSolution
    from tof_core.capture import Posed, View
    from tof_inspect.evidence import Seen
    from tof_inspect.shared import SharedErrors
    from tof_inspect.without import Without
    from tof_scene.scene import Part


@dataclass(frozen=True, slots=True, eq=False)
class PartVerdict:
    """Verdict of one part.

    state: present, absent, displaced, not_observable; probability: that the part is present or displaced, NaN where too few pixels show
    it; pixels: distinctive pixels of all views; displaced_mm, std_mm: distance from the place in the CAD, NaN if not fitted; log_depth,
    log_colour, log_ratio: log likelihood ratios of presence by each and by both (see `Ratios`); why: one line; judged: whether the state
    is decided and the tolerance could be judged; todo: the capture that would decide, "" if judged; shift_mm (3,), cov_mm2 (3, 3):
    displacement in the cell, zero along unknown axes, and its covariance; () if not fitted.
    """

    name: str
    state: str
    probability: float
    pixels: int
    views: int
    log_depth: float
    log_colour: float
    log_ratio: float
    displaced_mm: float
    std_mm: float
    tolerance_mm: float
    why: str
    judged: bool = True
    todo: str = ""
    shift_mm: tuple[float, ...] = ()
    cov_mm2: tuple[tuple[float, ...], ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; unknown values are null."""
        out = {name: getattr(self, name) for name in self.__slots__}
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in out.items()}


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """Verdicts of all parts, views, poses, and one line on the evidence used (depth alone, or depth and colour)."""

    verdicts: tuple[PartVerdict, ...]
    views: tuple[View, ...]
    posed: tuple[Posed, ...]
    colour: str


class Inspector:
    """A prepared scene: fixed and inspected parts as two search trees, and each part alone on first use.

    `first`: reference images of the complete scene, for the comparison of colours; `standing`: a reference session of the complete scene
    (`learn`), relative to which displacements are measured. Both may be set later.
    """

    def __init__(
        self,
        caster: Raycaster,
        config: InspectConfig | None = None,
        align: AlignConfig | None = None,
        first: Sequence[Picture] = (),
        bias: Bias | None = None,
    ) -> None:
        """Refuse a scene without parts to inspect; `bias`: known error of the camera, removed first."""
        self.first, self._bias = tuple(first), bias
        self.standing: ReferenceSession | None = None
        self.caster, self.config, self.align, self.scene = caster, config or InspectConfig(), align or AlignConfig(), caster.scene
        self.names = inspected(self.scene)
        self._split = Split(self.scene)
        self._alone: dict[str, Raycaster] = {}

    def without(self, name: str) -> Without:
        """The scene without one part."""
        return self._split.without(self.scene.index(name))

    def alone(self, name: str) -> Raycaster:
        """One part alone."""
        if name not in self._alone:
            self._alone[name] = Raycaster(Scene(self.scene.frame, (self.scene.part(name),), None, self.scene.folder))
        return self._alone[name]

    def judge(self, views: Sequence[View], progress: Callable[[str], None] = lambda _: None) -> Inspection:
        """Solve the poses of all views together, and judge every part; `progress` is called with the name of each step.

        Raises:
            RefusedError: no view, none whose pose is accepted, or none that agrees with the CAD.
            TransformError: a view has no robot pose.
        """
        clean, solution = self._solved(views, progress)
        return self.inspect(clean, solution.posed, progress, solution=solution)

    def learn(self, views: Sequence[View], progress: Callable[[str], None] = lambda _: None) -> ReferenceSession:
        """The measured displacement of each part in a session with all parts in their place; raises as `judge`.

        Errors of the camera that the solution does not model repeat in a later session with about the same views.
        """
        clean, solution = self._solved(views, progress)
        seen, parts = self._seen(clean, solution.posed), {}
        errors = self._errors(clean, solution.posed, solution)
        for name in self.names:
            progress(f"{name} in the reference session")
            index, without = self.scene.index(name), self.without(name)
            shared = errors(index)
            evidence = [weigh(s, without, index, self.config, shared) for s in seen]
            useful = self._useful(seen, evidence)
            if sum(e.pixels for e in evidence) >= self.config.min_pixels:
                fit = fit_part(self.scene.part(name), useful or seen, self.alone(name), without, self.config, shared)
                parts[name] = Standing(fit, np.array([s.posed.T_cell_camera[:3, 3] for s in useful or seen]))
        return ReferenceSession(parts)

    def _solved(self, views: Sequence[View], progress: Callable[[str], None]) -> tuple[Sequence[View], SessionSolution]:
        """The views without the known error of the camera, with the estimated lens, and their solution."""
        if not views:
            raise RefusedError("there is no view to judge", where="inspection", todo="toftwin doctor lists what the input lacks")
        progress("poses of all views")
        clean = views if self._bias is None else known_removed(views, self.caster, self._bias, self.align)
        solution = solve_session(clean, self.caster, self.align)
        return clean if solution.lens is None else [solution.lens.over(v) for v in clean], solution

    def _seen(self, views: Sequence[View], posed: Sequence[Posed]) -> list[Seen]:
        """The views whose pose is accepted and that agree with the CAD; raises RefusedError where none is left."""
        seen = [see(v, p, self.caster, self.config, k) for k, (v, p) in enumerate(zip(views, posed, strict=True)) if p.accepted]
        seen = [s for s in seen if agreement(s) >= self.config.min_agreement]
        if not seen:
            raise RefusedError(
                "no view has an accepted pose at which it agrees with the CAD",
                where="inspection",
                todo="check the scene, its placement and the robot's pose",
            )
        return seen

    def _useful(self, seen: Sequence[Seen], evidence: Sequence[Evidence]) -> list[Seen]:
        """The views with enough distinctive pixels of a part to fit it."""
        return [s for s, e in zip(seen, evidence, strict=True) if e.pixels >= self.config.min_pixels // 3]

    def inspect(
        self,
        views: Sequence[View],
        posed: Sequence[Posed],
        progress: Callable[[str], None] = lambda _: None,
        *,
        solution: SessionSolution | None = None,
    ) -> Inspection:
        """Judge every part from views at given poses; views whose pose is not accepted or that disagree with the CAD are left out.

        `solution`: the session's solution, whose estimate of the camera's errors is removed; None: no estimate.

        Raises:
            RefusedError: no view is left.
        """
        seen = self._seen(views, posed)
        colours, note = self._colours(seen)
        errors = self._errors(views, posed, solution)
        verdicts = []
        for name in self.names:
            progress(name)
            verdicts.append(self._part(self.scene.part(name), seen, colours, errors(self.scene.index(name))))
        return Inspection(tuple(verdicts), tuple(views), tuple(posed), note)

    def _errors(self, views: Sequence[View], posed: Sequence[Posed], solution: SessionSolution | None) -> Callable[[int], SharedErrors]:
        """Errors common to the pixels of a part, as a function of its index."""
        if solution is None:
            return lambda _: PosesAlone(posed)
        shapes, left = [v.depth.shape for v in views], Left.of(solution)
        return lambda part: SessionErrors.of(solution, shapes, part, self.align.discrepancy, left)

    def _colours(self, seen: Sequence[Seen]) -> tuple[Colours | None, str]:
        """The evidence from colour, None if there is none, and one line on the evidence used."""
        if not self.config.colour.enabled or not self.first:
            return None, "depth alone: " + ("colour is switched off" if self.first else "no reference image in colour is given")
        now = [p for s in seen if (p := Picture.of(s.view.colour, s.posed.T_cell_camera)) is not None]
        if not now:
            return None, "depth alone: no view has a colour image with its calibration and TF"
        made = Colours(self.caster, self.first, now, self.config.colour)
        if not made.pairs:
            return None, "depth alone: reference images and current images overlap too little"
        return made, f"depth and colour (pairs of a current image with a reference image: {made.pairs})"

    def _part(self, part: Part, seen: Sequence[Seen], colours: Colours | None, errors: SharedErrors) -> PartVerdict:
        index = self.scene.index(part.name)
        colour = colours.log_ratio(self.without(part.name), index) if colours else 0.0
        evidence = [weigh(s, self.without(part.name), index, self.config, errors) for s in seen]
        useful = self._useful(seen, evidence)
        pixels, ratio = sum(e.pixels for e in evidence), sum(e.log_ratio for e in evidence)
        if pixels < self.config.min_pixels:
            why, place = _unseen(part, evidence, self.config), Place(False, float("inf"), todo=UNSEEN_TODO)
            return _verdict(part, "not_observable", evidence, Ratios.of(ratio, colour), None, why, self.config, place)
        fit = fit_part(part, useful or seen, self.alone(part.name), self.without(part.name), self.config, errors)
        if self.standing:
            fit = self.standing.relative(part.name, fit, [s.posed.T_cell_camera[:3, 3] for s in useful or seen], self.config)
        return decide(part, evidence, ratio, colour, fit, self.config, place_of(part, fit, useful or seen, self.caster, self.config))


def decide(
    part: Part, evidence: Sequence[Evidence], depth: float, colour: float, fit: Fit, config: InspectConfig, place: Place = JUDGED_PLACE
) -> PartVerdict:
    """The verdict: present within tolerance, displaced beyond it, absent if the scene without the part fits the pixels better."""
    # A free pose pays `moved_cost`: a part can always be placed behind another one, where it changes no pixel.
    ratios = Ratios.of(depth, colour, fit.ratio / config.cell_px - config.moved_cost)
    p = probability(ratios.fused, config)
    by = "depth and colour" if colour else "depth"
    if 1.0 - config.decide < p < config.decide:
        return _verdict(
            part,
            "not_observable",
            evidence,
            ratios,
            None,
            f"undecided: probability {p:.2f}",
            config,
            replace(place, todo=place.todo or UNSEEN_TODO),
        )
    if p <= 1.0 - config.decide:
        return _verdict(part, "absent", evidence, ratios, None, f"the background is visible in its place, by {by}", config)
    if fit.mm > part.tolerance_mm and fit.mm - part.tolerance_mm > config.displaced_sigma * fit.std_mm:
        why = f"{fit.mm:.1f} ± {fit.std_mm:.1f} mm from the CAD, tolerance {part.tolerance_mm:g} mm"
        return _verdict(part, "displaced", evidence, ratios, fit, why, config)
    why = f"in its place, by {by}" if place.judged else f"present by {by}, {place.words}"
    return _verdict(part, "present", evidence, ratios, fit, why, config, place)


def probability(ratio: float, config: InspectConfig) -> float:
    """Probability that a part is present, from the log likelihood ratio and the prior."""
    return float(1.0 / (1.0 + np.exp(-np.clip(ratio + np.log(config.prior / (1.0 - config.prior)), -500, 500))))


def _unseen(part: Part, evidence: Sequence[Evidence], config: InspectConfig) -> str:
    covered = sum(e.covered for e in evidence)
    if not covered:
        return f"{part.name} is in no view, or lies behind or inside another part"
    return f"only {sum(e.pixels for e in evidence)} of its {covered} pixels are valid and distinctive (at least {config.min_pixels})"


def _verdict(
    part: Part,
    state: str,
    evidence: Sequence[Evidence],
    ratios: Ratios,
    fit: Fit | None,
    why: str,
    config: InspectConfig,
    place: Place = JUDGED_PLACE,
) -> PartVerdict:
    enough = state != "not_observable" or sum(e.pixels for e in evidence) >= config.min_pixels
    return PartVerdict(
        part.name,
        state,
        probability(ratios.fused, config) if enough else float("nan"),
        sum(e.pixels for e in evidence),
        sum(e.pixels > 0 for e in evidence),
        ratios.depth,
        ratios.colour,
        ratios.fused,
        fit.mm if fit else float("nan"),
        fit.std_mm if fit else float("nan"),
        part.tolerance_mm,
        why,
        place.judged if state == "present" else state != "not_observable",
        place.todo,
        tuple((1e3 * fit.shift).tolist()) if fit else (),
        tuple(map(tuple, (1e6 * fit.cov).tolist())) if fit else (),
    )
