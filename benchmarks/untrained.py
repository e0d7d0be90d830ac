# SPDX-License-Identifier: Apache-2.0
"""A network file with untrained weights: it takes the time of a trained one."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.camera import Camera


def untrained(recipe: str, camera: Camera, path: Path) -> Path:
    """Write the network of a recipe of `toftwin train` for this camera."""
    from tof_core.config import to_mapping
    from tof_infer.card import Card
    from tof_infer.config import TrainConfig
    from tof_infer.export import export
    from tof_infer.network import RepairNet
    from tof_infer.sigma_calibration import Calibration

    net = TrainConfig(recipe=recipe).resolved.net
    path.parent.mkdir(parents=True, exist_ok=True)
    export(RepairNet(net), Calibration(), Card(net.names, net.multiple, camera, (0.3, 3.0), 1.0, {"net": to_mapping(net)}), path)
    return path
