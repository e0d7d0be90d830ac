# SPDX-License-Identifier: Apache-2.0
"""Verdicts on parts from a bag and its scene: averaged views, poses of the session, evidence for each part from all views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_core.config import section
from tof_core.progress import steps
from tof_inspect.config import InspectConfig
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from arm_correction.reference import Reference
    from tof_core.bag import BagReader
    from tof_core.capture import View
    from tof_inspect.judge import Inspection, Inspector
    from tof_inspect.picture import Picture
    from tof_inspect.reference import ReferenceSession


@dataclass(frozen=True, slots=True)
class InspectionConfig(PipelineConfig):
    """Settings from the bag to the verdicts."""

    inspect: InspectConfig = section(InspectConfig, "when a part is there")


def inspect_bag(reader: BagReader, inspector: Inspector, config: InspectionConfig) -> Inspection:
    """Inspect all views of a bag together; errors as of `Inspector.judge`."""
    return inspect_views(tuple(ViewStream(reader, config)), inspector)


def inspect_views(views: Sequence[View], inspector: Inspector) -> Inspection:
    """Inspect views together, with a progress bar; errors as of `Inspector.judge`."""
    with steps("parts", 1 + len(inspector.names)) as begin:
        return inspector.judge(views, begin)


def learn_bag(reader: BagReader, inspector: Inspector, config: InspectionConfig) -> ReferenceSession:
    """A bag of the complete cell as reference session; raises the errors of `Inspector.learn`."""
    views = tuple(ViewStream(reader, config))
    with steps("reference", 1 + len(inspector.names)) as begin:
        return inspector.learn(views, begin)


def first_pictures(references: Mapping[str, Reference], scene: str) -> tuple[tuple[Picture, ...], list[str]]:
    """Colour pictures of references by name, and a line for each reference without one; references of another scene (digest) are refused."""
    from tof_inspect.picture import Picture

    pictures: list[Picture] = []
    lacking: list[str] = []
    for name, reference in references.items():
        reference.check_scene(scene)
        T = reference.T_cell_camera
        picture = Picture.of(reference.colour, T) if T is not None else None
        if picture is not None:
            pictures.append(picture)
        elif T is None:
            lacking.append(f"{name}: has no pose from the CAD, so its colour is not used; save it with --scene")
        else:
            lacking.append(f"{name}: has no colour picture with calibration and TF, so its colour is not used")
    return tuple(pictures), lacking
