# SPDX-License-Identifier: Apache-2.0
"""Differences from the CAD as plain values, and in one line each."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_scene.scene import Scene
    from tof_scene.world.surprises import Surprises


NOT_ALWAYS = "object in some views only"
"""An object that other views do not show."""
MAY_BE = " and in no other view: a person, the blur of a moving view, or the halo of a lamp or a bright surface"
"""Possible causes of such an object."""
SEE, SEES = "see what lies behind its place", "sees what lies behind its place"
"""The evidence that a part is missing, of several views and of one."""


def described(world: Surprises, scene: Scene) -> dict[str, list[dict[str, Any]]]:
    """`missing` and `foreign` for JSON: views count from 0, metres along the axes of the cell."""
    return {
        "missing": [{"part": scene.names[m.part], "views": list(m.views), "pixels": m.pixels} for m in world.missing],
        "foreign": [
            {
                "centre_m": [round(float(x), 3) for x in f.centre_m],
                "size_m": [round(float(x), 3) for x in f.size_m],
                "views": list(f.views),
                "pixels": f.pixels,
                "moves": f.moves,
            }
            for f in world.foreign
        ],
    }


def lines(world: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[str]:
    """One line per missing part and foreign object, largest first; `world` as `described` gives it."""
    out = [f"missing part: {m['part']}; {of_views(m['views'])} {SEE if len(m['views']) > 1 else SEES}" for m in world["missing"]]
    for f in sorted(world["foreign"], key=lambda f: -f["pixels"]):
        size = " x ".join(f"{100 * s:.0f}" for s in f["size_m"])
        at = ", ".join(f"{x:.2f}" for x in f["centre_m"])
        what, may_be = (NOT_ALWAYS, MAY_BE) if f["moves"] else ("foreign object", "")
        out.append(f"{what}: {size} cm at ({at}), seen in {of_views(f['views'])}{may_be}")
    return out


def missing_in_words(names: Sequence[str]) -> str:
    """Absent parts with the evidence; "" if none is absent."""
    if not names:
        return ""
    return f"{'parts' if len(names) > 1 else 'part'} missing: {', '.join(names)} (the views see what lies behind)"


def of_views(numbers: Sequence[int]) -> str:
    """`view 4`, `views 3 to 9`, `views 1, 4 to 6`; `numbers` count from 0, the text from 1."""
    ordered = sorted({n + 1 for n in numbers})
    if not ordered:
        return "no view"
    starts = [ordered[0], *(b for a, b in pairwise(ordered) if b > a + 1)]
    ends = [*(a for a, b in pairwise(ordered) if b > a + 1), ordered[-1]]
    runs = [str(a) if a == b else f"{a}, {b}" if b == a + 1 else f"{a} to {b}" for a, b in zip(starts, ends, strict=True)]
    return ("view " if len(ordered) == 1 else "views ") + ", ".join(runs)
