# SPDX-License-Identifier: Apache-2.0
"""The card of a network: inputs and outputs, camera, training data and figures. It is stored in the ONNX metadata and in a JSON file beside the model."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from tof_core.camera import Camera
from tof_core.errors import CameraError, ModelError

if TYPE_CHECKING:
    from pathlib import Path

SCHEMA = "toftwin.model/1"
KEY = "toftwin.card"
"""Key of the card in the ONNX metadata."""
OUTPUTS = ["depth_out", "sigma", "own"]
"""Names of the ONNX outputs; `own` exists only where a frame-level sigma correction was trained (`tof_infer.sigma_correction`)."""
SAME_FOCAL, SAME_MIDDLE = 0.02, 0.02
"""Relative difference of focal lengths, and of principal points in image widths, up to which two cameras count as the same."""


@dataclass(frozen=True, slots=True)
class Card:
    """Contract and provenance of one network.

    inputs: names of the ONNX inputs, in order: `depth`, `amplitude`, `incidence`, `material` (1, 1, H, W), NaN where invalid; `ray`
    (1, 3, H, W) unit directions; `temperature` (1,). H and W are multiples of `multiple`, padded below and to the right with NaN
    (rays with any z but 0). Outputs are `depth_out` and `sigma` (1, 1, H, W), metres, and optionally `own`: sigma from a pixel's
    surroundings, without the frame-level correction. Pixels whose `own` exceeds `max_sigma_m` keep the raw depth. The frame-level
    correction does not count there: it is due to multipath, which the raw depth contains too. range_m: depths in training.
    """

    inputs: tuple[str, ...]
    multiple: int
    camera: Camera
    range_m: tuple[float, float]
    max_sigma_m: float
    config: dict[str, Any] = field(default_factory=dict)
    data: list[dict[str, Any]] = field(default_factory=list)
    split: dict[str, Any] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)
    curves: list[dict[str, float]] = field(default_factory=list)
    base: dict[str, Any] = field(default_factory=dict)
    """Of an adapted network: name, digest and camera of the network from which it started."""
    notes: str = ""
    schema: str = SCHEMA

    def to_json(self) -> str:
        """One line, for the metadata."""
        return json.dumps(asdict(self), allow_nan=False)

    def save(self, path: Path) -> None:
        """Write the card as JSON."""
        path.write_text(json.dumps(asdict(self), indent=1, allow_nan=False) + "\n", encoding="utf-8")

    def difference(self, camera: Camera) -> str:
        """How a camera differs from the camera of the training data; empty if it does not."""
        mine = self.camera
        if camera.shape != mine.shape:
            return f"it is {camera.width}x{camera.height}, the model's {mine.width}x{mine.height}"
        if max(abs(camera.fx / mine.fx - 1), abs(camera.fy / mine.fy - 1)) > SAME_FOCAL:
            return f"its focal length is {camera.fx:.1f} px, the model's {mine.fx:.1f} px"
        if max(abs(camera.cx - mine.cx), abs(camera.cy - mine.cy)) > SAME_MIDDLE * mine.width:
            return f"its principal point is ({camera.cx:.1f}, {camera.cy:.1f}), the model's ({mine.cx:.1f}, {mine.cy:.1f})"
        return ""


def parse_card(text: str, where: object) -> Card:
    """The card of a model's metadata.

    Raises:
        ModelError: another schema, or damaged.
    """
    try:
        values = json.loads(text)
        if not isinstance(values, dict) or values.get("schema") != SCHEMA:
            msg = f"its card has schema {values.get('schema')!r}, not '{SCHEMA}'" if isinstance(values, dict) else "its card is not a table"
            raise ModelError(msg, where=where, todo="train it again with this version of toftwin")
        camera = dict(values.pop("camera"))
        camera["distortion"] = tuple(camera["distortion"])
        low, high = values.pop("range_m")
        card = Card(camera=Camera(**camera), inputs=tuple(values.pop("inputs")), range_m=(float(low), float(high)), **values)
        possible = 0 < card.multiple <= 1024 and 0 <= low < high and card.max_sigma_m > 0
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError, CameraError) as error:
        msg = f"its card is damaged ({type(error).__name__}: {error})"
        raise ModelError(msg, where=where, todo="train it again") from None
    if not possible:
        msg = f"its card holds impossible values (multiple {card.multiple}, range {card.range_m})"
        raise ModelError(msg, where=where, todo="train it again")
    return card
