# SPDX-License-Identifier: Apache-2.0
"""Record a session of the emerging camera to a bag, and its truth to files beside: re-rendered with and without each cause."""

from __future__ import annotations

import json
from dataclasses import replace
from heapq import merge
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.emerging.causes import CAUSES
from tof_core.bag_writer import BagWriter
from tof_core.config import to_mapping
from tof_core.progress import progress
from tof_virtual.record import AMPLITUDE_STEP_E, Event, stamp_ns, static_transforms, temperatures, transforms, write_frame
from tof_virtual.truth import SCHEMA

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from benchmarks.emerging.session import EmergingSession
    from tof_core.arrays import Float
    from tof_virtual.effect import Frame
    from tof_virtual.sight import Sight, World

STEP_E = 1.0
"""Electrons of one count of the amplitude image."""


class Truth:
    """Truth of a session, view by view; a view is a stop, or a capture where the hand moves.

    Arrays as of `tof_virtual.truth.Truth`: poses, depth, part; `normal` (V, H, W, 3) of the true surface in the camera's frame; per effect of the vocabulary `bias_<effect>` (V, H, W) metres, the mean
    frame with all causes minus the one without the causes of that effect (NaN where nothing is measured), or of causes that show in
    noise alone the same of two captures with equal noise; `noise_<effect>` their absolute value, `loss_<effect>` whether a pixel is lost;
    `bias_all`: with all causes minus with none; `error_healthy`: of the mean frame with none; `noise` (V, H, W): the recorded capture minus its mean frame.
    """

    def __init__(self, session: EmergingSession, strengths: Mapping[str, float], reached: Mapping[str, float]) -> None:
        """Begin with no view."""
        self.session, self._strengths, self._reached = session, dict(strengths), dict(reached)
        self._rows: list[dict[str, Any]] = []
        self._key = -1

    def add(self, index: int, taken: Frame) -> None:
        """Take down capture `index`; captures of one dwell share a view."""
        s = self.session
        shutter = s.shutters[index]
        key = index if s.config.plan.capture_moving else shutter.stop
        stamp = stamp_ns(s, s.stamp_s(shutter))
        if key == self._key:
            self._rows[-1]["stamp_ns"] = stamp
            return
        self._key = key
        device = s.device()
        sight = s.view(shutter, device)
        world = s.real(device, shutter).world
        part = np.where(sight.main.face >= 0, world.soup.body[sight.main.face], -1)
        number = {name: k for k, name in enumerate(b.name for b in s.bodies)}
        nominal = np.array([number.get(name, -1) for name in world.soup.names] + [-1])
        self._rows.append(
            {
                "stamp_ns": stamp,
                "dwell_ns": stamp,
                "station": s.stops[shutter.stop].station,
                "stop": shutter.stop,
                "T_cell_camera": s.camera_pose(shutter, device),
                "T_robot": s.robot_pose(shutter),
                "A": s.errors[shutter.stop].A,
                "depth": self._image(sight.z),
                "part": nominal[part].astype(np.int16).reshape(sight.shape),
                "normal": self._normals(sight, world),
                **self._maps(index, taken, sight.z),
            }
        )

    def _maps(self, index: int, taken: Frame, z: Float) -> dict[str, Any]:
        s, device = self.session, self.session.device()
        mean = s.exposed(index, device).depth
        healthy = s.exposed(index, s.healthy).depth
        out = {
            "noise": self._image(taken.depth - mean),
            "bias_all": self._image(_minus(mean, healthy, z)),
            "error_healthy": self._image(healthy - s.view(s.shutters[index], s.healthy).z),
        }
        for effect, names in s.without_each().items():
            one = CAUSES[next(iter(names))]
            other = s.device(names)
            kind = f"{one.kind}_{effect.replace(' ', '_')}"
            if one.kind == "loss":
                alone = s.exposed(index, other, noise=True).depth
                out[kind] = self._image(np.where(np.isfinite(alone), np.isnan(taken.depth).astype(float), np.nan))
            elif one.noisy:
                change = _minus(taken.depth, s.exposed(index, other, noise=True).depth, z)
                out[kind] = self._image(np.abs(change) if one.kind == "noise" else change)
            elif effect != "time_sync":
                out[kind] = self._image(_minus(mean, s.exposed(index, other).depth, z))
        return out

    def _normals(self, sight: Sight, world: World) -> Any:
        """Unit normals (H, W, 3) of the true surfaces in the camera's frame."""
        face = sight.main.face
        normals = np.where(face[:, None] >= 0, world.soup.normals[face], np.nan) @ sight.T_cell_camera[:3, :3]
        return normals.astype(np.float16).reshape(*sight.shape, 3)

    def _image(self, values: Float) -> Any:
        return values.astype(np.float32).reshape(self.session.camera.shape)

    def arrays(self) -> dict[str, Any]:
        """Everything of the `.npz` file."""
        s = self.session
        stacked = {name: np.stack([row[name] for row in self._rows]) for name in self._rows[0]}
        first = {stop.station: k for k, stop in reversed(list(enumerate(s.stops)))}
        return {**stacked, "B": np.stack([s.errors[first[k]].B for k in sorted(first)]), "X": s.mounted(s.device())}

    def meta(self) -> dict[str, Any]:
        """Everything of the `.json` file."""
        s = self.session
        return {
            "schema": SCHEMA,
            "seed": s.config.seed,
            "config": to_mapping(s.config),
            "parts": [b.name for b in s.bodies],
            "healthy": to_mapping(s.healthy),
            "device": to_mapping(s.device()),
            "causes": {
                name: {
                    "effect": CAUSES[name].effect,
                    "knob": CAUSES[name].knob,
                    "size": size,
                    "strength": self._strengths.get(name),
                    "reached": self._reached.get(name),
                    "metric": CAUSES[name].metric,
                }
                for name, size in s.sizes.items()
            },
            "subject": s.real(s.device()).subject,
        }

    def save(self, stem: Path) -> None:
        """Write `<stem>.npz` and `<stem>.json`."""
        stem.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(stem.with_name(stem.name + ".npz"), **self.arrays())
        stem.with_name(stem.name + ".json").write_text(json.dumps(self.meta(), indent=1) + "\n")


