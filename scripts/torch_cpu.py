# SPDX-License-Identifier: Apache-2.0
"""PyTorch for training, only where pip gives the CPU build: the other one is gigabytes of CUDA that nothing here uses."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING

from packages import install
from ros import imports

if TYPE_CHECKING:
    from pathlib import Path

    from progress import Steps

WANTED = ("-c", "constraints.txt", "-e", ".[train]")
"""Editable, as the step before installed it: without -e a copy would take its place."""
CUDA = re.compile(r"^(?: \+|Would install(?: .*)?) (?:nvidia|triton|cuda)")
"""A line of a plan, by uv or by pip, with a package that only the build for NVIDIA's cards brings along."""
SKIPPED = "pip offers no CPU build here, tests of training will be skipped; to have them: TORCH_INDEX=<PyTorch's CPU wheel index> make test"


def ensure(steps: Steps, python: Path) -> None:
    """Install the extra `train` when that stays free of CUDA, else say what is skipped and how to have it."""
    if imports(python, "torch, onnx, onnxscript"):
        steps.note("there")
        return
    index = ["--extra-index-url", os.environ["TORCH_INDEX"]] if os.environ.get("TORCH_INDEX") else []
    is_planned = install(steps, python, "--dry-run", *index, *WANTED, quiet_failure=True)
    if not is_planned or any(map(CUDA.match, steps.tail)):
        steps.note(SKIPPED)
        return
    if not install(steps, python, *index, *WANTED, quiet_failure=True):
        steps.note(SKIPPED)
