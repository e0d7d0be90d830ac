# SPDX-License-Identifier: Apache-2.0
"""The U-Net that corrects depth: raw frame in, correction and its scale out.

The finest level has blocks of `unshuffle` x `unshuffle` pixels as channels (as FFDNet, Zhang 2018): a quarter of the cost at the
same accuracy per pixel, and twice the field of view, which multipath needs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 (as PyTorch calls it)

from tof_infer.features import Features
from tof_infer.separable import SeparableUNet
from tof_infer.sigma_correction import CELL, SigmaCorrection, cells_of

if TYPE_CHECKING:
    from tof_infer.config import NetConfig

UNIT_M = 0.01
"""Metres per unit of the network's output."""
MIN_SCALE_M, MAX_SCALE_M = 1e-5, 1.0
CHUNK = 16
"""Block of channels in onnxruntime's convolution; other numbers of channels are slower."""


class Block(nn.Module):
    """Two convolutions of 3 x 3 with a shortcut. Parts of an input are convolved separately, without concatenation."""

    def __init__(self, inside: int, outside: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inside, outside, 3, padding=1)
        self.second = nn.Conv2d(outside, outside, 3, padding=1)
        nn.init.zeros_(self.second.weight)

    def forward(self, *parts: Tensor) -> Tensor:
        """(N, inside, H, W), in parts, to (N, outside, H, W)."""
        x = F.relu(convolved(self.first, *parts))
        return F.relu(x + self.second(x))


def convolved(layer: nn.Conv2d, *parts: Tensor) -> Tensor:
    """Output of the layer for the concatenated parts, without concatenating them."""
    # Plain numbers become constants of the exported graph; otherwise it would slice the weights for each frame.
    weights = torch.split(layer.weight, [int(x.shape[1]) for x in parts], 1)
    biases = (layer.bias, *(None for _ in parts[1:]))
    first, *others = (F.conv2d(x, w, b, padding=layer.padding) for x, w, b in zip(parts, weights, biases, strict=True))
    return sum(others, first)


class UNet(nn.Module):
    """Encoder and decoder with shortcuts; pooling by 2, upsampling by nearest neighbours."""

    def __init__(self, inside: int, base: int, levels: int) -> None:
        super().__init__()
        widths = [min(base * 2**k, base * 4) for k in range(levels)]
        self.down = nn.ModuleList(Block(a, b) for a, b in zip([inside, *widths], widths, strict=False))
        self.up = nn.ModuleList(Block(a + b, b) for a, b in zip(widths[:0:-1], widths[-2::-1], strict=True))

    def forward(self, fine: Tensor, smooth: Tensor) -> Tensor:
        """(N, fine and smooth, H, W) to (N, base, H, W); H and W multiples of 2^(levels - 1)."""
        x = torch.cat([fine, smooth], 1)
        passed: list[Tensor] = []
        for k, block in enumerate(self.down):
            x = block(F.max_pool2d(x, 2)) if k else block(*torch.split(x, CHUNK, 1))
            passed.append(x)
        x = passed.pop()
        for block in self.up:
            x = block(F.interpolate(x, scale_factor=2.0, mode="nearest"), passed.pop())
        return x


class RepairNet(nn.Module):
    """Features, U-Net, head."""

    def __init__(self, config: NetConfig) -> None:
        super().__init__()
        self.config = config
        self.doubt: SigmaCorrection | None = None  # trained last; the name is that of its weights in model files
        self.features = Features(config)
        s = config.unshuffle
        fine = self.features.fine_channels
        smooth = self.features.smooth_channels
        self.unet: nn.Module = (
            SeparableUNet(fine, smooth, config.base, config.levels) if config.separable else UNet(fine + smooth, config.base, config.levels)
        )
        side = 1 if config.separable else 3
        self.head = nn.Conv2d(config.base + fine, 2 * s * s, side, padding=side // 2)
        nn.init.normal_(self.head.weight, std=1e-3)
        nn.init.zeros_(self.head.bias)

    def forward(self, images: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Corrected depth and the log of its scale in metres, both (N, 1, H, W), from images as in `Features`; undefined outside the mask."""
        return self.look(images)[:2]

    def with_correction(self, images: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """Depth, the log of its scale with the frame-level correction, and the same from the pixel's surroundings alone."""
        depth, own, features = self.look(images)
        if self.doubt is None:
            return depth, own, own
        more = self.doubt(*cells_of(*features, own))
        return depth, own + F.interpolate(more, scale_factor=float(CELL * self.config.unshuffle), mode="nearest"), own

    def look(self, images: dict[str, Tensor]) -> tuple[Tensor, Tensor, tuple[Tensor, Tensor, Tensor]]:
        """Depth, the log of its scale, and the features that they are computed from."""
        s = self.config.unshuffle
        fine, smooth, valid = self.features(images)
        out = convolved(self.head, self.unet(fine, smooth), fine)
        out = F.pixel_shuffle(out, s) if s > 1 else out
        change, log = out[:, :1] * UNIT_M, out[:, 1:]
        z = torch.where(valid > 0, images["depth"], torch.zeros_like(valid))
        log = torch.clamp(log + math.log(UNIT_M / 3), math.log(MIN_SCALE_M), math.log(MAX_SCALE_M))
        return (z - change if self.config.residual else change / UNIT_M), log, (fine, smooth, valid)
