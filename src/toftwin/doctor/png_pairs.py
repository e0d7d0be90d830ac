# SPDX-License-Identifier: Apache-2.0
"""Checks of a folder of PNG pairs: the images, the camera, the depth, and light that is too much for depth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.board.spec import USUAL_VIEWS
from tof_core.errors import ToftwinError
from tof_core.image_folder import AMPLITUDE, CAMERA, read_image_folder
from tof_core.shares import in_percent
from tof_gap.limits.report import ReportLimits
from toftwin.doctor.camera import CHECK, described, plausible
from toftwin.doctor.finding import fix, note, ok, refused
from toftwin.doctor.frames import codes, distances, radial

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from tof_core.camera import Camera
    from tof_core.capture import Capture
    from tof_core.options import BagOptions
    from toftwin.doctor.finding import Finding

CUT_OFF = (255.0, 65535.0)
"""Amplitudes at which 8-bit and 16-bit images are cut off."""


def examine_png_pairs(folder: Path, options: BagOptions) -> Iterator[Finding]:
    """Check what `--board` needs of a folder of PNG pairs."""
    try:
        captures = read_image_folder(folder, depth_scale=options.depth_scale)
    except ToftwinError as error:
        yield refused("PNG pairs", error)
        return
    yield _pairs(captures)
    yield from _camera(captures[0].camera)
    yield codes(np.stack([c.reason for c in captures]))
    yield from distances(np.stack([c.depth for c in captures]), options)
    yield from over_exposed(captures)
    if options.depth == "z":
        yield radial([c.depth for c in captures], captures[0].camera)


def _pairs(captures: Sequence[Capture]) -> Finding:
    lit = sum(c.amplitude is not None for c in captures)
    what = f"{len(captures)} depth images, {lit} with an amplitude image"
    if not lit:
        return fix("PNG pairs", what, f"write the camera's infrared image beside each as {AMPLITUDE}NAME.png: the board is found in it")
    if lit < USUAL_VIEWS:
        return note("PNG pairs", what, f"{USUAL_VIEWS} and more, at several distances and tilts, determine more; read them with --board")
    return ok("PNG pairs", f"{what}; read them with --board")


def _camera(camera: Camera) -> Iterator[Finding]:
    yield ok(CHECK, f"{CAMERA}: {described(camera)}")
    yield from plausible(camera)


def over_exposed(captures: Sequence[Capture]) -> Iterator[Finding]:
    """A finding where many pixels have no depth at an amplitude at which images are cut off."""
    lit = [(c.amplitude, np.isfinite(c.depth)) for c in captures if c.amplitude is not None]
    share = float(np.mean([(np.isin(a, CUT_OFF) & ~valid).mean() for a, valid in lit])) if lit else 0.0
    if share >= ReportLimits().over_exposed:
        what = f"{in_percent(share)} of the pixels have no depth, with an amplitude that is cut off: too much light"
        yield note("exposure", what, "shorten the exposure, or stand farther away; white paper near the camera returns most")
