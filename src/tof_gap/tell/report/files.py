# SPDX-License-Identifier: Apache-2.0
"""The report's files: `gap.json`, `gap_maps.npz` and `sensor.yaml` (docs/gap.md)."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from tof_core import se3
from tof_core.memory import give_back
from tof_core.reasons import Reason
from tof_gap.seen.finding import not_expected
from tof_gap.seen.noise.photons import variance_of_mean
from tof_gap.seen.session import amplitude_unit
from tof_gap.solved import ANY_PART
from tof_gap.tell.figures.where import by_quantity, regions
from tof_gap.tell.report.plant import plant_words, to_dicts
from tof_sensor.effect import Evidence
from tof_sensor.model import SensorModel, save_model
from tof_sensor.origin import Promise

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.finding import Finding
    from tof_gap.solved import Bound
    from tof_gap.tell.account import Cause
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_gap.tell.figures.shrink import Shrink
    from tof_gap.tell.report.kept import Kept
    from tof_scene.raycast import Raycaster
    from tof_sensor.effect import Effect

SCHEMA = "toftwin.gap/1"
FAST = 1
"""Level of compression of the maps: noise does not shrink, and what is the same everywhere shrinks at any level."""


def region_maps(diagnosis: Diagnosis, caster: Raycaster) -> list[Ints]:
    """(H, W) region of each pixel per view, -1 off the CAD."""
    of_face = caster.scene.surface_regions()
    return [np.where(v.rendering.face >= 0, of_face[v.rendering.face], -1).astype(np.int32) for v in diagnosis.evidence]


def report(d: Diagnosis, caster: Raycaster, maps: list[Ints], advice: list[str], kept: Kept | None = None) -> dict[str, Any]:
    """The content of `gap.json`; `kept`: shrink by a sensor model that was fitted to another session."""
    limits = d.config.report.where
    found = regions(d.evidence, d.residual, d.floor2, maps, caster.scene, d.config.report)
    content: dict[str, Any] = _finite(
        {
            "schema": SCHEMA,
            "verdict": list(d.verdict),
            "notes": [note._asdict() for note in d.notes],
            "gap": _shrink(d.gap)
            | {"explainable": d.explainable, "dispersion": _dispersion(d), "missing": _missing(d), "floor_from": _floor_from(d)},
            "causes": [_cause(c, d) for c in d.causes] + [_finding(f) for f in not_expected(d.findings)],
            "expected": [_finding(f) for f in d.findings if f.expected],
            "words": to_dicts(plant_words(d, caster.scene)),
            "where": {
                "regions": [asdict(r) for r in found[: limits.regions]],
                "by": {k: [asdict(b) for b in bins] for k, bins in by_quantity(d.evidence, d.residual, d.floor2, limits.bins).items()},
            },
            "small": list(d.solved.small),
            "small_mm": {name: 1e3 * size for name, size in sorted(d.solved.small_m.items())},
            "unexplained": asdict(d.unexplained),
            "world": d.world,
            "absent": {name: None if bound is None else _bound(bound, caster.scene.names) for name, bound in d.absent.items()},
            "not_testable": d.not_testable,
            "pose": _pose(d),
            "advice": advice,
            "split": {"fit_views": list(d.split.fit), "held_out_views": list(d.split.held_out), "stray_views": list(d.stray)},
        }
        | ({} if kept is None else {"promise": kept.to_dict()})
    )
    return content


def _bound(bound: Bound, parts: Sequence[str]) -> dict[str, Any]:
    return {"below_mm": 1e3 * bound.below_m, "part": None if bound.part == ANY_PART else parts[bound.part]}


def _shrink(s: Shrink) -> dict[str, Any]:
    return {
        "before_mm": asdict(s.before),
        "after_mm": asdict(s.after),
        "floor_mm": s.floor_mm,
        "shrink": s.shrink,
        "shrink_ci95": None if s.ci95 is None else list(s.ci95),
        "off_edges_mm": None if s.off_edges_mm is None else dict(zip(("before", "after"), s.off_edges_mm, strict=True)),
    }


def _cause(c: Cause, d: Diagnosis) -> dict[str, Any]:
    params = [_params(e) for e in c.named.effects]
    alone = _shrink(c.alone)
    return {
        "effect": c.named.name,
        "tied_with": list(c.named.ties),
        "asserted": not d.suspected(c),
        "confidence": d.confidence(c),
        "size_mm": 1e3 * c.size_m,
        "params": params[0] if len(params) == 1 else {str(i): p for i, p in enumerate(params)},
        "params_std": c.named.std[0] if len(params) == 1 else {str(i): s for i, s in enumerate(c.named.std)},
        "alone": {k: alone[k] for k in ("after_mm", "shrink", "shrink_ci95")} | {"off_edges": c.alone.off_edges},
        "left_out": {"shrink": c.left_out},
    }


def _finding(f: Finding) -> dict[str, Any]:
    return {
        "effect": f.name,
        "tied_with": [],
        "asserted": True,
        "confidence": f.confidence,
        "size_mm": None,
        "params": _params(f.effect),
        "params_std": f.std,
        "alone": {"after_mm": None, "shrink": None, "shrink_ci95": None, "off_edges": None},
        "left_out": {"shrink": None},
        "note": f.note,
    }


def _params(effect: Effect) -> dict[str, Any]:
    """Parameters by name; an image in text form is in `sensor.yaml` alone."""
    values = {k: _plain(getattr(effect, k)) for k in type(effect).__dataclass_fields__ if k.islower()}  # type: ignore[attr-defined]
    return {k: v for k, v in values.items() if not (isinstance(v, str) and len(v) > LONGEST_TEXT)}


LONGEST_TEXT = 200
"""Longest parameter in characters that the report shows."""


def _plain(value: Any) -> Any:
    return [float(v) for v in value] if isinstance(value, tuple) else value.item() if isinstance(value, np.generic) else value


def _floor_from(d: Diagnosis) -> str:
    """From what the floor was estimated, in words."""
    single = sum(v.view.captures == 1 for v in d.evidence)
    how = f"{single} of {len(d.evidence)} views are of one capture: " if single else ""
    return f"{how}noise, which a pixel does not share with others nearby, and the uncertainty of the poses"


def _dispersion(d: Diagnosis) -> dict[str, float]:
    """Ratio of noise to the photon law of the unnamed noise: of all noise, and without the named noise."""
    law, seen = d.law, [v for v in d.evidence if v.smooth.any()]
    if law is None or not seen:
        return {"before": np.nan, "after": np.nan}
    expected2 = float(np.mean([variance_of_mean(law, v)[v.smooth].mean() for v in seen]))
    sigma2 = float(np.mean([np.mean((v.sigma * v.frame.length)[v.smooth] ** 2) for v in seen]))
    extra2 = sum(float(np.nanmean(np.square(f.share))) for f in d.findings if f.share is not None and f.effect.EVIDENCE is Evidence.NOISE)
    before, after = (float(np.sqrt(max(x, 0.0) / max(expected2, 1e-12))) for x in (sigma2, sigma2 - extra2))
    return {"before": before, "after": after}


def _missing(d: Diagnosis) -> dict[str, float]:
    """Share of CAD pixels without depth: all, and those that the named loss does not predict."""
    gone = without_depth(d)
    predicted = sum(float(np.nanmean(f.share)) for f in d.findings if f.share is not None and f.effect.EVIDENCE is Evidence.MISSING)
    return {"before": gone, "after": max(gone - predicted, 0.0)}


def without_depth(d: Diagnosis) -> float:
    """Share of CAD pixels without depth, mean of the views; of those within the camera's field (`seen.evidence.field`)."""
    inside = [v.frame.valid & ~np.isin(v.view.reason, (Reason.OUT_OF_FIELD, Reason.BETWEEN_POINTS)) for v in d.evidence]
    return float(np.mean([np.mean(~v.view.valid[i]) for v, i in zip(d.evidence, inside, strict=True) if i.any()]))


