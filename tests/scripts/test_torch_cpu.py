# SPDX-License-Identifier: Apache-2.0
"""The last pip step must leave the checkout installed, not a copy of it."""

from __future__ import annotations

from importlib import metadata
from typing import TYPE_CHECKING

import pytest

import torch_cpu
from progress import Steps

if TYPE_CHECKING:
    from pathlib import Path


def test_the_training_extra_is_installed_editable() -> None:
    assert torch_cpu.WANTED[-2:] == ("-e", ".[train]")


@pytest.mark.parametrize(
    ("plan", "is_installed"),
    [
        ([" + sympy==1.14.0", " + torch==2.13.0+cpu"], True),
        ([" + nvidia-cublas==13.1.0", " + torch==2.13.0"], False),
        (["Built toftwin @ file:///cuda/toftwin", " + torch==2.13.0+cpu"], True),
        (["Would install sympy-1.14.0 torch-2.13.0+cpu"], True),
        (["Would install nvidia-cublas-13.1.0 torch-2.13.0"], False),
        (["Would install torch-2.13.0 triton-3.6.0"], False),
    ],
    ids=["uv", "uv, CUDA", "uv, a folder's name", "pip", "pip, CUDA", "pip, triton"],
)
def test_pytorch_is_installed_only_without_cuda(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plan: list[str], *, is_installed: bool
) -> None:
    steps, asked = Steps(1, tmp_path / "log", tmp_path), list[tuple[str, ...]]()

    def install(_steps: Steps, _python: Path, *what: str, quiet_failure: bool) -> bool:
        asked.append(what)
        steps.tail.extend(plan)
        return True

    monkeypatch.setattr(torch_cpu, "install", install)
    monkeypatch.setattr(torch_cpu, "imports", lambda _python, _modules: False)
    torch_cpu.ensure(steps, tmp_path / "python")
    assert asked[0][0] == "--dry-run"
    assert (asked[1:] == [torch_cpu.WANTED]) == is_installed
    assert (steps.remark == torch_cpu.SKIPPED) != is_installed


def test_what_is_tested_is_the_checkout(repository: Path) -> None:
    import tof_core
    import toftwin

    for module in (tof_core, toftwin):
        assert module.__file__ is not None
        assert module.__file__.startswith(str(repository / "src")), f"tests run {module.__file__}: {metadata.version('toftwin')} is a copy"
