# SPDX-License-Identifier: Apache-2.0
"""A trained network to one ONNX file that holds its contract."""

from __future__ import annotations

import io
import warnings
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from tof_infer.card import KEY, OUTPUTS

if TYPE_CHECKING:
    from pathlib import Path

    from tof_infer.card import Card
    from tof_infer.honesty import Calibration
    from tof_infer.network import RepairNet

OPSET = 18


class Exported(nn.Module):
    """The graph as it is run: images in by name, depth and sigma out, NaN where the frame has no depth."""

    def __init__(self, net: RepairNet, calibration: Calibration) -> None:
        super().__init__()
        self.net, self.calibration = net, calibration

    def forward(self, *images: Tensor) -> tuple[Tensor, Tensor]:
        """Images in the order of the card's inputs."""
        named = dict(zip(inputs_of(self.net), images, strict=True))
        depth, log_scale = self.net(named)
        sigma = torch.exp(self.calibration.offset + self.calibration.slope * log_scale)
        raw = named["depth"]
        there = (raw > 0) & (raw < 1e3)
        nan = torch.full_like(raw, float("nan"))
        return torch.where(there, depth, nan), torch.where(there, sigma, nan)


def inputs_of(net: RepairNet) -> tuple[str, ...]:
    """Names of the ONNX inputs."""
    return net.config.names


def export(net: RepairNet, calibration: Calibration, card: Card, path: Path) -> None:
    """Write the model (atomically, weights inside) and its card beside it."""
    import onnx

    net.eval()
    names = inputs_of(net)
    shape = 4 * card.multiple, 6 * card.multiple
    shapes = {"ray": (1, 3, *shape), "temperature": (1,)}
    examples = tuple(torch.rand(shapes.get(n, (1, 1, *shape))) + 0.5 for n in names)
    free = {n: {2: "rows", 3: "columns"} for n in (*names, *OUTPUTS) if n != "temperature"}
    graph = io.BytesIO()
    with warnings.catch_warnings():
        # The tracing exporter is called old; it takes a tenth of a second where the new one takes half a minute.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            Exported(net, calibration),
            examples,
            graph,
            dynamo=False,
            opset_version=OPSET,
            input_names=list(names),
            output_names=OUTPUTS,
            dynamic_axes=free,
        )
    model = onnx.load_from_string(graph.getvalue())
    onnx.helper.set_model_props(model, {KEY: card.to_json()})
    model.doc_string = "ToF depth repair; contract and story in the metadata under " + KEY
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_bytes(model.SerializeToString())
    temporary.replace(path)
    card.save(path.with_suffix(".json"))
