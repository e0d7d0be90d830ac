# SPDX-License-Identifier: Apache-2.0
"""Input features of the network: raw images to channels, computed inside the exported graph.

Invalid is NaN (or any value that is not a depth). An input is zero where it is absent, and a mask channel marks it.

- *relief*: depth minus the mean of its neighbourhood (9 pixels, and 20 blocks), through asinh, which keeps the order of millimetres of
  noise and metres of a step. It contains surface shape, noise and edges, but not the position of the surface, so it transfers
  between scenes.
- *range*, and its sine and cosine at a few periods (trained from octaves of 1.5 m): errors of the modulation, wiggling above all, are
  periodic in range and alike in every scene of one camera.
- *log amplitude*: absolute (amplitude bias depends on it), times range squared (albedo times cosine: how much light a surface sends to
  others), and minus the mean of its neighbourhood (albedo edges).
- *ray*: fixed patterns and lens errors depend on it. *Temperature*.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 (as PyTorch calls it)

if TYPE_CHECKING:
    from tof_infer.config import NetConfig

NEAR, FAR = 0.02, 100.0
"""Least and largest valid depth, metres."""
FINE_UNIT_M, COARSE_UNIT_M = 0.004, 0.02
FINE, COARSE = 9, 20


class Features(nn.Module):
    """Images of a frame to (fine, smooth) channels of blocks of pixels.

    *fine* ones keep every pixel of a block as a channel; *smooth* ones are means over a block, which is twice as wide where the
    convolutions are separable.
    """

    log_amplitude: Tensor
    temperature: Tensor

    def __init__(self, config: NetConfig) -> None:
        """Statistics of the inputs are set by `measure` before training."""
        super().__init__()
        self.names, self.block, self.smooth_block = config.names, config.unshuffle, config.smooth_block
        self.wave = nn.Parameter(2 * torch.pi / torch.tensor(config.periods)) if config.periods else None
        self.register_buffer("log_amplitude", torch.tensor([0.0, 1.0]))
        self.register_buffer("temperature", torch.tensor([35.0, 10.0]))

    @property
    def fine_channels(self) -> int:
        """Number of channels from full resolution."""
        return (2 + ("amplitude" in self.names)) * self.block**2

    @property
    def smooth_channels(self) -> int:
        """Number of channels that are means over a block."""
        waves = 0 if self.wave is None else 2 * len(self.wave)
        each = {"depth": 2 + waves, "amplitude": 3, "ray": 2, "temperature": 2, "incidence": 2, "material": 2}
        return sum(each[n] for n in self.names)

    def forward(self, images: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """Channels (N, fine, H / block, W / block) and (N, smooth, H / smooth_block, ...), and the mask (N, 1, H, W) of pixels with a depth."""
        z = images["depth"]
        valid = ((z > NEAR) & (z < FAR)).to(torch.float32)
        z = torch.where(valid > 0, z, torch.zeros_like(z))
        radial = z / images["ray"][:, 2:] if "ray" in images else z
        fine = [_squash((z - _mean(z, valid, FINE)) / FINE_UNIT_M) * valid, valid]
        share, near = self._block(valid), self._blocks(z, valid)
        range_m = self._blocks(radial, valid)
        smooth = [_squash((near - _coarse(near, share)) / COARSE_UNIT_M) * share, (range_m - 1.0) * share]
        if self.wave is not None:
            phase = range_m * self.wave.view(1, -1, 1, 1)
            smooth += [torch.sin(phase) * share, torch.cos(phase) * share]
        if "amplitude" in self.names:
            self._amplitude(images["amplitude"], range_m, valid, fine, smooth)
        if "ray" in self.names:
            smooth.append((self._block(images["ray"][:, :2]) + torch.zeros_like(share)) * 2.0)
        if "temperature" in self.names:
            smooth += self._spread(images["temperature"], share)
        for name in ("incidence", "material"):
            if name in self.names:
                there = (images[name] >= 0).to(torch.float32) * valid
                smooth += [self._blocks(torch.where(there > 0, images[name], torch.zeros_like(z)), there), self._block(there)]
        # Slices in the order of pixel_unshuffle, which in ONNX becomes a transposition of six axes and takes three times as long.
        pixels = [x[:, :, i :: self.block, j :: self.block] for x in fine for i in range(self.block) for j in range(self.block)]
        return torch.cat(pixels, 1), torch.cat(smooth, 1), valid

    def _block(self, x: Tensor) -> Tensor:
        return F.avg_pool2d(x, self.smooth_block) if self.smooth_block > 1 else x

    def _blocks(self, x: Tensor, there: Tensor) -> Tensor:
        """Mean of the valid pixels of each block; 0 where none is valid."""
        return self._block(x * there) / (self._block(there) + 1e-6)

    def _amplitude(self, amplitude: Tensor, range_m: Tensor, valid: Tensor, fine: list[Tensor], smooth: list[Tensor]) -> None:
        there = ((amplitude > 0) & (amplitude < 1e9)).to(torch.float32) * valid
        log = torch.log(torch.where(there > 0, amplitude, torch.ones_like(amplitude)))
        log = (log - self.log_amplitude[0]) / self.log_amplitude[1] * there
        fine.append((log - _mean(log, there, FINE)) * 2.0 * there)
        share, level = self._block(there), self._blocks(log, there)
        albedo = level + 2.0 * torch.log(torch.clamp(range_m, 0.05)) / self.log_amplitude[1]
        smooth += [level, albedo * share, share]

    def _spread(self, value: Tensor, like: Tensor) -> list[Tensor]:
        """One number per frame as a channel, with its mask."""
        value = value.view(-1, 1, 1, 1)
        there = ((value > -100) & (value < 200)).to(torch.float32)
        scaled = torch.where(there > 0, (value - self.temperature[0]) / self.temperature[1], torch.zeros_like(value))
        return [scaled + torch.zeros_like(like), there + torch.zeros_like(like)]


def _mean(x: Tensor, there: Tensor, size: int) -> Tensor:
    """Mean of the valid pixels in a square window, one axis after the other; 0 where none is valid."""
    return _box(x * there, size) / (_box(there, size) + 1e-6)


def _box(x: Tensor, size: int) -> Tensor:
    half = size // 2
    x = F.avg_pool2d(x, (size, 1), stride=1, padding=(half, 0), count_include_pad=True)
    return F.avg_pool2d(x, (1, size), stride=1, padding=(0, half), count_include_pad=True)


def _coarse(x: Tensor, share: Tensor) -> Tensor:
    """Mean over about `COARSE` blocks: over squares of four blocks a side, then over neighbouring squares; constant within a square."""
    few = F.avg_pool2d(x * share, 4), F.avg_pool2d(share, 4)
    mean = _box(few[0], COARSE // 4) / (_box(few[1], COARSE // 4) + 1e-6)
    return F.interpolate(mean, scale_factor=4.0, mode="nearest")


def _squash(x: Tensor) -> Tensor:
    """asinh by operations that every ONNX runtime has."""
    return torch.sign(x) * torch.log(torch.abs(x) + torch.sqrt(x * x + 1.0))
