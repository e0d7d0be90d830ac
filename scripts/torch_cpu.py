# SPDX-License-Identifier: Apache-2.0
"""PyTorch for training, only where pip gives the CPU build: the other one is gigabytes of CUDA that nothing here uses."""

from __future__ import annotations

import json
import os
import subprocess
from typing import TYPE_CHECKING

from progress import child_environment
from ros import imports

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from progress import Steps

WANTED = ("-e", ".[train]")
"""Editable, as the step before installed it: without -e pip would put a copy in its place."""
SKIPPED = "pip offers no CPU build here, tests of training will be skipped; to have them: TORCH_INDEX=<PyTorch's CPU wheel index> make test"


def ensure(steps: Steps, python: Path, pip_install: Callable[..., list[str]]) -> None:
    """Install the extra `train` when that stays free of CUDA, else say what is skipped and how to have it."""
    if imports(python, "torch, onnx, onnxscript"):
        steps.note("there")
        return
    index = ["--extra-index-url", os.environ["TORCH_INDEX"]] if os.environ.get("TORCH_INDEX") else []
    if not is_free_of_cuda(steps, pip_install("--dry-run", "-q", "--report", "-", *index, *WANTED)):
        steps.note(SKIPPED)
        return
    if not steps.run(pip_install(*index, *WANTED), quiet_failure=True):
        steps.note(SKIPPED)


def is_free_of_cuda(steps: Steps, dry_run: list[str]) -> bool:
    """Whether pip would install torch, and no NVIDIA library with it."""
    asked = subprocess.run(dry_run, cwd=steps.cwd, check=False, capture_output=True, text=True, env=child_environment())
    if asked.returncode != 0:
        return False
    names = [item["metadata"]["name"].lower() for item in json.loads(asked.stdout)["install"]]
    return not any(name.startswith(("nvidia", "triton", "cuda")) for name in names)
