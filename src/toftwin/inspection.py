# SPDX-License-Identifier: Apache-2.0
"""A bag and its scene to verdicts on parts: accumulate, solve the session, weigh every part in all views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_core.config import section
from tof_inspect.config import InspectConfig
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from tof_core.bag import BagReader
    from tof_inspect.judge import Inspection, Inspector


@dataclass(frozen=True, slots=True)
class InspectionConfig(PipelineConfig):
    """Everything between a bag and its verdicts."""

    inspect: InspectConfig = section(InspectConfig, "when a part is there")


def inspect_bag(reader: BagReader, inspector: Inspector, config: InspectionConfig) -> Inspection:
    """Inspect all views of a bag together; errors as of `Inspector.judge`."""
    return inspector.judge(tuple(ViewStream(reader, config)))
