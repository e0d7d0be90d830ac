# SPDX-License-Identifier: Apache-2.0
"""A camera whose errors are its own: the same before every scene. The network that the package carries was trained on it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from tof_virtual.effects import make_effects

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_virtual.session import Session

SIZES = {
    "flying_pixels": 1.0,
    "multipath": 0.2915838873857877,
    "wiggling": 0.021573622825323015,
    "amplitude_bias": 0.010035793294703239,
    "noise": 0.003,
}
"""Errors of the camera, in each effect's own unit: 3 mm RMS each (a strength of 1) in one session of the first random scene.

Fixed here, for the default model was trained on this camera and no other.
"""
CAMERA_SEED = 2
"""A camera whose noise is the same everywhere; other seeds draw bursts or rows."""

SWEEP = {"plan.views": 11, "plan.stations": 1, "plan.sweep_deg": 20.0, "plan.range_min_m": 0.7, "plan.range_max_m": 0.9}
"""The paper's figure 9: 0 to 20 degrees in steps of 2."""


@dataclass(frozen=True)
class TwinCamera:
    """A camera whose errors are the same in every session: signs and phases by `seed`, sizes by effect."""

    seed: int = CAMERA_SEED
    sizes: Mapping[str, float] = field(default_factory=lambda: dict(SIZES))

    def mount(self, session: Session) -> None:
        """Give the session this camera's errors."""
        effects = make_effects(dict.fromkeys(self.sizes, 1.0), replace(session.config, seed=self.seed))
        for effect in effects:
            effect.config = session.config  # what is drawn anew each capture is the session's own
            effect.size = self.sizes[effect.name]
            effect.prepare(session)
        session.effects = effects
