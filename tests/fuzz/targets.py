# SPDX-License-Identifier: Apache-2.0
"""What is fuzzed: by name, a module that makes seeds and a function of bytes; anything but a ToftwinError is a finding."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Target:
    """One door through which foreign bytes come in.

    module: has `NAME(folder) -> function of bytes` and `NAME_seeds(folder) -> list of bytes`, NAME being the target's.
    runs: executions that the bar asks for.
    watched: packages whose branches guide the fuzzer.
    longest: bytes of an input at most; a door that takes a stream needs a short one, or most of the time goes into its length.
    """

    name: str
    module: str
    runs: int
    watched: tuple[str, ...]
    longest: int = 4096

    def open(self, folder: Path) -> Callable[[bytes], None]:
        """The function; `folder` is scratch space of its own."""
        made: Callable[[bytes], None] = getattr(import_module(f"tests.fuzz.{self.module}"), self.name)(folder)
        return made

    def seeds(self, folder: Path) -> list[bytes]:
        """Good input to begin with."""
        made: list[bytes] = getattr(import_module(f"tests.fuzz.{self.module}"), f"{self.name}_seeds")(folder)
        return made


DOORS = (
    Target("image", "messages", 10_000_000, ("tof_core",)),
    Target("packed", "messages", 10_000_000, ("tof_core",)),
    Target("cloud", "messages", 10_000_000, ("tof_core",)),
    Target("config", "texts", 10_000_000, ("tof_core", "toftwin.options", "tof_sensor")),
    Target("scene", "texts", 10_000_000, ("tof_core", "tof_scene")),
    Target("mesh", "texts", 100_000, ("tof_scene",)),
    Target("bag", "files", 100_000, ("tof_core",)),
    Target("dataset", "files", 100_000, ("tof_core", "tof_sim_label")),
    Target("compressed", "documents", 10_000_000, ("tof_core",)),
    Target("parameters", "documents", 10_000_000, ("tof_core",)),
    Target("tf", "documents", 10_000_000, ("tof_core.tf", "tof_core.tf_message", "tof_core.edge"), longest=256),
    Target("reference", "documents", 100_000, ("tof_core.npz", "arm_correction.reference")),
    Target("gap", "documents", 100_000, ("tof_core.npz", "toftwin.viewing")),
    Target("onnx", "files", 100_000, ("tof_core", "tof_infer")),
)
TARGETS = {t.name: t for t in DOORS}
