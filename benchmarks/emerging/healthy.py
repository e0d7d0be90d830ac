# SPDX-License-Identifier: Apache-2.0
"""Healthy cameras as real ones are: calibrated well but not perfectly, within limits that are stated beside the bag."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from benchmarks.emerging.device import Device
from tof_core.config import from_mapping

if TYPE_CHECKING:
    from pathlib import Path

HAND_EYE_MM, HAND_EYE_DEG, LENS_PX, ALBEDO = 2.0, 0.2, 0.3, 0.4
"""Largest errors of a healthy camera's calibration, and of the stated albedo (relative): the stated prior."""
FOREIGN_SHARE = 0.2
"""Share of healthy sessions in which something stands that the CAD lacks."""
WINDOWS_PX = (1, 1, 3, 5)
"""Windows over which firmware averages depth: half of the cameras do not."""
FLOOD_SHARE = 0.3
"""Share of cameras whose dot projector leaves a little flood light."""
PAIRS = ((100.0, 80.0, 0.0), (90.0, 70.0, 0.0), (120.0, 90.0, 0.0), (80.0, 60.0, 0.0), (100.0, 80.0, 60.0))
"""Modulation frequencies in MHz of published cameras."""


def draw(rng: np.random.Generator, serial: int) -> Device:
    """A healthy camera of random make in a world of random light."""
    f1, f2, f3 = PAIRS[int(rng.integers(len(PAIRS)))]
    centre = rng.uniform(-1, 1, 2) * LENS_PX / np.sqrt(2)
    values: dict[str, Any] = {
        "serial": serial,
        "clock.f1_mhz": f1,
        "clock.f2_mhz": f2,
        "clock.f3_mhz": f3,
        "lamp.rise_ns": rng.uniform(0.3, 0.8),
        "lamp.fall_ns": rng.uniform(0.3, 0.8),
        "lamp.baseline_mm": rng.uniform(8, 30),
        "lamp.jitter_ps": rng.uniform(30, 120),
        "lamp.tempco_ps_K": rng.uniform(3, 5),
        "lamp.flood_share": rng.uniform(0, 0.02) * (rng.random() < FLOOD_SHARE),
        "pixel.gate_ns": rng.uniform(0.4, 0.9),
        "pixel.leak": rng.uniform(0.03, 0.12),
        "pixel.trap_ke": rng.uniform(0, 0.05),
        "pixel.trap_ns": rng.uniform(3, 15),
        "pixel.column_ps": rng.uniform(0, 0.5),
        "optics.centre_x_px": centre[0],
        "optics.centre_y_px": centre[1],
        "optics.focal_pct": rng.uniform(-1, 1) * 0.1,
        "optics.stray_share": rng.uniform(0, 5e-4),
        "thermal.ambient_c": rng.uniform(18, 30),
        "thermal.thermometer_s": rng.uniform(60, 300),
        "thermal.warmup_ahead": rng.uniform(0, 0.02),
        "firmware.captures": int(rng.integers(1, 3)),
        "firmware.step_mm": float(rng.choice([0.25, 1.0])),
        "factory.nodes": int(rng.integers(72, 120)),
        "factory.pixel_noise_ps": rng.uniform(0.3, 1),
        "mount.hand_eye_mm": rng.uniform(0, HAND_EYE_MM),
        "mount.hand_eye_deg": rng.uniform(0, HAND_EYE_DEG),
        "world.signal_ke": rng.uniform(25, 60),
        "world.ambient_ke": rng.uniform(2, 12),
        "world.albedo_off": ALBEDO,
        "world.texture": rng.uniform(0, 0.15),
        "world.foreign_m": rng.uniform(0.08, 0.2) * (rng.random() < FOREIGN_SHARE),
        "firmware.denoise_px": int(rng.choice(WINDOWS_PX)),
    }
    return from_mapping(Device, {k: float(v) if isinstance(v, np.floating) else v for k, v in values.items()})


def write_prior(path: Path) -> None:
    """The calibration prior as YAML: how far a healthy camera of this make may be off."""
    prior = {
        "hand_eye": {"translation_mm": HAND_EYE_MM, "rotation_deg": HAND_EYE_DEG},
        "lens": {"principal_point_px": LENS_PX, "focal_pct": 0.1},
        "albedo": {"relative": ALBEDO},
    }
    path.write_text(
        "# Largest errors of the calibration of a healthy camera of this make, and of the scene's infrared albedo.\n"
        + yaml.safe_dump(prior)
    )