def _pose(d: Diagnosis) -> dict[str, Any]:
    chain, (arm_mm, arm_deg) = d.chain, arm_errors(d)
    X = se3.log(d.hand_eye)
    return {
        "stations": [
            {"station": int(s), "B_xyz_m": chain.B[i][:3, 3].tolist(), "B_rotvec_deg": np.degrees(se3.so3_log(chain.B[i][:3, :3])).tolist()}
            for i, s in enumerate(chain.names)
        ],
        "hand_eye": {"xyz_m": X[:3].tolist(), "rotvec_deg": np.degrees(X[3:]).tolist()},
        "arm_rms": {"mm": arm_mm, "deg": arm_deg},
        "arm_prior": dict(zip(("mm", "deg"), arm_prior(d), strict=True)) if chain.root is None else None,
    }


def arm_errors(d: Diagnosis) -> tuple[float, float]:
    """Errors of the arm from view to view, RMS: mm and degrees."""
    arm = np.array([se3.log(A) for A in d.chain.arm])
    return 1e3 * _rms(arm[:, :3]), float(np.degrees(_rms(arm[:, 3:])))


def arm_prior(d: Diagnosis) -> tuple[float, float]:
    """RMS of the errors that the robot's prior expects of the arm: mm and degrees; length over three axes, as of `arm_errors`."""
    priors = d.chain.priors
    return float(np.sqrt(3.0) * priors.arm_mm), float(np.sqrt(3.0) * priors.arm_deg)


