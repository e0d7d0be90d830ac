# SPDX-License-Identifier: Apache-2.0
"""Third process: open the answers of foreign sessions and score every report against them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.emerging.causes import CAUSES, OUTSIDE
from benchmarks.gap_check.foreign.separable import SMOOTH_M, correlation, poses
from benchmarks.gap_check.record import BAGS, opened, sealed_names
from benchmarks.gap_check.score import EVERYWHERE, LOCALISED, auroc
from benchmarks.gap_check.separable import Truth, label_error
from tof_core.progress import progress

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from collections.abc import Set as AbstractSet
    from pathlib import Path

    from tof_core.arrays import Float, Mask

MATTERS = 0.15
"""Share of the gap above which each effect of three must be named."""
PLAIN = frozenset({"none", "unknown"})
WRAPPED, LOST, MIXED, LATE = "phase_wrap", "dropout", "flying_pixels", "time_sync"
MAPS_ALIKE_ELSEWHERE = frozenset({"emitter_offset"})
MOTIONS = frozenset({"hand_eye", "intrinsics"})
"""Effects that move the camera or turn its rays: after the freedom of arms only the second order of their maps would be left."""


@dataclass(frozen=True, slots=True)
class ForeignRow:
    """How one session went; figures that do not apply are None."""

    name: str
    kind: str
    scene: str
    robot: str
    truth: tuple[str, ...]
    causes: dict[str, float]
    verdict: tuple[str, ...]
    hit: bool
    miss: str
    wrong: tuple[str, ...]
    separable: bool
    seconds: float
    cpu_s: float
    place: float | None = None
    likeness: float | None = None
    shrink: float | None = None
    true_shrink: float | None = None
    covered: bool | None = None
    label_mm: float | None = None
    confidence: tuple[tuple[str, float, bool], ...] = ()
    below: tuple[tuple[str, float, float], ...] = ()
    """Biases that the verdict does not name: name, what the report states that each stays below (0 without), and the true size, mm RMS."""


def score_foreign(folder: Path) -> list[ForeignRow]:
    """A row per diagnosed session; the seals are checked first."""
    rows, names = [], sealed_names(folder)
    for name in progress(names, "scoring", len(names)):
        out = folder / "reports" / name
        if not (out / "seconds.json").exists():
            continue
        sealed = opened(folder, name)
        kept = out / "foreign.json"
        if not kept.exists():
            kept.write_text(json.dumps(asdict(score_one(sealed, folder / BAGS / name, out))))
        rows.append(_row(json.loads(kept.read_text())))
    return rows


def _row(kept: dict[str, Any]) -> ForeignRow:
    tuples = ("truth", "verdict", "wrong")
    confidence = tuple((str(e), float(c), bool(r)) for e, c, r in kept["confidence"])
    below = tuple((str(e), float(mm), float(true)) for e, mm, true in kept.get("below", ()))
    return ForeignRow(**kept | {k: tuple(kept[k]) for k in tuples} | {"confidence": confidence, "below": below})


def score_one(sealed: Path, bag: Path, out: Path) -> ForeignRow:
    """One session."""
    case = json.loads((sealed / "case.json").read_text())
    took = json.loads((out / "seconds.json").read_text())
    separable = case["separable"]
    effects = tuple(case["effects"])
    row = partial(
        ForeignRow,
        case["name"],
        case["kind"],
        case["scene"],
        case["robot"],
        effects or tuple(sorted(e for e in separable if e.startswith(OUTSIDE))),
        case["causes"],
        separable=all(s["separable"] for s in separable.values()),
        seconds=took["wall_s"],
        cpu_s=took["cpu_s"],
    )
    if not (out / "gap.json").exists():
        return row(("refused",), hit=False, miss="refused", wrong=())
    report = json.loads((out / "gap.json").read_text())
    verdict = tuple(report["verdict"])
    meant = as_meant(verdict, case["causes"])
    wrong = wrong_ones(meant, effects, case["left_out"])
    miss = judge(case, meant, wrong)
    maps, truth = np.load(out / "gap_maps.npz"), Truth(sealed, bag)
    place, likeness = (None, None) if case["left_out"] else _maps(effects, maps, truth)
    found = {n for v in verdict for n in v.split("|")} & set(effects)
    # Late stamps are no error of depth, so nothing is rendered with and without them.
    stated, true, covered = (None, None, None) if LATE in effects else _shrink(report, maps, truth, found)
    return row(
        verdict,
        hit=not miss,
        miss=miss,
        wrong=wrong,
        place=place,
        likeness=likeness,
        shrink=stated,
        true_shrink=true,
        covered=covered,
        label_mm=_label(truth, maps, effects),
        confidence=tuple((c["effect"], c["confidence"], as_meant((c["effect"],), case["causes"])[0] in effects) for c in report["causes"]),
        below=_below(report, truth, effects),
    )


def as_meant(verdict: tuple[str, ...], causes: Collection[str]) -> tuple[str, ...]:
    """The verdict with `phase_wrap` for `dropout` where firmware drops the pixels that it unwraps wrongly: either name is right."""
    if not any(CAUSES[c].effect == WRAPPED for c in causes) or any(CAUSES[c].effect == LOST for c in causes):
        return verdict
    return tuple(sorted({WRAPPED if v == LOST else v for v in verdict}))


def wrong_ones(verdict: tuple[str, ...], effects: tuple[str, ...], left_out: str) -> tuple[str, ...]:
    """Entries of the verdict that assert an effect and hold none of the session's own."""
    own = set(effects) - {left_out}
    return tuple(v for v in verdict if v not in PLAIN and not set(v.split("|")) & own)


