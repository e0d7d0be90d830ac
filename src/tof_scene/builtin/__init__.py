# SPDX-License-Identifier: Apache-2.0
"""Parametric scenes that come with toftwin; their meshes are generated on request and are identical each time."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from tof_scene.scene import Scene

NAMES = ("body_section", "housing", "pipework")


def builtin_names() -> tuple[str, ...]:
    """Names of the built-in scenes."""
    return NAMES


def make_builtin(name: str) -> Scene:
    """A built-in scene in memory: cell z up, subject around (0, 0, 0.8), main faces toward +x."""
    if name not in NAMES:
        raise UsageError(f"there is no built-in scene '{name}'", where="scene", todo=f"use one of {', '.join(NAMES)}")
    scene: Scene = importlib.import_module(f"tof_scene.builtin.{name}").make()
    return scene


def write_builtin(name: str, folder: Path | str) -> Path:
    """Write a built-in scene (scene.yaml and binary STL meshes) into a folder; returns the scene.yaml."""
    from tof_scene.scene_file import save_scene

    return save_scene(make_builtin(name), folder)


def open_scene(name: Path | str) -> Scene:
    """The built-in scene of that name, otherwise the scene of that file or folder."""
    from tof_scene.scene_file import load_scene

    return make_builtin(str(name)) if str(name) in NAMES else load_scene(name)
