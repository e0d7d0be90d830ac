# SPDX-License-Identifier: Apache-2.0
"""A bag and its scene to verdicts on parts: accumulate, solve the session, weigh every part in all views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_core.config import section
from tof_inspect.colour import Picture
from tof_inspect.config import InspectConfig
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from collections.abc import Mapping

    from arm_correction.reference import Reference
    from tof_core.bag import BagReader
    from tof_inspect.judge import Inspection, Inspector


@dataclass(frozen=True, slots=True)
class InspectionConfig(PipelineConfig):
    """Everything between a bag and its verdicts."""

    inspect: InspectConfig = section(InspectConfig, "when a part is there")


def inspect_bag(reader: BagReader, inspector: Inspector, config: InspectionConfig) -> Inspection:
    """Inspect all views of a bag together; errors as of `Inspector.judge`."""
    return inspector.judge(tuple(ViewStream(reader, config)))


def first_pictures(references: Mapping[str, Reference], scene: str) -> tuple[tuple[Picture, ...], list[str]]:
    """Colour pictures of references by name, and a line for each that has none; one of another scene (its CAD's digest) is refused."""
    pictures: list[Picture] = []
    lacking: list[str] = []
    for name, reference in references.items():
        reference.check_scene(scene)
        T = reference.T_cell_camera
        picture = Picture.of(reference.colour, T) if T is not None else None
        if picture is not None:
            pictures.append(picture)
        elif T is None:
            lacking.append(f"{name}: does not know its pose by the CAD; no colour from it; save it with --scene")
        else:
            lacking.append(f"{name}: has no colour picture with calibration and TF; no colour from it")
    return tuple(pictures), lacking