def judge(case: dict[str, Any], verdict: tuple[str, ...], wrong: tuple[str, ...]) -> str:
    """The kind of miss, or nothing."""
    entries = [set(v.split("|")) for v in verdict]
    if case["kind"] == "null":
        return "" if verdict == ("none",) else "false alarm"
    if case["kind"] in ("outside", "left-out"):
        if "unknown" not in verdict:
            return "taken for another" if wrong else "overlooked"
        return f"also named {', '.join(wrong)}" if wrong else ""
    for effect in sorted(case["effects"]):
        if case["kind"] == "triple" and case["separable"][effect]["gap_share"] < MATTERS:
            continue
        mine = [e for e in entries if effect in e]
        if not mine:
            return f"{effect} not named"
        rivals = set(case["separable"][effect]["rivals"])
        if mine[0] - {effect} - rivals:
            return f"tied: {'|'.join(sorted(mine[0]))}"
    if case["kind"] == "triple":
        return ""
    if wrong:
        return f"also named {', '.join(wrong)}"
    return "unknown beside a sufficient answer" if "unknown" in verdict else ""


def _maps(effects: tuple[str, ...], maps: Any, truth: Truth) -> tuple[float | None, float | None]:
    """AUROC of localised effects, correlation of those everywhere: the least over the session's effects that were named."""
    places, alike = [], []
    free = None
    for effect in effects:
        true = truth.map(effect)
        if true is None or effect not in maps or maps[effect].shape != true.shape:
            continue
        named = maps[effect].astype(float)
        if effect in LOCALISED:
            places.append(auroc(named, true))
        elif effect in EVERYWHERE | MAPS_ALIKE_ELSEWHERE:
            free = free or poses(truth.arrays, truth.meta)
            alike.append(correlation(free, named, true, as_is=effect in MOTIONS))
    return (min(places) if places else None), (min(alike) if alike else None)


def _shrink(report: dict[str, Any], maps: Any, truth: Truth, found: AbstractSet[str]) -> tuple[float | None, float | None, bool | None]:
    """Stated shrink; the re-rendered one, of the session's own effects in `found`; whether the interval holds it."""
    stated, held = report["gap"]["shrink"], report["split"]["held_out_views"]
    bias = truth.arrays["bias_all"]
    if stated is None or maps["residual_m"].shape != bias.shape or not np.nansum(bias.astype(float) ** 2):
        return None, None, None
    arrays = truth.arrays | ({"measured": _measured(truth)} if MIXED in found else {})
    true = shrink_of(arrays, found, held, seen=np.isfinite(maps["residual_m"][held]))
    low, high = report["gap"]["shrink_ci95"]
    return stated, true, bool(low <= true <= high)


