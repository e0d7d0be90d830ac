# SPDX-License-Identifier: Apache-2.0
"""What a command loads before it works: heavy modules only where they are used, since each costs tenths of a second of processor."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path

HEAVY = ("cv2", "embreex", "numba", "onnxruntime", "open3d", "scipy", "torch", "trimesh", "zarr")
"""Modules of which none takes less than 0.1 s to load."""
WORK = ("onnxruntime", "open3d", "scipy.optimize", "scipy.stats", "torch")
"""Modules that reading, filtering and posing do not need."""


def loaded(program: str, *names: str) -> list[str]:
    """Which of these modules a Python program has loaded when it ends."""
    code = f"import sys\n{program}\nprint('loaded:', *[m for m in {names!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return done.stdout.splitlines()[-1].split()[1:]


@pytest.mark.parametrize("command", ["correct", "inspect", "label"])
def test_settings_are_printed_without_any_heavy_module(command: str) -> None:
    program = f"from toftwin.cli import main\ntry:\n    main(['{command}', '--settings'])\nexcept SystemExit:\n    pass"
    assert loaded(program, *HEAVY) == []


@pytest.mark.parametrize(
    "modules",
    [
        "tof_preproc.preprocessor, toftwin.labelling, tof_align.session, tof_sim_label.label",
        "tof_preproc.preprocessor, toftwin.correcting, arm_correction.corrector",
        "tof_preproc.preprocessor, toftwin.inspection, tof_inspect.judge",
    ],
    ids=["label", "correct", "inspect"],
)
def test_work_begins_without_what_only_rare_cases_need(modules: str) -> None:
    assert loaded(f"import {modules}", *WORK) == []


def test_a_bag_that_embeds_its_definitions_is_opened_without_those_of_ros(repository: Path) -> None:
    bag = repository / "tests" / "data" / "golden" / "bag"
    program = f"from tof_core.bag import open_bag\nwith open_bag({str(bag)!r}) as reader:\n    assert reader.frame_count"
    assert loaded(program, "rosbags.typesys.stores.ros2_dashing") == []
