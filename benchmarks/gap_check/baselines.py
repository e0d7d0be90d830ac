# SPDX-License-Identifier: Apache-2.0
"""What others would do: one effect by least squares after per-view ICP, and boosted trees with importances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_gap.solve.hypotheses.columns import ColumnStore

NOTICED = 0.02
"""Share of the residual's energy that must go before either names anything (nulls stay below it)."""

FEATURES = ("wiggling", "multipath", "amplitude_bias", "fixed_pattern", "fixed_pattern", "temperature_drift", "flying_pixels")
"""The effect that each feature speaks for: range, incidence, amplitude, column, row, temperature, edge distance."""


def session(bag: Path) -> tuple[ColumnStore, list[Float]]:
    """Evidence of a bag after a free pose per view (point to plane), and each view's residual (n,)."""
    from dataclasses import replace

    from tof_align.chain import chain_of
    from tof_align.folds import deal
    from tof_align.pixels import sample
    from tof_align.session import near
    from tof_core import se3
    from tof_gap.config import GapConfig
    from tof_gap.limits.solve import SelectLimits
    from tof_gap.solve.hypotheses.columns import ColumnStore
    from tof_gap.solve.start import observe
    from tof_scene.raycast import Raycaster
    from tof_sensor.geometry import pose_columns
    from toftwin.diagnosis import GapPipelineConfig
    from toftwin.inputs import opened
    from toftwin.pipeline import raw_views

    config, gap = GapPipelineConfig(), GapConfig()
    with opened(bag / "bag", bag / "scene" / "scene.yaml", config) as (reader, scene):
        assert scene is not None
        views = raw_views(reader, config)
    caster = Raycaster(scene)
    samples = [sample(v, config.align.weights) for v in views]
    chain = near(samples, chain_of(samples, config.align.priors), caster, config.align)
    for _ in range(3):
        evidence = observe(views, caster, chain, gap, footprints=False)
        arm = []
        for v, view in enumerate(evidence):
            J = pose_columns(view.frame.take(view.pixels))[0]
            r = view.residual.ravel()[view.pixels]
            w = 1.0 / view.sigma.ravel()[view.pixels]
            step = np.linalg.lstsq(J * w[:, None], r * w, rcond=1e-8)[0]
            arm.append(chain.arm[v] @ se3.exp(step))
        chain = replace(chain, arm=np.array(arm))
    evidence = observe(views, caster, chain, gap, footprints=False)
    store = ColumnStore(evidence, deal(chain.station.tolist(), SelectLimits().folds))
    return store, [v.residual.ravel()[v.pixels] / v.sigma.ravel()[v.pixels] for v in evidence]


def least_squares(store: ColumnStore, residual: list[Float]) -> str:
    """The one effect whose columns explain most of what ICP left."""
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.solve.hypotheses.candidates import candidates

    scene = store.views[0].frame.context.caster.scene  # type: ignore[union-attr]
    y = np.concatenate(residual)
    best, name = 0.0, "none"
    tested = [c for c in candidates(store.views, scene, NoiseLimits()) if c.effect is not None]
    for candidate, columns in zip(tested, store.of(tested), strict=True):
        X = np.concatenate([c / v.sigma.ravel()[v.pixels][:, None] for c, v in zip(columns, store.views, strict=True)])
        left = y - X @ np.linalg.lstsq(X, y, rcond=1e-8)[0]
        share = 1 - float(left @ left) / float(y @ y)
        if share > best:
            best, name = share, candidate.name
    return name if best > NOTICED else "none"


def boosting(store: ColumnStore, residual: list[Float]) -> str:
    """The effect that the most important feature of boosted trees speaks for."""
    from scipy.ndimage import distance_transform_edt
    from sklearn.ensemble import HistGradientBoostingRegressor
    from sklearn.inspection import permutation_importance

    rows = []
    for v in store.views:
        row, column = np.divmod(v.pixels, v.residual.shape[1])
        edge = np.asarray(distance_transform_edt(~v.edge)).ravel()[v.pixels]
        light = np.log(np.maximum(v.frame.amplitude.ravel()[v.pixels], 1e-9))
        temperature = np.full(len(v.pixels), v.view.temperature)
        incidence = v.rendering.incidence.ravel()[v.pixels]
        rows.append(np.stack([v.frame.radial.ravel()[v.pixels], incidence, light, column, row, temperature, edge], axis=1))
    held = np.concatenate([np.full(len(r), i % 3 == 1) for i, r in enumerate(rows)])
    X, y = np.concatenate(rows), np.concatenate(residual)
    model = HistGradientBoostingRegressor(max_iter=60, random_state=0).fit(X[~held], y[~held])
    if model.score(X[held], y[held]) < NOTICED:
        return "none"
    importance = permutation_importance(model, X[held][::4], y[held][::4], n_repeats=3, random_state=0).importances_mean
    return FEATURES[int(np.argmax(importance))]