def shrink_of(arrays: Mapping[str, Any], found: AbstractSet[str], held: Sequence[int], *, seen: Mask) -> float:
    """Share of the mean error's energy in the pixels `seen` of held-out views that goes with the effects in `found`.

    It is re-rendered: the mean error with all causes, and without those of the named effects. An effect that the session does not have
    removes nothing.
    """
    bias = arrays["bias_all"].astype(float)
    # Wrongly unwrapped pixels are no part of the mean error: they differ from capture to capture.
    wraps = np.nan_to_num(arrays.get(f"bias_{WRAPPED}", np.zeros(bias.shape)).astype(float))[held]
    biased = {k.removeprefix("bias_") for k in arrays if k.startswith("bias_")} - {"all", WRAPPED}
    removed = bias if biased <= found else sum((arrays[f"bias_{e}"].astype(float) for e in sorted(biased & found)), np.zeros(bias.shape))
    with_it = (arrays["error_healthy"].astype(float) + bias)[held]
    without = with_it - removed[held]
    smooth = seen & (np.abs(with_it) < SMOOTH_M) & (np.abs(without) < SMOOTH_M)
    with_it, without = with_it + wraps, without + (0.0 if WRAPPED in found else wraps)
    before, after = float((with_it[smooth] ** 2).sum()), float((without[smooth] ** 2).sum())
    if "measured" in arrays:
        # Mixed pixels that the healthy camera's filter removes: they have an error with the effect alone.
        mixed = (arrays["measured"] - arrays["depth"])[held][seen & ~np.isfinite(arrays["error_healthy"][held])]
        before += float(np.nansum(mixed.astype(float) ** 2))
    return 1 - after / max(before, 1e-12)


def _below(report: dict[str, Any], truth: Truth, effects: tuple[str, ...]) -> tuple[tuple[str, float, float], ...]:
    """The session's own biases that the verdict does not name, 0 for one without a bound; one of parts has the size that it has on one of them."""
    named, out = {n for v in report.get("verdict", ()) for n in v.split("|")}, []
    for effect in effects:
        true = truth.bias(effect)
        if true is None or effect in named:
            continue
        # The report does not decide what is counted: an overlooked effect without a bound is not below it.
        bound = report.get("absent", {}).get(effect) or {"below_mm": 0.0, "part": None}
        square = np.where(np.abs(true) < SMOOTH_M, np.square(true), np.nan)
        part = truth.arrays["part"]
        seen = [part == k for k in np.unique(part[part >= 0])] if bound["part"] else [np.isfinite(square)]
        size = max(float(np.nanmean(square[s])) for s in seen if np.isfinite(square[s]).any())
        out.append((effect, float(bound["below_mm"]), 1e3 * float(np.sqrt(size))))
    return tuple(out)


def _measured(truth: Truth) -> Float:
    """(V, H, W) metres of z as recorded, in the order of the true views."""
    from tof_core.bag import open_bag
    from toftwin.diagnosis import GapPipelineConfig
    from toftwin.pipeline import raw_views

    with open_bag(truth.bag / "bag") as reader:
        return np.stack([view.depth for view in raw_views(reader, GapPipelineConfig())])


def _label(truth: Truth, maps: Any, effects: tuple[str, ...]) -> float | None:
    """Label error in mm at the diagnosis's poses; nothing where a range offset or late stamps hide the pose."""
    if {"range_offset", LATE} & set(effects) or len(maps["T_cell_camera"]) != len(truth.arrays["T_cell_camera"]):
        return None
    poses_found: Float = maps["T_cell_camera"]
    return label_error(truth, poses_found)
