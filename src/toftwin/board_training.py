# SPDX-License-Identifier: Apache-2.0
"""Training on captures of a calibration board, which are labelled first, and cut to the board's surroundings."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from toftwin.label_call import LabelCall
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_infer.config import TrainConfig

MARGIN_PX = 32
"""Margin around a board in training captures, in pixels: half of the network's finest neighbourhoods (20 blocks of 2 pixels) and more."""


def labelled(bags: Sequence[Path], board: str, out: Path) -> list[Path]:
    """Folders beside the network `out`, each with the dataset of one bag; a bag labelled before is not labelled again.

    Raises:
        RefusedError: the board is found in no capture of a bag.
    """
    folders = [out.with_name(f"{out.stem}_board_{number}") for number in range(len(bags))]
    for bag, folder in zip(bags, folders, strict=True):
        if not (folder / "dataset.zarr").exists():
            LabelCall(str(bag), None, folder, PipelineConfig(), "robot", board=board).run()
    return folders


def near_labels(config: TrainConfig) -> TrainConfig:
    """The settings with captures cut to the board and a margin of `MARGIN_PX`, unless a margin is set."""
    return replace(config, margin_px=config.margin_px or MARGIN_PX)
