# SPDX-License-Identifier: Apache-2.0
"""One verdict for each part: present, absent, displaced or not observable, with its probability."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_align.config import AlignConfig
from tof_align.known import known_removed
from tof_align.session import solve_session
from tof_core.errors import RefusedError, SceneError
from tof_inspect.colour import Colours, Picture
from tof_inspect.config import InspectConfig
from tof_inspect.displaced import Fit, fit_part
from tof_inspect.evidence import Evidence, agreement, see, weigh
from tof_inspect.without import Split
from tof_scene.raycast import Raycaster
from tof_scene.scene import Scene

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_align.known import Bias
    from tof_core.capture import Posed, View
    from tof_inspect.evidence import Seen
    from tof_inspect.without import Without
    from tof_scene.scene import Part


@dataclass(frozen=True, slots=True, eq=False)
class PartVerdict:
    """Verdict of one part.

    state: present, absent, displaced, not_observable; probability: that the part is there (also where it is displaced);
    pixels: distinctive pixels of all views; displaced_mm with std_mm: distance from the place in the CAD, NaN if not fitted;
    log_depth, log_colour, log_ratio: log likelihood ratios of presence by each and by both (see `Ratios`); why: one line.
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

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; unknown values are null."""
        out = {name: getattr(self, name) for name in self.__slots__}
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in out.items()}


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """Verdicts of all parts, the views, their poses, and one line on the evidence used (depth alone, or depth and colour)."""

    verdicts: tuple[PartVerdict, ...]
    views: tuple[View, ...]
    posed: tuple[Posed, ...]
    colour: str


class Inspector:
    """A prepared scene: fixed and inspected parts as two search trees, and each part alone on first use.

    `first`: reference images of the complete scene, with which colour is compared. They may be set later.
    """

    def __init__(
        self,
        caster: Raycaster,
        config: InspectConfig | None = None,
        align: AlignConfig | None = None,
        first: Sequence[Picture] = (),
        bias: Bias | None = None,
    ) -> None:
        """Refuse a scene without parts to inspect; `bias`: what is known of the camera, removed before anything is judged."""
        self.first, self._bias = tuple(first), bias
        self.caster, self.config, self.align, self.scene = caster, config or InspectConfig(), align or AlignConfig(), caster.scene
        self.names = tuple(part.name for part in self.scene.parts if part.inspect)
        if not self.names:
            raise SceneError("no part has `inspect: true`", where=self.scene.folder, todo="mark the parts to inspect in scene.yaml")
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
        if not views:
            raise RefusedError("there is no view to judge", where="inspection", todo="toftwin doctor lists what the input lacks")
        progress("poses of all views")
        clean = views if self._bias is None else known_removed(views, self.caster, self._bias, self.align)
        return self.inspect(clean, solve_session(clean, self.caster, self.align).posed, progress)

    def inspect(self, views: Sequence[View], posed: Sequence[Posed], progress: Callable[[str], None] = lambda _: None) -> Inspection:
        """Judge every part from views at known poses; those that are not accepted, or disagree with the CAD, are left out.

        Raises:
            RefusedError: no view is left.
        """
        seen = [see(v, p, self.caster, self.config) for v, p in zip(views, posed, strict=True) if p.accepted]
        seen = [s for s in seen if agreement(s) >= self.config.min_agreement]
        if not seen:
            raise RefusedError(
                "no view has an accepted pose at which it agrees with the CAD",
                where="inspection",
                todo="check the scene, its placement and the robot's pose",
            )
        colours, note = self._colours(seen)
        verdicts = []
        for name in self.names:
            progress(name)
            verdicts.append(self._part(self.scene.part(name), seen, colours))
        return Inspection(tuple(verdicts), tuple(views), tuple(posed), note)

    def _colours(self, seen: Sequence[Seen]) -> tuple[Colours | None, str]:
        """Colour beside depth, or why there is none."""
        if not self.config.colour.enabled or not self.first:
            return None, "depth alone: " + ("colour is switched off" if self.first else "no reference image in colour is given")
        now = [p for s in seen if (p := Picture.of(s.view.colour, s.posed.T_cell_camera)) is not None]
        if not now:
            return None, "depth alone: no view has a colour image with its calibration and TF"
        made = Colours(self.caster, self.first, now, self.config.colour)
        if not made.pairs:
            return None, "depth alone: reference images and current images overlap too little"
        return made, f"depth and colour (pairs of a current image with a reference image: {made.pairs})"

    def _part(self, part: Part, seen: Sequence[Seen], colours: Colours | None) -> PartVerdict:
        index = self.scene.index(part.name)
        colour = colours.log_ratio(self.without(part.name), index) if colours else 0.0
        evidence = [weigh(s, self.without(part.name), index, self.config) for s in seen]
        useful = [s for s, e in zip(seen, evidence, strict=True) if e.pixels >= self.config.min_pixels // 3]
        pixels, ratio = sum(e.pixels for e in evidence), sum(e.log_ratio for e in evidence)
        if pixels < self.config.min_pixels:
            why = _unseen(part, evidence, self.config)
            return _verdict(part, "not_observable", evidence, Ratios.of(ratio, colour), None, why, self.config)
        fit = fit_part(part, useful or seen, self.alone(part.name), self.without(part.name), self.config)
        return decide(part, evidence, ratio, colour, fit, self.config)


@dataclass(frozen=True, slots=True)
class Ratios:
    """Log likelihood ratios of presence: by depth (at its place, or wherever it may have moved), by colour (at its place), together."""

    depth: float
    colour: float
    fused: float

    @classmethod
    def of(cls, depth: float, colour: float, moved: float = -np.inf) -> Ratios:
        """A displaced part is present too: `moved` is the ratio at its best pose.

        Colour was read at the part's place in the CAD, so it is evidence for that place alone.
        """
        return cls(max(depth, moved), colour, max(depth + colour, moved))


def decide(part: Part, evidence: Sequence[Evidence], depth: float, colour: float, fit: Fit, config: InspectConfig) -> PartVerdict:
    """Present within tolerance, displaced beyond it, absent if the scene without the part fits the pixels better."""
    # A free pose pays `moved_cost`: a part can always be placed behind another one, where it changes no pixel.
    ratios = Ratios.of(depth, colour, fit.ratio / config.cell_px - config.moved_cost)
    p = probability(ratios.fused, config)
    by = "depth and colour" if colour else "depth"
    if 1.0 - config.decide < p < config.decide:
        return _verdict(part, "not_observable", evidence, ratios, None, f"undecided: probability {p:.2f}", config)
    if p <= 1.0 - config.decide:
        return _verdict(part, "absent", evidence, ratios, None, f"{by}: the background is visible in its place", config)
    if fit.mm > part.tolerance_mm and fit.mm - part.tolerance_mm > config.displaced_sigma * fit.std_mm:
        why = f"{fit.mm:.1f} ± {fit.std_mm:.1f} mm from the CAD, tolerance {part.tolerance_mm:g}"
        return _verdict(part, "displaced", evidence, ratios, fit, why, config)
    return _verdict(part, "present", evidence, ratios, fit, f"{by}: in its place", config)


def probability(ratio: float, config: InspectConfig) -> float:
    """Probability that a part is present, from the log likelihood ratio and the prior."""
    return float(1.0 / (1.0 + np.exp(-np.clip(ratio + np.log(config.prior / (1.0 - config.prior)), -500, 500))))


def _unseen(part: Part, evidence: Sequence[Evidence], config: InspectConfig) -> str:
    covered = sum(e.covered for e in evidence)
    if not covered:
        return f"{part.name} is in no view, or lies behind or inside another part"
    return f"only {sum(e.pixels for e in evidence)} of its {covered} pixels are valid and distinctive (at least {config.min_pixels})"


def _verdict(
    part: Part, state: str, evidence: Sequence[Evidence], ratios: Ratios, fit: Fit | None, why: str, config: InspectConfig
) -> PartVerdict:
    return PartVerdict(
        part.name,
        state,
        probability(ratios.fused, config),
        sum(e.pixels for e in evidence),
        sum(e.pixels > 0 for e in evidence),
        ratios.depth,
        ratios.colour,
        ratios.fused,
        fit.mm if fit else float("nan"),
        fit.std_mm if fit else float("nan"),
        part.tolerance_mm,
        why,
    )
