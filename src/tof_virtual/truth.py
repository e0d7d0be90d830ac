# SPDX-License-Identifier: Apache-2.0
"""Truth of a recorded session: poses, depth, the share of each effect. For tests and evaluation alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.config import to_mapping
from tof_core.errors import DatasetError
from tof_core.npz import read_npz
from tof_virtual.effect import rms

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image
    from tof_virtual.effect import Effect
    from tof_virtual.session import Session

SCHEMA = "toftwin.truth/1"


class Truth:
    """Gathers the truth of each view (of each capture, where the hand moves) and saves it.

    `<stem>.npz` holds, over V views: `stamp_ns` (last capture of the view), `dwell_ns` (first), `station`, `stop`;
    `T_cell_camera` (true) and `T_robot` (as TF has it) (V, 4, 4), `A` (V, 4, 4), `B` (S, 4, 4), `X` (4, 4);
    `depth` (V, H, W) true z of the real parts, `part` (V, H, W) -1 none; `bias_<effect>` (V, H, W) metres that
    the effect adds to the noise-free depth (NaN where nothing is measured); of effects that are not a bias `scatter_<effect>`
    (noise, metres) or `loss_<effect>` (share of captures lost). `<stem>.json` names effects and their parameters.
    """

    def __init__(self, session: Session) -> None:
        """Begin with an empty list of views."""
        self.session = session
        self._rows: list[dict[str, Any]] = []
        self._key = -1

    def add(self, index: int) -> None:
        """Add capture `index`; captures of one dwell share a view."""
        s = self.session
        shutter = s.shutters[index]
        key = index if s.config.plan.capture_moving else shutter.stop
        stamp = s.config.output.start_s * 1_000_000_000 + round(s.stamp_s(shutter) * 1e9)
        if key == self._key:
            self._rows[-1]["stamp_ns"] = stamp
            return
        self._key = key
        sight = s.sight(shutter, s.effects)
        part = np.where(sight.main.face >= 0, s.world(s.effects).soup.body[sight.main.face], -1)
        self._rows.append(
            {
                "stamp_ns": stamp,
                "dwell_ns": stamp,
                "station": s.stops[shutter.stop].station,
                "stop": shutter.stop,
                "T_cell_camera": s.true_pose(shutter),
                "T_robot": s.robot_pose(shutter),
                "A": s.errors[shutter.stop].A,
                "depth": _image(sight.z, sight.shape),
                "part": part.astype(np.int16).reshape(sight.shape),
                **{f"{e.kind}_{e.name}": _image(s.bias(index, e), sight.shape) for e in s.effects},
            }
        )

    def __len__(self) -> int:
        """Views so far."""
        return len(self._rows)

    def arrays(self) -> dict[str, Any]:
        """Content of the `.npz` file."""
        s = self.session
        stacked = {name: np.stack([row[name] for row in self._rows]) for name in self._rows[0]}
        first = {stop.station: k for k, stop in reversed(list(enumerate(s.stops)))}
        return {**stacked, "B": np.stack([s.errors[first[k]].B for k in sorted(first)]), "X": s.hand_eye()}

    def meta(self) -> dict[str, Any]:
        """Content of the `.json` file."""
        s = self.session
        return {
            "schema": SCHEMA,
            "seed": s.config.seed,
            "config": to_mapping(s.config),
            "parts": [b.name for b in s.bodies],
            "effects": {
                e.name: {
                    "strength": e.strength,
                    "size": e.size,
                    "unit": e.unit,
                    "kind": e.kind,
                    "rms_mm": 1e3 * self._rms(e),
                    "params": e.params(),
                }
                for e in s.effects
            },
        }

    def _rms(self, effect: Effect) -> float:
        """Metres RMS over the affected pixels: as calibrated, else of the maps."""
        if np.isfinite(effect.rms_m):
            return effect.rms_m
        return rms(np.concatenate([row[f"{effect.kind}_{effect.name}"].ravel() for row in self._rows]), local=effect.local)

    def save(self, stem: Path) -> None:
        """Write `<stem>.npz` and `<stem>.json`."""
        stem.parent.mkdir(parents=True, exist_ok=True)
        np.savez(stem.with_name(stem.name + ".npz"), **self.arrays())
        stem.with_name(stem.name + ".json").write_text(json.dumps(self.meta(), indent=1) + "\n")


def load_truth(stem: Path | str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays and names of a truth that `record` wrote. No code outside tests and evaluation opens it."""
    stem = Path(stem)
    names = stem.with_name(stem.name + ".json")
    try:
        meta = json.loads(names.read_text())
        arrays = read_npz(stem.with_name(stem.name + ".npz"))
    except OSError as error:
        msg = f"cannot be read: {error.strerror}"
        raise DatasetError(msg, where=names) from None
    if meta.get("schema") != SCHEMA:
        msg = f"is no truth of schema {SCHEMA}"
        raise DatasetError(msg, where=names)
    return arrays, meta


def _image(values: Float, shape: tuple[int, int]) -> Image:
    return values.astype(np.float32).reshape(shape)
