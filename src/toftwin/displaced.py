# SPDX-License-Identifier: Apache-2.0
"""Parts that a diagnosis finds elsewhere than in the CAD: labels show them where they stand, with an uncertainty for that."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_gap.solve.hypotheses.free import UNKNOWN
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.model import block_of, effect_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tof_core.arrays import Float
    from tof_core.capture import Posed
    from tof_gap.solved import Named
    from tof_scene.scene import Part, Scene


@dataclass(frozen=True, slots=True)
class Displaced:
    """One part that stands or bends otherwise than drawn: its deviation, and the confidence of the diagnosis that names it, 0 to 1."""

    deviation: CadDeviation
    confidence: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for the file of an interrupted run."""
        return {"deviation": block_of(self.deviation), "confidence": self.confidence}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Displaced:
        """The inverse of `to_dict`."""
        deviation = effect_of(values["deviation"], "displaced part")
        assert isinstance(deviation, CadDeviation)
        return cls(deviation, float(values["confidence"]))

    def off_m(self, part: Part) -> float:
        """Metres by which the part is off its CAD: RMS along the normal over its surface."""
        found = self.deviation.moved(part)
        corners = found.vertices[found.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=1)
        along = (self.deviation.motion(corners.mean(axis=1)) * across).sum(axis=1) / area
        return float(np.sqrt((area * along**2).sum() / area.sum()))

    def sigma_m(self, part: Part) -> float:
        """Standard deviation of the place of its surface, metres.

        It contains other shapes of a bend (`CadDeviation.UNEVEN`), and the possibility that the diagnosis is wrong: that the part stands as
        drawn with a probability of one minus its confidence.
        """
        return self.off_m(part) * float(np.sqrt(CadDeviation.UNEVEN**2 + self.confidence * (1.0 - self.confidence)))


def displaced_parts(verdict: Sequence[str], named: Iterable[Named]) -> tuple[Displaced, ...]:
    """The parts that a diagnosis asserts to be elsewhere: not those that it suspects, or cannot tell from an error of the camera.

    None where the verdict has `unknown`: an error that no effect describes, such as a pane before a part, can look like a displaced part.
    """
    if UNKNOWN in verdict:
        return ()
    sure = [n for n in named if n.name == CadDeviation.NAME and not n.ties and not n.suspected]
    return tuple(Displaced(e, n.confidence) for n in sure for e in n.effects if isinstance(e, CadDeviation))


def as_found(scene: Scene, displaced: Sequence[Displaced]) -> Scene:
    """The scene with these parts where they stand; the scene itself if there are none."""
    return scene.replaced({d.deviation.part: d.deviation.moved(scene.parts[d.deviation.part]) for d in displaced}) if displaced else scene


def unsure_of(posed: Sequence[Posed], scene: Scene, displaced: Sequence[Displaced]) -> list[Posed]:
    """Poses solved in `as_found(scene, displaced)`, with the uncertainty of the parts' places."""
    if not displaced:
        return list(posed)
    own = np.zeros(len(scene.parts))
    for d in displaced:
        own[d.deviation.part] = np.hypot(own[d.deviation.part], d.sigma_m(scene.parts[d.deviation.part]))
    return [replace(p, parts=_together(p.parts, own)) for p in posed]


def _together(solved: Float, own: Float) -> Float:
    return np.asarray(np.hypot(solved, own) if len(solved) else own)


def in_words(scene: Scene, displaced: Sequence[Displaced]) -> str:
    """A note of the parts whose labels are rendered where they stand: `housing 3.1 mm`; empty if there are none."""
    if not displaced:
        return ""
    parts = ", ".join(f"{part.name} {1e3 * d.off_m(part):.1f} mm" for d in displaced for part in [scene.parts[d.deviation.part]])
    return f"labels show parts where the diagnosis finds them; RMS distance of their surfaces from the CAD: {parts}"
