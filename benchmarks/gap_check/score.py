# SPDX-License-Identifier: Apache-2.0
"""Third process: open the answers and score every report against them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.gap_check.record import opened, sealed_names
from benchmarks.gap_check.separable import Truth, inseparable, label_error, separable
from tof_core.progress import progress
from tof_core.stats import touched

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float

LOCALISED = frozenset({"multipath", "flying_pixels", "lens_scatter", "specular", "cad_deviation", "dropout"})
EVERYWHERE = frozenset(
    {
        "wiggling",
        "amplitude_bias",
        "temperature_drift",
        "fixed_pattern",
        "intrinsics",
        "hand_eye",
        "range_offset",
        "depth_scale",
        "radial_depth",
    }
)


HALF_A_TURN = 0.4
"""Of the largest jump, beyond which a pixel has another turn than the noise-free map."""
UNSEEN = frozenset({"range_offset", "time_sync", "motion"})
"""Effects beside which the pose itself is not to be seen, or is another at every tap."""


@dataclass(frozen=True, slots=True)
class Row:
    """How one case went; figures that do not apply are None."""

    name: str
    kind: str
    scene: str
    truth: tuple[str, ...]
    verdict: tuple[str, ...]
    hit: bool
    miss: str
    seconds: float
    cpu_s: float
    place: float | None = None
    likeness: float | None = None
    shrink: float | None = None
    true_shrink: float | None = None
    covered: bool | None = None
    left_over_floor: float | None = None
    label_mm: float | None = None
    separable: bool | None = None
    baselines: dict[str, bool] = field(default_factory=dict)


def score_all(folder: Path, *, only: str = "") -> list[Row]:
    """A row per case; the seals are checked first."""
    rows, names = [], sealed_names(folder)
    for name in progress(names, "scoring", len(names)):
        out = folder / "reports" / name
        if only not in name or not (out / "seconds.json").exists():
            continue
        rows.append(_kept(opened(folder, name), folder / "bags" / name, out))
    return rows


def _kept(sealed: Path, bag: Path, out: Path) -> Row:
    """The row of a case, scored once: whoever diagnoses it anew makes its folder anew."""
    path = out / "score.json"
    if path.exists():
        kept = json.loads(path.read_text())
        if "least squares" in kept["baselines"] or not (out / "baselines.json").exists():
            return Row(**kept | {"truth": tuple(kept["truth"]), "verdict": tuple(kept["verdict"])})
    row = score(sealed, bag, out)
    path.write_text(json.dumps(asdict(row)))
    return row


def score(sealed: Path, bag: Path, out: Path) -> Row:
    """One case."""
    case = json.loads((sealed / "case.json").read_text())
    took = json.loads((out / "seconds.json").read_text())
    effects = tuple(sorted(case["effects"]))
    row = partial(Row, case["name"], case["kind"], case["scene"], effects, seconds=took["wall_s"], cpu_s=took["cpu_s"])
    if not (out / "gap.json").exists():
        return row(("refused",), hit=False, miss="refused")
    report = json.loads((out / "gap.json").read_text())
    truth = Truth(sealed, bag)
    verdict = tuple(report["verdict"])
    miss = judge(case, verdict, truth)
    maps = np.load(out / "gap_maps.npz")
    place, likeness = _maps(effects, maps, truth) if not case["left_out"] else (_unknown_place(case, report, truth), None)
    stated, true, covered = _shrinks(effects, report, maps, truth) if not case["left_out"] else (None, None, None)
    over = None
    if not miss and effects and not case["left_out"]:
        over = report["gap"]["after_mm"]["rmse"] / max(report["gap"]["floor_mm"], 1e-9)
    return row(
        verdict,
        hit=not miss,
        miss=miss,
        place=place,
        likeness=likeness,
        shrink=stated,
        true_shrink=true,
        covered=covered,
        left_over_floor=over,
        label_mm=label_error(truth, maps["T_cell_camera"]) if not miss and not case["left_out"] and not UNSEEN & set(effects) else None,
        separable=separable(truth, case["left_out"]) if case["left_out"] else None,
        baselines=_baselines(case, out),
    )


def _baselines(case: dict[str, Any], out: Path) -> dict[str, bool]:
    """Whether each baseline named all of the truth: they name one effect or none, so pairs and withheld effects are beyond them."""
    path = out / "baselines.json"
    if not path.exists():
        return {}
    truth = {"unknown"} if case["left_out"] else set(case["effects"]) or {"none"}
    return {name: {named} == truth for name, named in json.loads(path.read_text()).items()}


def judge(case: dict[str, Any], verdict: tuple[str, ...], truth: Truth) -> str:
    """The kind of miss, or empty for a hit."""
    effects = set(case["effects"])
    entries = [set(v.split("|")) for v in verdict]
    if not effects:
        return "" if verdict == ("none",) else "false alarm"
    if case["left_out"]:
        return "" if "unknown" in verdict else ("taken for another" if verdict != ("none",) else "overlooked")
    for effect in sorted(effects):
        mine = [e for e in entries if effect in e]
        if not mine:
            return f"{effect} not named"
        wide = [other for other in sorted(mine[0] - {effect}) if not inseparable(truth, effect, other)]
        if wide:
            return f"tie too wide: {effect}|{'|'.join(wide)}"
    extra = [e for e in entries if not e & effects]
    if extra:
        return "unknown beside a sufficient answer" if extra == [{"unknown"}] else f"also named {'|'.join(sorted(extra[0]))}"
    return ""


def _maps(effects: tuple[str, ...], maps: Any, truth: Truth) -> tuple[float | None, float | None]:
    """AUROC of localised effects, correlation of those everywhere: the least over the case's effects."""
    places, alike = [], []
    for effect in effects:
        true = truth.map(effect)
        if true is None or effect not in maps:
            continue
        named = maps[effect].astype(float)
        if effect in LOCALISED:
            places.append(auroc(named, true))
        elif effect in EVERYWHERE:
            alike.append(truth.correlation(named, true))
    return (min(places) if places else None), (min(alike) if alike else None)


