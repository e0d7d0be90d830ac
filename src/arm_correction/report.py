# SPDX-License-Identifier: Apache-2.0
"""`correction.json` and one page that shows a proposal: what differs now, and what would be left after the move."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.page import render_page
from tof_core.panels import panels

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from arm_correction.correction import Correction
    from arm_correction.frames import Frames
    from arm_correction.reference import Reference
    from tof_core.arrays import Float, Image
    from tof_core.camera import Camera
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster

SPAN_MM = 10.0
"""Ends of the colour scale: differences after a good move are noise, a few millimetres."""
OPEN_MM, OPEN_DEG = 100.0, 10.0
"""Standard deviations beyond any determined direction's: an undetermined one has a metre or a radian."""
COMPARED = {"reference": "the reference view", "cad": "the CAD"}
THEN = {"reference": "the camera then sees the reference view again", "cad": "by the CAD, the camera is then where it is wanted"}


def write(
    made: Mapping[str, Correction],
    view: View,
    frames: Frames,
    folder: Path,
    title: str,
    *,
    reference: Reference | None = None,
    caster: Raycaster | None = None,
) -> Path:
    """Write `correction.json` and `correction.html` into a folder; returns the page.

    Args:
        made: the proposals of a view, by what it was compared with, the deciding one first.
        view: the view.
        frames: hand and frame of the target.
        folder: where to write.
        title: of the page.
        reference: the stored view, where there is one; it is shown.
        caster: the CAD; shown where there is no reference.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "correction.json").write_text(json.dumps({by: c.to_dict() for by, c in made.items()}, indent=1), encoding="utf-8")
    first = next(iter(made.values()))
    text = render_page(
        "arm_correction",
        "correction.html.j2",
        f"Corrective pose: {title}",
        sentence=sentence(first),
        todo=todo(first),
        first=first,
        known=known(first),
        rows=[c.to_dict() | {"compared": COMPARED[by], "known": known(c)} for by, c in made.items()],
        frame=first.frame,
        hand=frames.hand,
        other=COMPARED["cad" if reference is None else "reference"],
        picture=_picture(first, view, frames, reference, caster),
    )
    page = folder / "correction.html"
    page.write_text(text, encoding="utf-8")
    return page


def sentence(c: Correction) -> str:
    """The verdict in words."""
    mm, deg = c.step
    if not c.accepted:
        return f"No move is proposed. {c.reason[:1].upper()}{c.reason[1:]}."
    free = (
        f" Nothing moves along {len(c.unknown)} direction{'s' if len(c.unknown) > 1 else ''} that the surfaces do not determine."
        if c.unknown
        else ""
    )
    return f"Move the hand by {mm:.1f} mm and {deg:.2f}°: {THEN[c.by]}.{free}"


def todo(c: Correction) -> list[str]:
    """What to do now."""
    if not c.accepted:
        return ["Leave the hand where it is.", "Remove the cause, or bring the robot nearer to its mark, and capture again."]
    xyz = ", ".join(f"{v:.4f}" for v in c.T_frame_hand[:3, 3])
    xyzw = ", ".join(f"{v:.5f}" for v in se3.quat_from_matrix(c.T_frame_hand[:3, :3]))
    lines = [
        f"Command the hand to ({xyz}) m, quaternion xyzw ({xyzw}) in {c.frame}, and capture again: the next proposal says what is left."
    ]
    return lines + [f"Not determined: {name}. Look at a surface that faces another way." for name in c.unknown]


def sigma(c: Correction) -> tuple[float, float]:
    """Standard deviation of the target: millimetres and degrees, root of the summed variances of its axes."""
    cov = np.diag(c.cov)
    return 1e3 * float(np.sqrt(cov[:3].sum())), float(np.degrees(np.sqrt(cov[3:].sum())))


def known(c: Correction) -> tuple[str, str]:
    """`sigma` in words; along directions that the surfaces do not determine nothing is known."""
    mm, deg = sigma(c)
    return (f"± {mm:.1f} mm" if mm < OPEN_MM else "partly unknown", f"± {deg:.2f}°" if deg < OPEN_DEG else "partly unknown")


def _picture(c: Correction, view: View, frames: Frames, reference: Reference | None, caster: Raycaster | None) -> str:
    """Difference to what is wanted, now and after the move."""
    T_hand, T_camera = frames.T_hand_camera, se3.inverse(frames.T_hand_camera)
    T_wanted_now = T_camera @ se3.inverse(c.delta) @ T_hand
    if reference is not None:
        wanted, camera = reference.depth, reference.camera
    elif caster is not None and view.robot is not None:
        from tof_scene.render import render

        camera = view.camera
        wanted = render(caster, camera, view.robot.T_cell_camera @ se3.inverse(T_wanted_now), footprints=False).depth
    else:
        return ""
    images = [("wanted", wanted, "depth"), ("now", view.depth, "depth"), ("now minus wanted", view.depth - wanted, "error")]
    if c.accepted:
        images.append(("after the move minus wanted", seen_from(view, camera, T_wanted_now) - wanted, "error"))
    return panels(images, columns=2, span_mm=SPAN_MM)


def seen_from(view: View, camera: Camera, T_other_now: Float) -> Image:
    """(H, W) depth of a view's points as another camera sees them, NaN where none falls; `T_other_now` (4, 4) of the view's camera in it."""
    p = se3.apply(T_other_now, view.camera.points(view.depth)[np.isfinite(view.depth)])
    p = p[p[:, 2] > 0]
    at = np.floor(camera.project(p) + 0.5).astype(np.int64)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < camera.width) & (at[:, 1] < camera.height)
    out = np.full(camera.shape, np.inf)
    np.minimum.at(out, (at[inside, 1], at[inside, 0]), p[inside, 2])
    return np.where(np.isfinite(out), out, np.nan).astype(np.float32)
