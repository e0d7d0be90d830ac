# SPDX-License-Identifier: Apache-2.0
"""`inspection.json`, and a page with each part's verdict, expected and measured depth."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3
from tof_core.page import image_uri, render_page
from tof_inspect.evidence import eroded, render_at

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_core.arrays import Float, Image, Mask
    from tof_core.capture import Posed, View
    from tof_inspect.history import Trend
    from tof_inspect.judge import Inspection, Inspector, PartVerdict

SCHEMA = "toftwin.inspection/1"
ORDER = {"absent": 0, "displaced": 1, "not_observable": 2, "present": 3}
"""Order of the states on the page: parts that need attention first."""

PICTURE_PX = 900
"""Width of a part's picture: as wide as a page shows it."""


def content(found: Inspection, scene: str) -> dict[str, Any]:
    """Content of `inspection.json`."""
    states = [v.state for v in found.verdicts]
    return {
        "schema": SCHEMA,
        "scene": scene,
        "counts": {state: states.count(state) for state in ("present", "absent", "displaced", "not_observable")},
        "evidence": found.colour,
        "parts": [v.to_dict() for v in found.verdicts],
        "views": [
            {"stamp_ns": v.stamp_ns, "accepted": p.accepted, "verdict": p.verdict} for v, p in zip(found.views, found.posed, strict=True)
        ],
    }


def write(inspector: Inspector, found: Inspection, folder: Path, title: str, trends: Sequence[Trend] = ()) -> Path:
    """Write `inspection.json` and `inspection.html` into a folder; returns the page."""
    folder.mkdir(parents=True, exist_ok=True)
    result = content(found, inspector.scene.digest) | {"trends": [t.to_dict() for t in trends]}
    (folder / "inspection.json").write_text(json.dumps(result, indent=1), encoding="utf-8")
    rows = [v.to_dict() | {"picture": picture(inspector, v, found.views, found.posed)} for v in found.verdicts]
    light = any(v.amplitude is not None for v in found.views)
    rows.sort(key=lambda row: (ORDER[row["state"]], row["judged"], row["name"]))
    text = render_page(
        "tof_inspect",
        "inspection.html.j2",
        f"Inspection of {title}",
        sentence=sentence(found.verdicts),
        todo=todo(found.verdicts),
        trends=[t.words() for t in trends if t.creeps],
        evidence=found.colour,
        parts=rows,
        columns=[*(["amplitude"] if light else []), "measured depth", "CAD with the part", "CAD without it"],
        views=result["views"],
        all_accepted=all(v["accepted"] for v in result["views"]),
        scene=inspector.scene.digest[:12],
    )
    page = folder / "inspection.html"
    page.write_text(text, encoding="utf-8")
    return page


def sentence(verdicts: Sequence[PartVerdict]) -> str:
    """The verdicts in one sentence."""
    of = {state: [v for v in verdicts if v.state == state] for state in ORDER}
    wrong = [
        *([f"absent: {_names(of['absent'])}"] if of["absent"] else []),
        *([f"displaced: {_named([f'{v.name} by {v.displaced_mm:.1f} mm' for v in of['displaced']])}"] if of["displaced"] else []),
    ]
    begin = "; ".join(wrong) if wrong else f"{len(of['present'])} of {len(verdicts)} parts are in their place"
    placed = len(of["present"]) - sum(not v.judged for v in of["present"])
    unsure, unseen = [v for v in of["present"] if not v.judged], of["not_observable"]
    rest = [
        *([f"{placed} in their place" if placed > 1 else "1 in its place"] if wrong and placed else []),
        *([f"{len(unsure)} present, but their tolerance cannot be judged" if len(unsure) > 1 else "1 present, but its tolerance cannot be judged"] if unsure else []),
        *([f"{len(unseen)} not observable"] if unseen else []),
    ]  # fmt: skip
    return begin[0].upper() + begin[1:] + (". " + ", ".join(rest) if rest else "") + "."


