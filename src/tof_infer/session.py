# SPDX-License-Identifier: Apache-2.0
"""Inference: one ONNX session, checked against its card; one frame in, one frame out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.errors import ModelError, RefusedError
from tof_infer.card import KEY, OUTPUTS, Card, parse_card
from tof_infer.config import InferConfig
from tof_infer.frames import Mark, padded_size, unit_rays
from tof_infer.keep_raw import keep_raw

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.arrays import Bytes, Image, Mask
    from tof_core.camera import Camera
    from tof_core.capture import Capture

MAX_BYTES = 200_000_000
"""Largest model file in bytes; `toftwin train` writes smaller ones."""
FAR_OUTSIDE = 2.0
"""Factor outside the trained range beyond which a frame's median depth is refused."""
DEFAULT_MODEL = Path(__file__).parent / "models" / "default.onnx"


@dataclass(frozen=True, slots=True, eq=False)
class Repaired:
    """One corrected frame, all (H, W).

    depth: metres along z; the raw depth where the network's sigma is too large (`mark` RAW_KEPT). sigma: standard deviation in
    metres, infinite where the raw depth was kept, NaN where there is no depth. mark: uint8, see `Mark`.
    """

    depth: Image
    sigma: Image
    mark: Bytes

    @property
    def known(self) -> Mask:
        """Pixels that the network corrected."""
        return np.asarray(self.mark == Mark.REPAIRED)


def model_path(model: str) -> Path:
    """The file of a network; `default` is the one in the package."""
    return DEFAULT_MODEL if model == "default" else Path(model)


class Session:
    """Runs one network. Buffers are reused: one frame at a time.

    Args:
        config: the network and its limits.
        to_force: how its user asks for `infer.force`, as its refusals say it.

    Raises:
        ModelError: no file, damaged, too large, not made by `toftwin train`, or with other inputs than its card lists.
    """

    def __init__(self, config: InferConfig | None = None, *, to_force: str = "pass --force") -> None:
        self.config, self._to_force = config or InferConfig(), to_force
        self.path = model_path(self.config.model)
        self._session = _load(self.path, self.config)
        self.card = _checked_card(self._session, self.path)
        self._camera: Camera | None = None
        self._inputs: dict[str, Any] = {}
        self.max_sigma_m = self.config.max_sigma_mm * 1e-3 or self.card.max_sigma_m
        empty = np.zeros((0, 0), np.float32)
        self._judged(empty, empty, empty, empty)  # loads the compiled kernel before the first frame

    @property
    def device(self) -> str:
        """Device: cpu or cuda."""
        return "cuda" if self._session.get_providers()[0].startswith("CUDA") else "cpu"

    def accept(self, camera: Camera) -> None:
        """Prepare for a camera.

        Raises:
            RefusedError: the model was trained for another camera, and `force` is not set.
        """
        if camera == self._camera:
            return
        difference = self.card.difference(camera)
        if difference and not self.config.force:
            raise RefusedError(
                f"the model was made for another camera: {difference}",
                where=self.path.name,
                todo=f"train one for this camera, or {self._to_force} and check with toftwin evaluate",
            )
        size = padded_size(camera.shape, self.card.multiple)
        self._camera = camera
        self._inputs = {n: np.full((1, 1, *size), np.nan, np.float32) for n in self.card.inputs}
        self._inputs["ray"] = np.ones((1, 3, *size), np.float32)
        self._inputs["ray"][0, :, : camera.height, : camera.width] = unit_rays(camera)
        self._inputs["temperature"] = np.full(1, np.nan, np.float32)
        self._inputs = {n: self._inputs[n] for n in self.card.inputs}

    def repair(self, capture: Capture, **cad: Image) -> Repaired:
        """Correct a capture; `cad` may contain `incidence` and `material` for a network that was trained with them.

        Raises:
            RefusedError: another camera, or depths far outside those trained on.
        """
        depth, sigma, *own = self.outputs(self.inputs(capture, **cad))
        return self._judged(capture.depth, *(image[0, 0] for image in (depth, sigma, own[0] if own else sigma)))

    def check(self, capture: Capture) -> None:
        """Raise what `repair` raises, in a hundredth of its time."""
        self.accept(capture.camera)
        self._check_range(capture.depth)

    def outputs(self, inputs: Mapping[str, Any]) -> list[Any]:
        """Outputs of the graph."""
        made: list[Any] = self._session.run(None, inputs)
        return made

    def inputs(self, capture: Capture, **cad: Image) -> dict[str, Any]:
        """Inputs of the graph for a capture; the next call overwrites them."""
        self.check(capture)
        self._fill("depth", capture.depth)
        for name, image in {"amplitude": capture.amplitude, "incidence": cad.get("incidence"), "material": cad.get("material")}.items():
            if name in self._inputs:
                self._fill(name, image)
        if "temperature" in self._inputs:
            self._inputs["temperature"][0] = capture.temperature
        return self._inputs

    def _fill(self, name: str, image: Image | None) -> None:
        h, w = self._camera.shape if self._camera else (0, 0)
        self._inputs[name][0, 0, :h, :w] = np.nan if image is None else image

    def _judged(self, raw: Image, depth: Image, sigma: Image, own: Image) -> Repaired:
        """The network's depth; raw depth where sigma is too large, the output is not finite, or the range was not trained."""
        low, high = self.card.range_m
        return Repaired(*keep_raw(raw, depth, sigma, own, *map(np.float32, (self.max_sigma_m, 0.8 * low, 1.2 * high))))

    def _check_range(self, depth: Image) -> None:
        (low, high), known = self.card.range_m, np.isfinite(depth)
        fewer_than_half = (np.count_nonzero(known) - 1) // 2
        beyond = np.count_nonzero(depth < low / FAR_OUTSIDE), np.count_nonzero(depth > high * FAR_OUTSIDE)
        if self.config.force or not known.any() or max(beyond) <= fewer_than_half:  # then the median is within the range
            return
        middle = float(np.median(depth[known]))
        if not low / FAR_OUTSIDE <= middle <= high * FAR_OUTSIDE:
            raise RefusedError(
                f"the frame is {middle:.2f} m away, the model was trained on {low:.2f} to {high:.2f} m",
                where=self.path.name,
                todo=f"train on such ranges, or {self._to_force} and check with toftwin evaluate",
            )


