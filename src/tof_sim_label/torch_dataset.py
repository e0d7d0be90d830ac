# SPDX-License-Identifier: Apache-2.0
"""The dataset for PyTorch: one item per capture, with the label of its view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch
    from numpy.typing import NDArray

    from tof_core.arrays import Ints
    from tof_sim_label.dataset import Dataset

LABEL = ("label", "label_sigma", "mask")


class CaptureDataset:
    """A map-style dataset for `torch.utils.data.DataLoader` over the captures of some views.

    Items are dicts of float32 tensors: `raw`, `amplitude` (1, H, W; NaN invalid), `ray` (3, H, W;
    unit directions, the same tensor in every item), `temperature` (), and of the capture's view
    `label`, `label_sigma` (1, H, W; NaN where the ray misses the CAD) and `mask` (1, H, W; bool);
    with `capture` and `view`, their numbers. Captures without a view are left out.

    Args:
        dataset: an open dataset.
        views: numbers of the views to take (a field of `Split`), all when None.
        cached: views whose labels are kept in memory.
    """

    def __init__(self, dataset: Dataset, views: Sequence[int] | Ints | None = None, *, cached: int = 8) -> None:
        self.dataset = dataset
        self._view = dataset.column("captures/view")
        wanted = np.arange(dataset.views) if views is None else np.asarray(views, int)
        self._captures = np.flatnonzero(np.isin(self._view, wanted))
        self._temperature = dataset.column("captures/temperature")
        self._cached = cached
        self._labels: dict[int, dict[str, NDArray[Any]]] = {}
        self._ray: torch.Tensor | None = None

    def __len__(self) -> int:
        return len(self._captures)

    def __getitem__(self, item: int) -> dict[str, Any]:
        import torch

        capture = int(self._captures[item])
        view = int(self._view[capture])
        images = {name: self.dataset.frame(f"captures/{name}", capture) for name in ("raw", "amplitude")} | self._label(view)
        return {
            **{name: torch.from_numpy(image)[None] for name, image in images.items()},
            "ray": self._rays(),
            "temperature": torch.tensor(self._temperature[capture]),
            "capture": capture,
            "view": view,
        }

    def _label(self, view: int) -> dict[str, NDArray[Any]]:
        if view not in self._labels:
            label = {name: self.dataset.frame(f"views/{name}", view) for name in LABEL}
            while len(self._labels) >= max(self._cached, 1):
                del self._labels[next(iter(self._labels))]
            self._labels[view] = label | {"mask": label["mask"].astype(bool)}
        return self._labels[view]

    def _rays(self) -> torch.Tensor:
        import torch

        if self._ray is None:
            rays = self.dataset.camera.rays()
            unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
            self._ray = torch.from_numpy(np.ascontiguousarray(unit.transpose(2, 0, 1), np.float32))
        return self._ray