def todo(verdicts: Sequence[PartVerdict]) -> list[str]:
    """Recommendations: parts to correct, then captures that make other parts judgeable, those for most parts first."""
    lines = [f"Put {v.name} in: it is absent." for v in verdicts if v.state == "absent"]
    for v in (v for v in verdicts if v.state == "displaced"):
        x, y, z = (round(-s, 1) + 0.0 for s in v.shift_mm)
        lines.append(f"Move {v.name} by ({x:.1f}, {y:.1f}, {z:.1f}) mm in the cell: it is {v.displaced_mm:.1f} ± {v.std_mm:.1f} mm off.")
    wanted: dict[str, list[str]] = {}
    for v in verdicts:
        if v.todo:
            wanted.setdefault(v.todo, []).append(v.name)
    for what, names in sorted(wanted.items(), key=lambda w: -len(w[1])):
        lines.append(f"To judge {_named(names)}: {what}.")
    return lines


def _names(verdicts: Sequence[PartVerdict]) -> str:
    return _named([v.name for v in verdicts])


def _named(names: Sequence[str], most: int = 6) -> str:
    """Names in a line; beyond `most`, only their number."""
    shown = [*names[:most], f"{len(names) - most} more"] if len(names) > most else list(names)
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def picture(inspector: Inspector, verdict: PartVerdict, views: Sequence[View], posed: Sequence[Posed], margin: int = 20) -> str:
    """Crops as an embedded PNG image: amplitude if recorded, measured depth, the CAD with and without the part; "" where no view shows the part."""
    from tof_scene.render import render

    index = inspector.scene.index(verdict.name)
    best = max(
        (s for s in zip(views, posed, strict=True) if s[1].accepted), key=lambda s: _size(inspector, s[1], s[0], verdict.name), default=None
    )
    if best is None:
        return ""
    view, pose = best
    whole = render(inspector.caster, view.camera, pose.T_cell_camera, footprints=False)
    covered = whole.part == index
    if not covered.any():
        return ""
    box = _box(covered, margin)
    behind = render_at(inspector.without(verdict.name), view.camera, pose.T_cell_camera, covered)
    bare = np.where(covered, behind, whole.depth).astype(np.float32)
    amplitude = None if view.amplitude is None else view.amplitude[box]
    return _png(amplitude, [view.depth[box], whole.depth[box], bare[box]], covered[box])


def _size(inspector: Inspector, posed: Posed, view: View, name: str) -> float:
    """Relative size of a part in a view: share of its vertices inside the image, divided by their squared distance."""
    p = se3.apply(se3.inverse(posed.T_cell_camera), inspector.scene.part(name).vertices)
    uv = view.camera.project(p)
    inside = (p[:, 2] > 0.05) & (uv > -0.5).all(axis=1) & (uv < [view.camera.width - 0.5, view.camera.height - 0.5]).all(axis=1)
    return float(inside.mean() / max(float(np.median(p[:, 2])), 0.05) ** 2)


def _box(covered: Mask, margin: int) -> tuple[slice, slice]:
    rows, cols = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    return slice(max(rows[0] - margin, 0), rows[-1] + margin + 1), slice(max(cols[0] - margin, 0), cols[-1] + margin + 1)


def _png(amplitude: Image | None, crops: Sequence[Image], covered: Mask) -> str:
    import matplotlib as mpl

    low, high = np.nanpercentile(crops[1][covered], [2, 98]) + np.array([-0.02, 0.02])
    shown = []
    if amplitude is not None:
        light = np.sqrt(np.nan_to_num(np.maximum(amplitude, 0.0)))
        shown.append(np.repeat(np.clip(light / max(float(np.percentile(light, 99)), 1e-9), 0, 1)[..., None], 3, axis=2))
    for crop in crops:
        rgb = mpl.colormaps["viridis"](np.clip((crop - low) / (high - low), 0, 1))[..., :3]
        rgb[~np.isfinite(crop)] = 0.85
        shown.append(rgb)
    scale = max(1, round(PICTURE_PX / (len(shown) * covered.shape[1])))
    large = np.kron(covered, np.ones((scale, scale), bool))
    outline = large & ~eroded(large)
    wide: list[Float] = []
    for image in shown:
        grown = np.kron(image, np.ones((scale, scale, 1)))
        grown[outline] = (1.0, 0.25, 0.1)
        wide += [grown, np.ones((len(grown), 6, 3))]
    return image_uri((255 * np.concatenate(wide[:-1], axis=1)).astype(np.uint8))
