# SPDX-License-Identifier: Apache-2.0
"""How far a sensor model that was fitted to another session shrinks this session's gap, beside the shrink that it promised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_gap.tell.figures.shrink import blocks, measure
from tof_gap.tell.report.phrases import interval, percent
from tof_sensor.effect import Evidence
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_gap.tell.figures.shrink import Shrink
    from tof_sensor.model import SensorModel
    from tof_sensor.origin import Promise

GROWS = "as other errors act here: do not simulate this session with it"
"""What a gap that grows by a sensor model means."""


@dataclass(frozen=True, slots=True)
class Kept:
    """promised: shrink stated in the model's file, None without one; here: the gap of this session without and with the model.

    removed: names of its effects that have a bias here; removed_mm: RMS of that bias over the smooth pixels of held-out views.
    """

    promised: Promise | None
    here: Shrink
    removed: tuple[str, ...]
    removed_mm: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values for `gap.json`."""
        p, g = self.promised, self.here
        return {
            "promised": None if p is None else {"shrink": p.shrink, "ci95": [p.low, p.high]},
            "kept": {"shrink": g.shrink, "ci95": None if g.ci95 is None else list(g.ci95)},
            "removed": list(self.removed),
            "removed_mm": self.removed_mm,
            "without_mm": g.above_mm(g.before),
            "with_mm": g.above_mm(g.after),
        }

    def line(self) -> str:
        """What was removed, and promised and measured shrink, in a line each."""
        p, g = self.promised, self.here
        promised = "nothing" if p is None else f"{percent(p.shrink)}, {interval((p.low, p.high))}"
        kept = "nothing to shrink here" if g.shrink is None else ", ".join(filter(None, [percent(g.shrink), interval(g.ci95)]))
        removed = f"removed by --sensor, so not in the verdict: {', '.join(self.removed)} ({self.removed_mm:.1f} mm RMS)"
        shrink = (
            f"shrink by --sensor: promised {promised}; kept {kept}; "
            f"{g.above_mm(g.before):.2f} mm without the model, {g.above_mm(g.after):.2f} mm with it"
        )
        shrink += f"; the gap grows by it, {GROWS}" if g.shrink is not None and g.shrink < 0.0 else ""
        return f"{removed}\n{shrink}" if self.removed else shrink


def kept(d: Diagnosis, known: SensorModel | None) -> Kept | None:
    """The gap of a session without and with the model `known`, which was fitted to another session.

    It is measured as the promise was: on held-out views, above the noise that their pixels show. `d` is the diagnosis of the views
    corrected by the model, and gives the poses. None without a model, or if it promises nothing and has no bias here, as a data sheet's
    noise and threshold have none.
    """
    if known is None:
        return None
    figures, report = d.account.figures, d.config.report
    known = known.holding_in(d.solved.caster.scene.digest)
    after = [d.residual[v] for v in figures.held]
    bias = [known.bias(d.evidence[v].frame) for v in figures.held]
    if known.promise is None and not any(np.nan_to_num(b).any() for b in bias):
        return None
    before = [r + added for r, added in zip(after, bias, strict=True)]
    here = measure(blocks(before, after, figures.floors_shown, report.block_px), figures.rng, report.shrink)
    removed = tuple(name for name in known.names if EFFECTS[name].EVIDENCE is Evidence.BIAS)
    seen = np.concatenate([b[np.isfinite(r)] for b, r in zip(bias, after, strict=True)])
    return Kept(known.promise, here, removed, 1e3 * float(np.sqrt(np.mean(seen**2))) if len(seen) else 0.0)
