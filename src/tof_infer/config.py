# SPDX-License-Identifier: Apache-2.0
"""Configuration of training (inputs, network, schedule) and of inference."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tof_core.config import param, section
from tof_core.errors import ConfigError

SENSOR_INPUTS = ("depth", "amplitude", "ray", "temperature")
"""Inputs that the camera provides."""
CAD_INPUTS = ("incidence", "material")
"""Inputs that need a pose and the CAD: optional, since they contain the geometry to be measured."""


@dataclass(frozen=True, slots=True)
class NetConfig:
    """The U-Net."""

    inputs: str = param(",".join(SENSOR_INPUTS), "inputs of the network, joined by commas; incidence and material need a pose and the CAD")
    base: int = param(16, "channels of the finest level; each coarser level has twice as many, up to 4 times", low=4, high=128)
    levels: int = param(4, "levels of the U-Net, the coarsest included", low=2, high=6)
    unshuffle: int = param(2, "side of the blocks whose pixels become channels of the finest level", low=1, high=4)
    separable: bool = param(
        False,
        "convolutions by channel and by pixel, sums in the decoder, means over blocks from the second level on: 0.3 to 0.45 of the time",
    )
    waves_m: str = param(
        "1.5,0.75,0.375,0.1875", "periods of the range encoding, from which training starts; a wiggle's is c / 8 f", unit="m"
    )
    residual: bool = param(True, "predict the correction of the raw depth; false predicts the depth itself")

    def __post_init__(self) -> None:
        """Refuse unknown inputs, and periods that are no positive numbers."""
        names = self.names
        unknown = [n for n in names if n not in SENSOR_INPUTS + CAD_INPUTS]
        if unknown or "depth" not in names:
            what = f"input '{unknown[0]}' is unknown" if unknown else "inputs lack 'depth'"
            raise ConfigError(what, where="net.inputs", todo=f"inputs: {', '.join(SENSOR_INPUTS + CAD_INPUTS)}")
        try:
            good = all(p > 0 for p in self.periods)
        except ValueError:
            good = False
        if not good:
            raise ConfigError(f"'{self.waves_m}' are no periods", where="net.waves_m", todo="write metres, joined by commas")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(n.strip() for n in self.inputs.split(",") if n.strip())

    @property
    def periods(self) -> tuple[float, ...]:
        """The periods of the range encoding in metres."""
        return tuple(float(p) for p in self.waves_m.split(",") if p.strip())

    @property
    def multiple(self) -> int:
        """Rows and columns are padded to a multiple of this number: blocks of the coarsest level, squares of four smooth blocks."""
        return int(max(self.unshuffle * 2 ** (self.levels - 1), self.smooth_block * 4))

    @property
    def smooth_block(self) -> int:
        """Side in pixels of the blocks whose means are channels."""
        return self.unshuffle * (2 if self.separable else 1)


@dataclass(frozen=True, slots=True)
class AdaptConfig:
    """Adaptation of a trained network to another camera; one step per capture."""

    steps: int = param(560, "steps of the network", low=10, high=1_000_000)
    check_steps: int = param(
        200,
        "steps of each of two more networks, trained on one half of the data and judged on the other; sigma is calibrated on both",
        low=10,
    )
    rate: float = param(1e-3, "largest learning rate", low=1e-6, high=1.0)


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """Training."""

    recipe: str = param(
        "default",
        "fast: separable convolutions, for cameras with a megapixel or little processor time; "
        "paper: a plain U-Net on depth alone, mean squared error, as section 3.3 of the paper has it",
        choices=("default", "fast", "paper"),
    )
    net: NetConfig = section(NetConfig, "the network")
    loss: str = param(
        "laplace", "negative log-likelihood of a Laplace or a normal error, or the mean square", choices=("laplace", "normal", "mse")
    )
    epochs: int = param(60, "passes over the captures", low=1, high=100000)
    batch: int = param(2, "captures of one step", low=1, high=256)
    rate: float = param(3e-3, "largest learning rate; it warms up and falls as a cosine", low=1e-6, high=1.0)
    decay: float = param(1e-4, "weight decay", low=0.0, high=1.0)
    seed: int = param(0, "seed of the split, the weights and the order", low=0)
    drop: float = param(0.1, "share of training captures from which amplitude or temperature is hidden", low=0.0, high=1.0)
    flip: bool = param(True, "mirror training captures at random, rays with them")
    simulated: float = param(
        0.5, "share of training captures that are simulated by the sensor model, where one is given", low=0.0, high=1.0
    )
    val: float = param(0.2, "share of the views kept for validation, whole stations", low=0.01, high=0.5)
    test: float = param(0.0, "share of the views held out from training and validation, whole stations", low=0.0, high=0.5)
    margin_px: int = param(
        0, "training captures are cut to the pixels with a label and so many around them; 0: whole captures", unit="px", low=0, high=4096
    )
    limit: int = param(0, "train on this many views only, spread evenly; 0 is all", low=0)
    max_sigma_mm: float = param(0.0, "sigma above which the raw depth is kept; 0: chosen by validation", unit="mm", low=0.0, high=1000.0)
    threads: int = param(0, "threads of the CPU; 0: as many cores as other processes leave free, at each epoch", low=0, high=256)
    device: str = param("auto", "where to train", choices=("auto", "cpu", "cuda"))
    adapt: AdaptConfig = section(AdaptConfig, "adapting a trained network, with --adapt; epochs, batch, rate and net are not used then")

    @property
    def resolved(self) -> TrainConfig:
        """The configuration of the recipe: the fast one has separable convolutions; the paper's has depth alone, MSE, rate 0.001, 100 epochs."""
        if self.recipe == "default":
            return self
        if self.recipe == "fast":
            return replace(self, net=replace(self.net, separable=True))
        plain = replace(self.net, inputs="depth", unshuffle=1, waves_m="", residual=False)
        return replace(
            self,
            net=plain,
            loss="mse",
            rate=1e-3,
            decay=0.0,
            drop=0.0,
            flip=False,
            simulated=0.0,
            epochs=100 if self.epochs == TrainConfig().epochs else self.epochs,
        )


@dataclass(frozen=True, slots=True)
class InferConfig:
    """Running a network."""

    model: str = param("default", "an .onnx file that `toftwin train` wrote, or `default` for the one in the package")
    device: str = param("cpu", "cpu; cuda; auto takes CUDA where it is there", choices=("cpu", "cuda", "auto"))
    threads: int = param(2, "threads of one frame on the CPU", low=1, high=256)
    max_sigma_mm: float = param(
        0.0, "sigma above which the raw depth is kept and the pixel marked; 0 takes the card's value", unit="mm", low=0.0, high=1000.0
    )
    force: bool = param(False, "run a network on another camera or range than it was trained for")