def auroc(named: Float, true: Float) -> float:
    """How well |named| ranks the worst tenth of |true| above the rest, or all that the effect touches where that is less.

    Edges are a hundredth of the pixels: the rest of the worst tenth is off by nanometres, which are rounding and no place of the effect.
    """
    from scipy.stats import rankdata

    seen = np.isfinite(named) & np.isfinite(true)
    size, worst = np.abs(named[seen]), np.abs(true[seen])
    positive = touched(worst) & (worst > np.quantile(worst, 0.9))
    if not positive.any() or positive.all():
        return float("nan")
    rank = rankdata(size)
    n, m = int(positive.sum()), int((~positive).sum())
    return float((rank[positive].sum() - n * (n + 1) / 2) / (n * m))


def _unknown_place(case: dict[str, Any], report: dict[str, Any], truth: Truth) -> float | None:
    """1 where the part that carries most of the withheld effect is among those named, else 0."""
    if "unknown" not in report["verdict"]:
        return None
    part = truth.worst_part(next(iter(case["effects"])))
    return None if part is None else float(part in report["unexplained"]["where"])


def _shrinks(
    effects: tuple[str, ...],
    report: dict[str, Any],
    maps: Any,
    truth: Truth,
) -> tuple[float | None, float | None, bool | None]:
    """Stated shrink, the one that taking off the true effect would give, and whether the interval holds it."""
    stated, held = report["gap"]["shrink"], report["split"]["held_out_views"]
    biases = {e: m for e in effects if (m := truth.bias(e)) is not None}
    if stated is None or not biases:
        return None, None, None
    residual = maps["residual_m"].astype(float)[held]
    seen = np.isfinite(residual)
    left = residual - np.sum([np.nan_to_num(m[held]) for m in biases.values()], axis=0)
    if "phase_wrap" in biases:
        # At the distance where turns are lost it is noise that decides which pixel loses one: the noise-free map cannot say.
        seen &= np.abs(left) < HALF_A_TURN * np.nanmax(np.abs(biases["phase_wrap"]))
    left = left[seen]
    before2, after2 = float((residual[seen] ** 2).mean()), float((left**2).mean())
    floor2 = (report["gap"]["floor_mm"] * 1e-3) ** 2
    true = 1 - (after2 - floor2) / max(before2 - floor2, 1e-12)
    low, high = report["gap"]["shrink_ci95"]
    return stated, true, bool(low <= true <= high)
