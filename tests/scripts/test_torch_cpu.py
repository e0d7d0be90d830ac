# SPDX-License-Identifier: Apache-2.0
"""The last pip step must leave the checkout installed, not a copy of it."""

from __future__ import annotations

from importlib import metadata
from typing import TYPE_CHECKING

import torch_cpu

if TYPE_CHECKING:
    from pathlib import Path


def test_the_training_extra_is_installed_editable() -> None:
    assert torch_cpu.WANTED[0] == "-e"


def test_what_is_tested_is_the_checkout(repository: Path) -> None:
    import tof_core
    import toftwin

    for module in (tof_core, toftwin):
        assert module.__file__ is not None
        assert module.__file__.startswith(str(repository / "src")), f"tests run {module.__file__}: {metadata.version('toftwin')} is a copy"
