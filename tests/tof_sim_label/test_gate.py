# SPDX-License-Identifier: Apache-2.0
"""Radial depth declared as z is refused with its cause; z passes, and so does depth without evidence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.radial import z_to_radial
from tests.tof_sim_label.made import view
from tof_core.camera import Camera
from tof_core.errors import RefusedError
from tof_sim_label import gate as gates
from tof_sim_label.gate import SURE, TRIES, RadialGate

if TYPE_CHECKING:
    from tof_core.arrays import Image

CAMERA = Camera(width=160, height=120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)


def plane() -> Image:
    """z-depth (H, W) of a tilted plane near 1 m with 1 mm noise."""
    rays = CAMERA.rays()
    z = 1.0 / (rays @ np.array([0.2, -0.1, 1.0]))
    return np.asarray(z + np.random.default_rng(0).normal(scale=1e-3, size=z.shape), np.float32)


def test_a_plane_as_z_passes_and_as_distance_along_the_ray_is_refused() -> None:
    blank = view(0, camera=CAMERA)
    RadialGate().check(replace(blank, depth=plane()))
    with pytest.raises(RefusedError, match=r"a plane bends: the depth looks radial.*pass --depth radial"):
        RadialGate().check(replace(blank, depth=z_to_radial(CAMERA, plane())))


def test_the_check_ends_where_nothing_is_flat() -> None:
    gate, blank = RadialGate(), view(0, camera=CAMERA)
    nothing = replace(blank, depth=np.full(CAMERA.shape, np.nan, np.float32))
    for _ in range(TRIES):
        gate.check(nothing)
    gate.check(replace(blank, depth=z_to_radial(CAMERA, plane())))


def test_once_z_is_certain_the_check_ends() -> None:
    gate, blank = RadialGate(), view(0, camera=CAMERA)
    gate.check(replace(blank, depth=plane()))
    gate.check(replace(blank, depth=z_to_radial(CAMERA, plane())))


def told(monkeypatch: pytest.MonkeyPatch, suspicion: float, *, wide: bool | None = None) -> RadialGate:
    """A gate to which every view tells the same: suspicion by curvature, 7 mm; whether a wide plane bends as radial, 0.012 m, or None."""
    bend = None if wide is None else SimpleNamespace(radial=wide, metres=0.012)
    monkeypatch.setattr(gates, "radial_evidence", lambda *_: SimpleNamespace(suspicion=suspicion, bend_z_mm=7.0))
    monkeypatch.setattr(gates, "wide_bend", lambda *_: bend)
    return RadialGate()


@pytest.mark.parametrize(
    ("suspicion", "wide", "bend_mm"),
    [(0.995, None, 7), (0.995, False, 7), (0.5, True, 12), (0.98, True, 12), (0.02, True, 12), (SURE, True, 12), (1 - SURE, True, 12)],
)
def test_curvature_decides_where_it_is_sure_and_a_wide_plane_where_it_is_not(
    monkeypatch: pytest.MonkeyPatch, suspicion: float, *, wide: bool | None, bend_mm: int
) -> None:
    with pytest.raises(RefusedError, match=rf"a flat surface is off by {bend_mm} mm"):
        told(monkeypatch, suspicion, wide=wide).check(view(0, camera=CAMERA))


@pytest.mark.parametrize(
    ("suspicion", "wide", "ends"),
    [(0.005, None, 1), (0.005, True, 1), (SURE, None, 5), (0.5, False, 1), (0.5, None, 5), (0.98, None, 5), (1 - SURE, None, 5)],
)
def test_the_check_ends_after_an_answer_or_five_views_without_one(
    monkeypatch: pytest.MonkeyPatch, suspicion: float, *, wide: bool | None, ends: int
) -> None:
    """A view that is radial beyond doubt is refused until then, and passes from there on."""
    for views in (ends - 1, ends):
        gate = told(monkeypatch, suspicion, wide=wide)
        for _ in range(views):
            gate.check(view(0, camera=CAMERA))
        told(monkeypatch, 1.0)
        if views < ends:
            with pytest.raises(RefusedError):
                gate.check(view(0, camera=CAMERA))
        else:
            gate.check(view(0, camera=CAMERA))