def _minus(with_it: Float, without: Float, z: Float) -> Float:
    """Change of depth; where the camera without a cause measures nothing, the error against the true depth."""
    return np.asarray(with_it - np.where(np.isfinite(without), without, z))


def record(
    session: EmergingSession, out_bag: Path | str, truth_path: Path | str, strengths: Mapping[str, float], reached: Mapping[str, float]
) -> Truth:
    """Record a session whose causes have their sizes.

    Args:
        session: the session.
        out_bag: folder of the bag; it must not exist.
        truth_path: stem of the truth's `.npz` and `.json`.
        strengths: what each cause was asked for, for the truth file.
        reached: what each cause reached alone, as of `strength.calibrate`.
    """
    truth = Truth(session, strengths, reached)
    out = session.config.output
    with BagWriter(out_bag, storage=out.storage, distro="jazzy") as bag:  # type: ignore[arg-type]
        static_transforms(bag, session)
        for event in merge(transforms(session), temperatures(session), _captures(session, truth), key=lambda e: (e.time_s, e.order)):
            event.write(bag)
    truth.save(Path(truth_path))
    return truth


def _captures(session: EmergingSession, truth: Truth) -> Iterator[Event]:
    """Expose each capture when its turn comes, and take down its truth."""
    for index in progress(range(len(session.shutters)), "record", len(session.shutters)):
        shutter = session.shutters[index]
        taken = session.exposed(index, session.device(), noise=True)
        truth.add(index, taken)
        shown = replace(taken, amplitude=taken.amplitude * AMPLITUDE_STEP_E / STEP_E)
        stamp = stamp_ns(session, session.stamp_s(shutter))
        yield Event(shutter.time_s, 2, lambda bag, shown=shown, stamp=stamp: write_frame(bag, session, shown, stamp))  # type: ignore[misc]
