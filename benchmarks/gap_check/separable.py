# SPDX-License-Identifier: Apache-2.0
"""Whether two effects are separable in a session, from the true maps: never from the diagnosis."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_gap.solve.hypotheses.candidate import Candidate
    from tof_gap.solve.hypotheses.columns import ColumnStore

LEFT = 0.25
"""Share of a map's energy that must stand after pose and the other effect for the two to be separable."""


class Truth:
    """The sealed truth of a case, beside the bag that the diagnosis saw."""

    def __init__(self, sealed: Path, bag: Path, truth: str = "truth", session: str = "bag") -> None:
        """Open the sealed files; truth: their stem; session: the bag of this truth, in the folder `bag` beside its scene."""
        self.sealed, self.bag, self.recorded = sealed, bag, bag / session
        with np.load(sealed / f"{truth}.npz") as data:
            self.arrays = {k: data[k] for k in data.files}
        self.meta = json.loads((sealed / f"{truth}.json").read_text())
        self._session: tuple[ColumnStore, Chain] | None = None

    def map(self, effect: str) -> Float | None:
        """(V, H, W) metres (or share of captures lost) that the effect adds, None where it is in no view."""
        for kind in ("bias", "loss", "scatter"):
            if f"{kind}_{effect}" in self.arrays:
                return np.asarray(self.arrays[f"{kind}_{effect}"], float)
        return None

    def bias(self, effect: str) -> Float | None:
        """(V, H, W) metres that the effect adds to depth, None where it scatters or loses alone."""
        kept = self.arrays.get(f"bias_{effect}")
        return None if kept is None else np.asarray(kept, float)

    def worst_part(self, effect: str) -> str | None:
        """Name of the part that carries most of an effect's energy."""
        true = self.map(effect)
        if true is None:
            return None
        part = self.arrays["part"]
        seen = np.isfinite(true) & (part >= 0)
        energy = np.bincount(part[seen].astype(int), true[seen] ** 2)
        return str(self.meta["parts"][int(np.argmax(energy))])

    def session(self) -> tuple[ColumnStore, Chain]:
        """Evidence at the true poses with noise-free depth, to project maps in."""
        if self._session is None:
            self._session = _session(self)
        return self._session

    def correlation(self, named: Float, true: Float) -> float:
        """Correlation of two maps over the session after each lost what a pose of the chain can absorb."""
        from tof_sensor.geometry import pose_columns

        store, chain = self.session()
        a, b, J = [], [], []
        for v, view in enumerate(store.views):
            x, y = named[v].ravel()[view.pixels], true[v].ravel()[view.pixels]
            seen = np.isfinite(x) & np.isfinite(y)
            shared, _ = chain.links(v)
            block = np.zeros((int(seen.sum()), 6 * len(chain.names)))
            s = int(chain.station[v])
            block[:, 6 * s : 6 * s + 6] = (pose_columns(view.frame.take(view.pixels))[0] @ shared[:, :6])[seen]
            a.append(x[seen])
            b.append(y[seen])
            J.append(block)
        A, M = np.stack([np.concatenate(a), np.concatenate(b)], axis=1), np.concatenate(J)
        left = A - M @ np.linalg.lstsq(M, A, rcond=1e-9)[0]
        return float(left[:, 0] @ left[:, 1] / np.sqrt((left[:, 0] ** 2).sum() * (left[:, 1] ** 2).sum() + 1e-30))


def inseparable(truth: Truth, effect: str, other: str) -> bool:
    """Whether pose and every shape of `other` leave less than a quarter of the true map of `effect`.

    The energy is that of the true map after pose alone.
    """
    left = _left(truth, effect, (other,))
    return left is not None and left[other] < LEFT * left[""]


def separable(truth: Truth, effect: str) -> bool:
    """Whether a withheld effect is seen in the session at all: neither pose nor any one other effect hides three quarters of it.

    Of pose the share is taken of the map itself, arms and bases within the robot's priors. Loss, noise and wrapped phase are not a bias
    that another could take over.
    """
    if f"bias_{effect}" not in truth.arrays or effect in GROSS:
        return True
    from tof_sensor.registry import VOCABULARY

    left = _left(truth, effect, tuple(n for n in VOCABULARY if n != effect))
    if left is None:
        return True
    return (
        left[""] >= LEFT * left["all"]
        and left[""] >= VISIBLE
        and min(v for k, v in left.items() if k not in ("", "all")) >= LEFT * left[""]
    )


