# SPDX-License-Identifier: Apache-2.0
"""What a demonstration found: the content of its report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from tof_eval.comparison import Comparison
    from tof_eval.sessions import SessionErrors
    from toftwin.demo.config import DemoConfig
    from toftwin.demo.correct import Corrected
    from toftwin.demo.diagnose import Diagnosed
    from toftwin.demo.inspect import Inspected
    from toftwin.demo.replace import Replaced
    from toftwin.labelling import LabelResult
    from toftwin.replay import ReplayResult


@dataclass(frozen=True, slots=True)
class Spent:
    """Duration of a step, and processor time of all its processes, in seconds."""

    seconds: float
    processor: float


@dataclass(frozen=True, slots=True, eq=False)
class DemoResult:
    """The content of the report."""

    config: DemoConfig
    folder: Path
    replayed: ReplayResult
    labelled: LabelResult
    errors: SessionErrors
    diagnosed: Diagnosed
    corrected: Corrected
    inspected: Inspected
    replaced: Replaced
    comparison: Comparison
    spent: dict[str, Spent]
