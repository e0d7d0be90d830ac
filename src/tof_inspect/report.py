# SPDX-License-Identifier: Apache-2.0
"""`inspection.json` and one page that shows each part: expected depth, measured depth, verdict."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3
from tof_core.page import image_uri, render_page
from tof_inspect.evidence import render_at

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_core.arrays import Float, Image, Mask
    from tof_core.capture import Posed, View
    from tof_inspect.judge import Inspection, Inspector, PartVerdict

SCHEMA = "toftwin.inspection/1"


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


def write(inspector: Inspector, found: Inspection, folder: Path, title: str) -> Path:
    """Write `inspection.json` and `inspection.html` into a folder; returns the page."""
    folder.mkdir(parents=True, exist_ok=True)
    result = content(found, inspector.scene.digest)
    (folder / "inspection.json").write_text(json.dumps(result, indent=1), encoding="utf-8")
    rows = [v.to_dict() | {"picture": picture(inspector, v, found.views, found.posed)} for v in found.verdicts]
    order = {"absent": 0, "displaced": 1, "not_observable": 2, "present": 3}
    rows.sort(key=lambda row: (order[row["state"]], row["name"]))
    values = {"counts": result["counts"], "evidence": found.colour, "parts": rows, "views": result["views"]}
    page = folder / "inspection.html"
    page.write_text(render_page("tof_inspect", "inspection.html.j2", f"Inspection of {title}", **values), encoding="utf-8")
    return page


def picture(inspector: Inspector, verdict: PartVerdict, views: Sequence[View], posed: Sequence[Posed], margin: int = 12) -> str:
    """Three crops as a PNG data URL: measured depth, the CAD with the part, the CAD without it; "" where no view has the part."""
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
    return _png([view.depth[box], whole.depth[box], bare[box]], covered[box])


def _size(inspector: Inspector, posed: Posed, view: View, name: str) -> float:
    """Size of a part in a view: its vertices inside the image over the square of their distance."""
    p = se3.apply(se3.inverse(posed.T_cell_camera), inspector.scene.part(name).vertices)
    uv = view.camera.project(p)
    inside = (p[:, 2] > 0.05) & (uv > -0.5).all(axis=1) & (uv < [view.camera.width - 0.5, view.camera.height - 0.5]).all(axis=1)
    return float(inside.mean() / max(float(np.median(p[:, 2])), 0.05) ** 2)


def _box(covered: Mask, margin: int) -> tuple[slice, slice]:
    rows, cols = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    return slice(max(rows[0] - margin, 0), rows[-1] + margin + 1), slice(max(cols[0] - margin, 0), cols[-1] + margin + 1)


def _png(crops: Sequence[Image], covered: Mask) -> str:
    import matplotlib as mpl

    outline = covered & ~_eroded(covered)
    low, high = np.nanpercentile(crops[1], [2, 98]) + np.array([-0.005, 0.005])
    shown = []
    for crop in crops:
        rgb = mpl.colormaps["viridis"](np.clip((crop - low) / (high - low), 0, 1))[..., :3]
        rgb[~np.isfinite(crop)] = 0.85
        rgb[outline] = 0.6 * rgb[outline] + 0.4 * np.array([1.0, 0.2, 0.1])
        shown += [rgb, np.ones((rgb.shape[0], 2, 3))]
    wide: Float = np.concatenate(shown[:-1], axis=1)
    scale = max(1, 120 // wide.shape[0])
    return image_uri((255 * np.kron(wide, np.ones((scale, scale, 1)))).astype(np.uint8))


def _eroded(mask: Mask) -> Mask:
    from scipy import ndimage

    return np.asarray(ndimage.binary_erosion(mask))
