# SPDX-License-Identifier: Apache-2.0
"""The session as the effects see it: what they may ask when they say which forms to try, or whether they can be tested."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.seen.stereo import like_stereo
from tof_sensor.session import Session, SessionView

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.limits.seen import NoiseLimits
    from tof_gap.seen.residual import ViewEvidence
    from tof_scene.scene import Scene
    from tof_sensor.effects.photon_law import PhotonLaw


def session_of(views: Sequence[ViewEvidence], noise: NoiseLimits, scene: Scene | None = None, law: PhotonLaw | None = None) -> Session:
    """What effects may ask about views; `scene` names the parts, `law` is the camera's photon law as `--sensor` states it."""
    return Session(
        _views(views),
        parts=() if scene is None else tuple(part.name for part in scene.parts),
        has_amplitude=any(v.view.amplitude is not None for v in views),
        modulated=not like_stereo(views, noise),
        law=law,
        posed_apart=all(v.view.robot is not None and v.view.robot.cov is not None for v in views),
    )


def _views(views: Sequence[ViewEvidence]) -> tuple[SessionView, ...]:
    return tuple(SessionView(v.frame, v.pixels) for v in views)
