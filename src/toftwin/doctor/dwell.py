# SPDX-License-Identifier: Apache-2.0
"""Whether the first capture of each stop shows what the later ones show: a driver that filters over time carries the last view into it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from toftwin.doctor.finding import note

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.capture import Capture
    from toftwin.doctor.finding import Finding

CHECK = "dwell"
LEAST_CAPTURES = 4
"""Captures of a stop from which the first one is compared with the others."""
FARTHEST_M = 0.05
"""Difference beyond which a pixel is left out, metres: an edge that noise moves, or a wrapped phase."""
RATIO = 2.0
"""RMS difference of the first capture from the later ones over that of the last one from those between: by noise alone it is 1."""
LEAST_M = 1e-3
"""Least such RMS difference beyond noise, metres: less changes no label."""
SHARE = 0.5
"""Share of the stops: in fewer, something moved."""


class Ends(NamedTuple):
    """Metres RMS by which the first and the last capture of a stop differ from the mean of those between."""

    first: float
    last: float

    @property
    def beyond(self) -> float:
        """Metres RMS of the first capture's difference beyond noise."""
        return float(np.sqrt(max(self.first**2 - self.last**2, 0.0)))

    @property
    def off(self) -> bool:
        """Whether the first capture shows something else than the later ones."""
        return self.first > RATIO * self.last and self.beyond > LEAST_M


def ends_of(captures: Sequence[Capture]) -> Ends | None:
    """How the ends of a stop differ from the middle; None with fewer than `LEAST_CAPTURES` captures, or no pixel in all of them."""
    if len(captures) < LEAST_CAPTURES:
        return None
    middle = np.mean([c.depth for c in captures[1:-1]], axis=0)
    differences = [(captures[end].depth - middle) for end in (0, -1)]
    near = np.all([np.abs(d) < FARTHEST_M for d in differences], axis=0)
    return Ends(*(float(np.sqrt(np.mean(d[near] ** 2))) for d in differences)) if near.any() else None


def examine_dwells(stops: Sequence[Ends | None]) -> Iterator[Finding]:
    """A note where the first captures of most stops differ from the later ones."""
    known = [s for s in stops if s is not None]
    off = [s for s in known if s.off]
    if off and len(off) >= SHARE * len(known):
        beyond = 1e3 * float(np.median([s.beyond for s in off]))
        yield note(
            CHECK,
            f"at {len(off)} of {len(known)} stops the first capture is off by {beyond:.1f} mm RMS from the later ones",
            "switch off the driver's temporal filter, which carries the last view into the next, or start recording later after each stop",
        )
