# SPDX-License-Identifier: Apache-2.0
"""Export of a trained network to one ONNX file that contains its card."""

from __future__ import annotations

import io
import warnings
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from tof_core.config import from_mapping
from tof_core.errors import ModelError, ToftwinError
from tof_infer.card import KEY, OUTPUTS, parse_card
from tof_infer.config import NetConfig
from tof_infer.network import RepairNet
from tof_infer.sigma_correction import SigmaCorrection

if TYPE_CHECKING:
    from pathlib import Path

    from tof_infer.card import Card
    from tof_infer.sigma_calibration import Calibration

OPSET = 18


class Exported(nn.Module):
    """The exported graph: inputs by name to depth and sigma (and `own` with a frame-level correction), NaN where the frame has no depth."""

    def __init__(self, net: RepairNet, calibration: Calibration) -> None:
        super().__init__()
        self.net, self.calibration = net, calibration

    def forward(self, *images: Tensor) -> tuple[Tensor, ...]:
        """Outputs for images in the order of the card's inputs."""
        named = dict(zip(inputs_of(self.net), images, strict=True))
        depth, *logs = self.net.with_correction(named) if self.net.doubt is not None else self.net(named)
        raw = named["depth"]
        there = (raw > 0) & (raw < 1e3)
        nan = torch.full_like(raw, float("nan"))
        sigmas = [torch.exp(self.calibration.offset + self.calibration.slope * log) for log in logs]
        return tuple(torch.where(there, image, nan) for image in (depth, *sigmas))


def inputs_of(net: RepairNet) -> tuple[str, ...]:
    """Names of the ONNX inputs."""
    return net.config.names


def restore(path: Path) -> tuple[RepairNet, Card]:
    """The network of a file that `export` wrote, and its card.

    Raises:
        ModelError: not such a file.
    """
    import onnx
    from onnx import numpy_helper

    try:
        model = onnx.load(path, load_external_data=False)
        card = parse_card({p.key: p.value for p in model.metadata_props}[KEY], path)
        net = RepairNet(from_mapping(NetConfig, card.config["net"], where="card"))
        weights = {t.name: torch.from_numpy(numpy_helper.to_array(t).copy()) for t in model.graph.initializer}
        if "net.doubt.see.weight" in weights:
            net.doubt = SigmaCorrection(weights["net.doubt.see.weight"].shape[1])
        net.load_state_dict({name: weights[f"net.{name}"] for name in net.state_dict()})
    except ToftwinError:
        raise
    except Exception as error:
        raise ModelError("its weights cannot be read", where=path, todo="give a file that `toftwin train` wrote") from error
    return net.eval(), card


def export(net: RepairNet, calibration: Calibration, card: Card, path: Path) -> None:
    """Write the model (atomically, weights inside) and its card beside it."""
    import onnx

    net.eval()
    names, outputs = inputs_of(net), OUTPUTS if net.doubt is not None else OUTPUTS[:2]
    shape = 4 * card.multiple, 6 * card.multiple
    shapes = {"ray": (1, 3, *shape), "temperature": (1,)}
    examples = tuple(torch.rand(shapes.get(n, (1, 1, *shape))) + 0.5 for n in names)
    free = {n: {2: "rows", 3: "columns"} for n in (*names, *outputs) if n != "temperature"}
    graph = io.BytesIO()
    with warnings.catch_warnings():
        # The tracing exporter is deprecated, but takes a tenth of a second where the new one takes half a minute.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            Exported(net, calibration),
            examples,
            graph,
            dynamo=False,
            opset_version=OPSET,
            input_names=list(names),
            output_names=outputs,
            dynamic_axes=free,
            do_constant_folding=False,  # weights keep their names; onnxruntime folds when it loads
        )
    model = onnx.load_from_string(graph.getvalue())
    onnx.helper.set_model_props(model, {KEY: card.to_json()})
    model.doc_string = "ToF depth repair; contract and story in the metadata under " + KEY
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_bytes(model.SerializeToString())
    temporary.replace(path)
    card.save(path.with_suffix(".json"))
