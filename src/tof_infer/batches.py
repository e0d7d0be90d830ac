# SPDX-License-Identifier: Apache-2.0
"""Batches of tensors from samples, with padding, mirroring, hidden inputs and frames simulated by the sensor model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from tof_infer.frames import padded_size, unit_rays

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

    from torch import Tensor

    from tof_core.arrays import Float, Image
    from tof_infer.augment import Redraw
    from tof_infer.config import TrainConfig
    from tof_infer.samples import Sample, Samples


Window = tuple[slice, slice]
"""Rows and columns of an image."""
WHOLE: Window = (slice(None), slice(None))


def pad(image: Float | Image, size: tuple[int, int], fill: float) -> Image:
    """(..., H, W) grown to `size` below and to the right."""
    grow = [(0, 0)] * (image.ndim - 2) + [(0, size[0] - image.shape[-2]), (0, size[1] - image.shape[-1])]
    return np.pad(np.asarray(image, np.float32), grow, constant_values=fill)


class Batcher:
    """Makes tensors of samples: `images`, the network's inputs, and `target`, labels with sigma and mask.

    With `TrainConfig.margin_px` training batches are cut to the labels and a margin: a board covers a few per cent of an image.
    """

    def __init__(self, samples: Samples, config: TrainConfig, redraw: Redraw | None = None) -> None:
        self.samples, self.config, self.redraw = samples, config, redraw
        camera = samples.pool.camera
        self.size = padded_size(camera.shape, config.net.multiple)
        self.ray = pad(unit_rays(camera), self.size, 0.0)
        self.ray[2][self.ray[2] == 0] = 1.0

    def epoch(self, epoch: int) -> Iterator[tuple[dict[str, Tensor], dict[str, Tensor]]]:
        """Training batches of one pass. Order and augmentation depend on seed and epoch alone, so that a resumed run equals an uninterrupted one."""
        rng = np.random.default_rng([self.config.seed, epoch])
        order = rng.permutation(len(self.samples))
        for start in range(0, len(order), self.config.batch):
            yield self._batch([self._augmented(self.samples[int(i)], rng) for i in order[start : start + self.config.batch]], rng)

    def plain(self) -> Iterator[tuple[dict[str, Tensor], dict[str, Tensor]]]:
        """Every sample once, without augmentation."""
        for i in range(len(self.samples)):
            yield self._batch([self.samples[i]], None)

    def _augmented(self, sample: Sample, rng: np.random.Generator) -> Sample:
        if self.redraw is not None and rng.uniform() < self.config.simulated:
            return self.redraw(sample, rng)
        return sample

    def _batch(self, samples: list[Sample], rng: np.random.Generator | None) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        cut = rng is not None and self.config.margin_px > 0
        windows = [self._labelled(s) if cut else WHOLE for s in samples]
        size = self._size(windows) if cut else self.size
        ray = np.stack([pad(self.ray[:, *w], size, 0.0) for w in windows])
        ray[:, 2][ray[:, 2] == 0] = 1.0

        def stacked(name: str, fill: float) -> Tensor:
            cut = [pad(getattr(s, name)[w], size, fill) for s, w in zip(samples, windows, strict=True)]
            return torch.from_numpy(np.stack(cut)[:, None])

        nan = float("nan")
        images: dict[str, Any] = {
            "depth": stacked("depth", nan),
            "amplitude": stacked("amplitude", nan),
            "ray": torch.from_numpy(ray),
            "temperature": torch.tensor([s.temperature for s in samples], dtype=torch.float32),
            "incidence": stacked("incidence", nan),
            "material": stacked("material", nan),
        }
        target = {"label": stacked("label", nan), "sigma": stacked("label_sigma", 0.0), "mask": stacked("mask", 0.0) > 0}
        images = {name: images[name] for name in {"depth", "ray", *self.config.net.names}}
        if rng is not None:
            self._hide(images, len(samples), rng)
            if self.config.flip:
                _mirror(images, target, rng)
        return images, target

    def _labelled(self, sample: Sample) -> Window:
        """The rows and columns of all labelled pixels, with a margin."""
        (top, bottom), (left, right) = ((int(at[0]), int(at[-1])) for at in map(np.flatnonzero, (sample.mask.any(1), sample.mask.any(0))))
        (height, width), margin = sample.mask.shape, self.config.margin_px
        rows = slice(max(top - margin, 0), min(bottom + 1 + margin, height))
        return rows, slice(max(left - margin, 0), min(right + 1 + margin, width))

    def _size(self, windows: list[Window]) -> tuple[int, int]:
        """The padded size of the largest windows of a batch."""
        height, width = (max(w[axis].stop - w[axis].start for w in windows) for axis in (0, 1))
        return padded_size((height, width), self.config.net.multiple)

    def _hide(self, images: dict[str, Tensor], count: int, rng: np.random.Generator) -> None:
        for name in images.keys() - {"depth", "ray"}:
            share = self.config.drop if name in {"amplitude", "temperature"} else 0.5
            images[name][torch.from_numpy(rng.uniform(size=count) < share)] = float("nan")


def _mirror(images: dict[str, Tensor], target: dict[str, Tensor], rng: np.random.Generator) -> None:
    """Mirror images left to right and top to bottom; the x or y component of the rays changes sign."""
    for axis, component in ((3, 0), (2, 1)):
        if rng.uniform() < 0.5:
            for group in (images, target):
                for name, value in group.items():
                    if value.ndim == 4:
                        group[name] = value.flip(axis)
            images["ray"][:, component] = -images["ray"][:, component]
