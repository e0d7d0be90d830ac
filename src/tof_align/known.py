# SPDX-License-Identifier: Apache-2.0
"""Known bias of the sensor, removed before poses are solved: from a session, from one view, from a live view."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tof_align.chain import chain_of
from tof_align.pixels import sample
from tof_align.session import near, solve_session
from tof_align.single import align_view
from tof_core.cores import in_threads
from tof_core.errors import RefusedError
from tof_scene.render import render

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.config import AlignConfig
    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_core.capture import Posed, View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering

ROUNDS = 2
"""Solutions of the poses. Each reduces their error to some hundredths, the change of the bias per metre."""


class Bias(Protocol):
    """The stated bias of a camera, computed from the CAD at the camera's pose."""

    def __call__(
        self, views: Sequence[View], renderings: Sequence[Rendering], caster: Raycaster, start_ns: int | None = None
    ) -> list[Float]:
        """(H, W) metres of z per view; start_ns: stamp of the session's first view, if it is not among `views`."""

    def camera(self, stated: Camera) -> Camera:
        """The true camera, for the one that CameraInfo states."""


def through_known(posed: Sequence[Posed], views: Sequence[View], bias: Bias) -> tuple[Posed, ...]:
    """The poses, with the known lens where they have none of their own."""
    cameras = [p.camera or bias.camera(v.camera) for p, v in zip(posed, views, strict=True)]
    return tuple(replace(p, camera=None if c == v.camera else c) for p, v, c in zip(posed, views, cameras, strict=True))


def known_removed(views: Sequence[View], caster: Raycaster, bias: Bias, align: AlignConfig) -> list[View]:
    """The views of a session less the bias, computed at the poses of the corrected views.

    The bias is removed and not fitted, since poses would absorb a share of it. Where the corrected views fit the scene nowhere, as behind
    a large foreign object, the first poses are used: whoever solves the session next judges it.
    """
    samples = [sample(v, align.weights) for v in views]
    chain = near(samples, chain_of(samples, align.priors), caster, align)
    less = removed_at(views, [chain.pose(v) for v in range(len(views))], caster, bias)
    with suppress(RefusedError):
        for _ in range(ROUNDS):
            less = removed_at(views, [p.T_cell_camera for p in solve_session(less, caster, align).posed], caster, bias)
    return less


def known_removed_alone(view: View, caster: Raycaster, bias: Bias, T_prior: Float, cov_prior: Float, align: AlignConfig) -> View:
    """One view less the bias, computed at the pose of the corrected view; prior as for `align_view`."""
    less = view
    for _ in range(ROUNDS):
        less = removed_at([view], [align_view(less, caster, T_prior, cov_prior, align).posed.T_cell_camera], caster, bias)[0]
    return less


def removed_at(views: Sequence[View], cameras: Sequence[Float], caster: Raycaster, bias: Bias, start_ns: int | None = None) -> list[View]:
    """The views less the bias at the camera poses (4, 4)."""
    renderings = in_threads(lambda v, T: render(caster, v.camera, T), views, cameras)
    found = bias(views, renderings, caster, start_ns)
    return [replace(v, depth=(v.depth - np.nan_to_num(b)).astype(np.float32)) for v, b in zip(views, found, strict=True)]
