# SPDX-License-Identifier: Apache-2.0
"""Parts of sentences: lists, names, shares, intervals, observables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.shares import in_percent

if TYPE_CHECKING:
    from collections.abc import Sequence

PLACE = "place in the cell"
GOES_WITH = {
    "edge_px": "distance to an edge",
    "x_m": PLACE,
    "y_m": PLACE,
    "z_m": PLACE,
    "temperature_c": "temperature",
    "viewed": "distance and brightness of the view",
    "attitude": "the hand's attitude, as where its mount or the arm gives way",
    "arm": "the arm's pose, whose errors exceed what the robot's prior allows",
    "stray_light": "stray light from the rest of the image, over the pixel's own light",
    "region": "the region of the cell that light comes from",
    "ghost": "the light of the opposite side of the image",
}
"""Words for observables whose names are no words of a reader."""
WIDE = 0.5
"""Width of an interval of shares from which it says too little to act on."""


def spaced(name: str) -> str:
    """The name of an effect in a sentence."""
    return name.replace("_", " ").replace("cad ", "CAD ")


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names in a sentence."""
    return f" {last} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def percent(share: float | None) -> str:
    """A share in per cent; a dash where it is not known."""
    return "–" if share is None else in_percent(share)


def interval(ci: Sequence[float] | None) -> str:
    """The 95 % interval of a share, cut at 100 %; "" where it is not known. Below 0 a gap grows."""
    if ci is None:
        return ""
    low, high = (min(end, 1.0) for end in ci)
    wide = "; more views, or more captures of each, narrow this" if high - low > WIDE else ""
    return f"{percent(low)} to {percent(high)} with 95 % confidence{wide}"


def quantities(observables: Sequence[str]) -> list[str]:
    """Words for these observables, each once."""
    return list(dict.fromkeys(GOES_WITH.get(q, q.split("_")[0]) for q in observables))