GROSS = frozenset({"phase_wrap", "flying_pixels", "quantization", "interference"})
"""Biases that are no smooth field: edges, turns, steps and stripes that no other effect makes."""
VISIBLE = 60.0
"""Chi-square of a map after pose below which nobody can see it."""


def _left(truth: Truth, effect: str, others: tuple[str, ...]) -> dict[str, float] | None:
    """Chi-square of the true map: whole (`all`), after pose (an empty name), and after pose and each other effect's best shape."""
    from tof_gap.config import GapConfig
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.solve.hypotheses.candidates import candidates
    from tof_gap.solve.hypotheses.columns import build

    true = truth.map(effect)
    if true is None:
        return None
    store, chain = truth.session()
    for v, view in enumerate(store.views):
        view.residual[...] = np.nan_to_num(true[v])
    tested: list[Candidate] = [c for c in candidates(store.views, store.scene, NoiseLimits()) if c.name in others]  # type: ignore[attr-defined]
    design = build(store, tested, chain, GapConfig().hand_sd)
    out = {"all": float(design.system.normal.gram[:, -1, -1].sum()), "": design.system.fit(np.zeros(0, np.int64)).energy}
    for c, group in zip(tested, design.groups, strict=True):
        energy = design.system.fit(group, free_hand=c.effect is None).energy
        out[c.name] = min(energy, out.get(c.name, np.inf))
    return out | {name: np.inf for name in others if name not in out}


def label_error(truth: Truth, cameras: Float) -> float:
    """Mean |label - true label| in mm over the views' CAD pixels, given where the diagnosis has the cameras (V, 4, 4)."""
    from tof_core.bag import open_bag
    from tof_scene.raycast import Raycaster
    from tof_scene.render import render
    from tof_scene.scene_file import load_scene

    caster = Raycaster(load_scene(truth.bag / "scene" / "scene.yaml"))
    with open_bag(truth.recorded) as reader:
        camera = next(iter(reader.captures())).camera
    errors = []
    for T, true in zip(cameras, truth.arrays["T_cell_camera"], strict=True):
        a, b = (render(caster, camera, t, footprints=False, step=4).depth for t in (T, true))
        # Pixels that fall on another surface are no label error of the pose.
        near = np.abs(a - b) < OTHER_SURFACE_M
        errors.append(float(np.abs(a - b)[near].mean()))
    return 1e3 * float(np.mean(errors))


OTHER_SURFACE_M = 0.03


def _session(truth: Truth) -> tuple[ColumnStore, Chain]:
    from dataclasses import replace

    from tof_align.chain import chain_of
    from tof_align.folds import deal
    from tof_core.se3 import inverse
    from tof_gap.config import GapConfig
    from tof_gap.limits.solve import SelectLimits
    from tof_gap.solve.hypotheses.columns import ColumnStore
    from tof_gap.solve.start import observe
    from tof_scene.raycast import Raycaster
    from toftwin.diagnosis import GapPipelineConfig
    from toftwin.inputs import opened
    from toftwin.pipeline import raw_views

    config = GapPipelineConfig()
    with opened(truth.recorded, truth.bag / "scene" / "scene.yaml", config) as (reader, scene):
        assert scene is not None
        views = raw_views(reader, config)
    caster = Raycaster(scene)
    seed = chain_of(views, config.align.priors)
    arm = np.stack([inverse(seed.robot[v]) @ T for v, T in enumerate(truth.arrays["T_cell_camera"])])
    evidence = observe(views, caster, replace(seed, arm=arm), GapConfig())
    # The true map takes the residual's place; priors hold around the true poses.
    true = replace(seed, robot=truth.arrays["T_cell_camera"].astype(float))
    store = ColumnStore(evidence, deal(true.station.tolist(), SelectLimits().folds))
    store.scene = caster.scene  # type: ignore[attr-defined]
    return store, true
