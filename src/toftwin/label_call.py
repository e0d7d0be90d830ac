# SPDX-License-Identifier: Apache-2.0
"""One call of `label` as a typed value that can be sent to another process, and its outcome."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toftwin.faults import explain
from toftwin.known import MODES, Known

if TYPE_CHECKING:
    from collections.abc import Iterator

    from toftwin.labelling import LabelResult
    from toftwin.pipeline import PipelineConfig

DONE, KEPT, FAILED = "done", "kept", "failed"


@dataclass(frozen=True, slots=True)
class LabelCall:
    """What to label, where to write it, and how.

    `mode` is one of `toftwin.known.MODES`; `initial_pose` is the text of `--initial-pose`, "" for none; `board` that of `--board`, ""
    where `scene` is given; `known` is what is known of the camera.
    """

    bag: str
    scene: Path | None
    out: Path
    config: PipelineConfig
    mode: str = "final"
    initial_pose: str = ""
    board: str = ""
    calibrate: bool = False
    known: Known = field(default_factory=Known)

    def run(self) -> LabelResult:
        """Label the bag in this process; `toftwin.labelling.label_bag` names the errors."""
        from toftwin.inputs import source
        from toftwin.labelling import label_bag

        board, config = self.board or None, self.config
        opened = source(
            self.bag, config, scene=self.scene, board=board, calibrate=self.calibrate, apart=True, initial_pose=self.initial_pose
        )
        with opened as (reader, scene):
            if self.board:
                from toftwin.boarded import posed_by_board

                config = replace(config, align=posed_by_board(reader, config.align))
            return label_bag(reader, scene, config, self.out, known=self.known, mode=self.mode)

    def provenance(self) -> tuple[str, str, str]:
        """Digest of the scene, digest of the configuration and source of the poses, as the dataset records them."""
        from tof_scene.builtin import open_scene

        assert self.scene is not None, "a batch is of bags that show one scene"
        config = replace(self.config, align=replace(self.config.align, mode=MODES[self.mode]))
        return open_scene(self.scene).digest, self.known.digest(config), self.known.source(self.mode)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome for one bag: `done` now, `kept` from an earlier call, or `failed` with the reason in a line."""

    bag: str
    out: str
    state: str
    error: str = ""
    seconds: float = 0.0
    megabytes: float = 0.0
    result: dict[str, Any] = field(default_factory=dict)

    def line(self) -> str:
        """The outcome as one line of text."""
        if self.state == FAILED:
            return f"failed  {self.bag}: {self.error}"
        views = self.result.get("views", 0)
        return f"{self.state:<6}  {self.bag}: {views} views" + (f" in {self.seconds:.1f} s" if self.state == DONE else "")


def label_one(call: LabelCall) -> Outcome:
    """Label one bag in this process; an error of any kind becomes the outcome's line."""
    from tof_core.progress import set_quiet

    set_quiet()
    start = time.monotonic()
    try:
        result = call.run()
    except Exception as error:  # noqa: BLE001 (one bag's fault must not end the others)
        return Outcome(call.bag, str(call.out), FAILED, explain(error)[0], time.monotonic() - start)
    megabytes = sum(p.stat().st_size for p in files(result.dataset) if p.is_file()) / 1e6
    return Outcome(call.bag, str(call.out), DONE, "", time.monotonic() - start, megabytes, result.to_dict())


def files(path: Path) -> Iterator[Path]:
    """A path, and all files below it."""
    yield path
    if path.is_dir():
        for folder, _, names in os.walk(path):
            yield from (Path(folder) / name for name in names)
