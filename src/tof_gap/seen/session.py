# SPDX-License-Identifier: Apache-2.0
"""The session as effects see it, to state which forms to try and whether they can be tested."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.noise.stereo import like_stereo
from tof_sensor.frame import amplitude_gain, lambert_amplitude
from tof_sensor.session import Session, SessionView

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.scene import Scene
    from tof_sensor.effects.photon_law import PhotonLaw


def session_of(
    views: Sequence[ViewEvidence],
    noise: NoiseLimits,
    scene: Scene | None = None,
    law: PhotonLaw | None = None,
    stated_mhz: tuple[float, ...] = (),
) -> Session:
    """The properties of the views that effects may use.

    scene: for names of parts; law: the photon law as `--sensor` states it; stated_mhz: the modulation frequencies that calibration.yaml states.
    """
    return Session(
        _views(views),
        parts=() if scene is None else tuple(part.name for part in scene.parts),
        has_amplitude=any(v.view.amplitude is not None for v in views),
        modulated=not like_stereo(views, noise),
        law=law,
        noise_of_steps=any(v.noise_of_steps for v in views),
        averages=any(v.correlation.correlated for v in views),
        stated_mhz=stated_mhz,
        posed_apart=all(v.view.robot is not None and v.view.robot.cov is not None for v in views),
    )


def amplitude_unit(views: Sequence[ViewEvidence]) -> float | None:
    """Amplitude of albedo 1 at normal incidence and 1 m, in the camera's unit: median over the views; None without an amplitude image."""
    lit = ((v.view.amplitude, v.rendering) for v in views)
    gains = [amplitude_gain(seen.astype(np.float64), lambert_amplitude(r)) for seen, r in lit if seen is not None]
    known = [g for g in gains if g is not None]
    return float(np.median(known)) if known else None


def _views(views: Sequence[ViewEvidence]) -> tuple[SessionView, ...]:
    return tuple(SessionView(v.frame, v.pixels) for v in views)