def _rms(v: Float) -> float:
    return float(np.sqrt((v * v).sum(axis=1).mean()))


def _finite(value: Any) -> Any:
    """The same value with null for numbers that JSON cannot hold."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def sensor_model(d: Diagnosis) -> SensorModel:
    """The fitted sensor: every effect that is asserted or that predicts held-out views, photon law of the unnamed noise, unit of amplitude, camera, promise, scene."""
    causes = [] if d.doubted else d.causes
    effects = [e for c in causes for e in c.named.effects] + [f.effect for f in d.findings]
    law = [] if d.law is None else [d.law]
    return SensorModel((*effects, *law), amplitude_unit(d.evidence), d.camera, _promise(d), d.solved.caster.scene.digest)


def _promise(d: Diagnosis) -> Promise | None:
    """The shrink that the model promises for another session: without wrapped pixels, since no model predicts which pixels wrap."""
    by_chance = {f.name for f in d.findings if f.corrects and f.effect.makes_outliers}
    suspected = {c.named.name for c in d.causes} if d.doubted else set()
    gap = d.account.figures.shrink([n for n in d.shares if n not in by_chance | suspected]) if by_chance else d.gap
    return None if gap.shrink is None or gap.ci95 is None else Promise(gap.shrink, *gap.ci95)


def write(d: Diagnosis, caster: Raycaster, folder: Path, advice: list[str], kept: Kept | None = None) -> dict[str, Any]:
    """Write the three files into `folder` and return the report."""
    give_back()
    folder.mkdir(parents=True, exist_ok=True)
    maps = region_maps(d, caster)
    content = report(d, caster, maps, advice, kept)
    (folder / "gap.json").write_text(json.dumps(content, indent=1, allow_nan=False))
    _save_maps(folder / "gap_maps.npz", d, maps)
    save_model(sensor_model(d), folder / "sensor.yaml")
    return content


def _save_maps(file: Path, d: Diagnosis, regions: Sequence[Ints]) -> None:
    """Write the images of all views as `numpy.savez_compressed` does, but one array at a time, to save memory."""
    arrays: dict[str, Callable[[], NDArray[Any]]] = {
        "view_stamp_ns": lambda: np.array([v.view.stamp_ns for v in d.evidence], np.int64),
        "station": lambda: np.array([v.view.station for v in d.evidence], np.int32),
        "residual_m": lambda: np.stack(d.residual, dtype=np.float32, casting="same_kind"),
        "region": lambda: np.stack(regions),
        "T_cell_camera": lambda: d.cameras,
        **{f.name: partial(np.asarray, f.share, np.float32) for f in d.findings if f.share is not None},
        **{name: partial(_seen_share, d.residual, share) for name, share in d.shares.items()},
    }
    with ZipFile(file, "w", ZIP_DEFLATED, compresslevel=FAST) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array(), allow_pickle=False)


def _seen_share(residual: Sequence[Float], share: Sequence[Float]) -> Float:
    """(V, H, W) a share of the pixels that have a residual, NaN at others."""
    seen = [np.where(np.isfinite(r), m, np.nan) for r, m in zip(residual, share, strict=True)]
    return np.stack(seen, dtype=np.float32, casting="same_kind")