def _load(path: Path, config: InferConfig) -> Any:
    import onnxruntime as ort

    if not path.is_file():
        raise ModelError("there is no such model", where=path, todo="train one: toftwin train DATASET --out model.onnx")
    if path.stat().st_size > MAX_BYTES:
        msg = f"is {path.stat().st_size / 1e6:.0f} MB large, too large for a depth network"
        raise ModelError(msg, where=path, todo="give a file that `toftwin train` wrote")
    options = ort.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = config.threads, 1
    options.log_severity_level = 4
    # Spinning threads take cores that the rest of the graph needs, and block each other on a busy machine.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    available = ort.get_available_providers()
    if config.device == "cuda" and "CUDAExecutionProvider" not in available:
        raise RefusedError("onnxruntime has no CUDA here", where="infer.device", todo="install onnxruntime-gpu, or use --device cpu")
    cuda = ["CUDAExecutionProvider"] if config.device != "cpu" and "CUDAExecutionProvider" in available else []
    try:
        # From bytes, so that a model cannot load other files.
        return ort.InferenceSession(path.read_bytes(), options, providers=[*cuda, "CPUExecutionProvider"])
    except Exception as error:  # noqa: BLE001 (onnxruntime raises many kinds)
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise ModelError(f"is damaged or no ONNX model ({reason})", where=path, todo="copy it again, or train it again") from None


def _checked_card(session: Any, path: Path) -> Card:
    """The card, checked against the inputs and outputs of the graph."""
    try:
        text = session.get_modelmeta().custom_metadata_map.get(KEY)
    except UnicodeDecodeError:
        raise ModelError("its metadata are damaged (no UTF-8 text)", where=path, todo="copy it again, or train it again") from None
    if text is None:
        raise ModelError("was not made by `toftwin train` (it has no card)", where=path, todo="train a model with toftwin train")
    card = parse_card(text, path)
    takes = {i.name: i.type for i in session.get_inputs()}
    gives = [o.name for o in session.get_outputs()]
    if list(takes) != list(card.inputs) or set(takes.values()) != {"tensor(float)"} or gives not in (OUTPUTS[:2], OUTPUTS):
        msg = f"takes {', '.join(takes)} and gives {', '.join(gives)}; its card lists {', '.join(card.inputs)} and {', '.join(OUTPUTS[:2])}"
        raise ModelError(msg, where=path, todo="train it again")
    known = {"depth", "amplitude", "ray", "temperature", "incidence", "material"}
    if not set(takes) <= known:
        raise ModelError(f"takes '{min(set(takes) - known)}', which is no input of toftwin", where=path, todo="train it again")
    return card
