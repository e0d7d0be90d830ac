# SPDX-License-Identifier: Apache-2.0
"""Physical causes of error: which quantity of the device each changes, and which effect of the vocabulary that means."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from benchmarks.emerging.device import Device
from tof_core.config import flatten, table, updated
from tof_core.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping

OUTSIDE = "outside"
"""What a cause means that no effect of the vocabulary describes."""


@dataclass(frozen=True, slots=True)
class Cause:
    """One cause.

    `effect`: the vocabulary's name for what it does, or `outside <what it is>`. `knob`: the device's quantity that it changes, from
    the healthy value by the cause's size; `beside`: further quantities, per unit of size. `start`: a size of about strength 1;
    `limit`: beyond it the cause is not physical. `metric`: what its strength is measured in: `bias` (3 mm RMS over affected
    pixels), `noise` (3 mm RMS of additional noise), `loss` (a tenth of the pixels), `wrap` (a tenth of the pixels wrapped or lost), or `size`
    (`start` times the strength: what a millimetre does not measure, or the calibration prior must be exceeded by). `settings`: what comes with it, at any size; `moving`: the hand moves during captures.
    """

    effect: str
    knob: str
    start: float
    limit: float
    text: str
    beside: Mapping[str, float] = field(default_factory=dict)
    metric: str = "bias"
    local: bool = False
    """Whether the affected pixels are few."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    moving: bool = False
    falling: bool = False
    """The quantity is divided by 1 + size instead of raised by it."""

    @property
    def kind(self) -> str:
        """What its true map holds: `bias` or `noise` in metres, or `loss`."""
        return self.metric if self.metric in ("noise", "loss") else "bias"

    @property
    def noisy(self) -> bool:
        """Whether it shows in noisy captures alone."""
        return self.metric in ("noise", "loss", "wrap") or self.knob in ("firmware.step_mm", "pixel.telegraph_e")


FILTER_OFF = {"firmware.filter": False}
CAUSES: dict[str, Cause] = {
    "slow_driver": Cause("wiggling", "lamp.rise_ns", 1.5, 3, "the driver's rising edge is slower than at the factory"),
    "long_pulse": Cause("wiggling", "lamp.duty", 0.05, 0.35, "the driver is on for longer than half of the period"),
    "charge_traps": Cause("amplitude_bias", "pixel.trap_ke", 1.2, 20, "traps hold charge back: dark pixels measure later"),
    "cold_start": Cause("temperature_drift", "thermal.warmup_ahead", 0.4, 4, "the camera was switched on shortly before the session"),
    "clock_columns": Cause(
        "fixed_pattern", "pixel.column_ps", 15, 500, "the clock tree's delays have aged", {"pixel.row_ps": 0.5, "pixel.pixel_ps": 0.5}
    ),
    "flood_light": Cause("multipath", "lamp.flood_share", 0.3, 1, "the dot projector is out of focus: indirect light counts", local=True),
    "hazy_lens": Cause("lens_scatter", "optics.stray_share", 0.02, 0.5, "scattering in the lens spreads light over the image", local=True),
    "glossy_part": Cause("specular", "world.gloss", 0.05, 0.6, "a part has a glossy coat: it shines, and mirrors other parts", local=True),
    "translucent_part": Cause("subsurface", "world.translucent_mm", 6, 300, "light wanders within one part", local=True),
    "filter_off": Cause(
        "flying_pixels",
        "optics.defocus_px",
        0.5,
        3,
        "the flying-pixel filter is off, and the lens out of focus",
        metric="size",
        local=True,
        settings=FILTER_OFF,
    ),
    # A fixed size: by millimetres at the edges, microseconds between sub-frames and 15 ms were both of strength 1.
    "slow_readout": Cause(
        "motion", "clock.subframe_ms", 4, 30, "the hand moves between the sub-frames", metric="size", local=True, moving=True
    ),
    "driver_latency": Cause(
        "time_sync", "firmware.latency_ms", 30, 500, "stamps are late by the driver's latency", metric="size", moving=True
    ),
    "wrong_lens": Cause(
        "intrinsics",
        "optics.centre_x_px",
        2.4,
        50,
        "the lens is not the one that CameraInfo states",
        {"optics.focal_pct": 0.25, "optics.centre_y_px": -0.6, "optics.k1": -0.01},
        metric="size",
    ),
    "bumped_mount": Cause(
        "hand_eye",
        "mount.hand_eye_mm",
        5,
        80,
        "the mount was bumped after hand-eye calibration",
        {"mount.hand_eye_deg": 0.1},
        metric="size",
    ),
    "moved_parts": Cause("cad_deviation", "world.moved_mm", 5, 100, "three parts stand off their CAD", local=True),
    "bent_part": Cause("cad_deviation", "world.bent_mm", 8, 150, "one part is bent", local=True),
    "late_pulse": Cause("range_offset", "lamp.delay_ps", 20, 500, "the pulse is later than at the factory"),
    "wrong_pll": Cause("depth_scale", "clock.pll_ppm", 4000, 1e5, "the modulation is faster than its nominal frequency"),
    "radial_output": Cause(
        "radial_depth", "world.texture", 0.0, 1, "distances along the ray are published", metric="size", settings={"firmware.radial": True}
    ),
    "coarse_output": Cause("quantization", "firmware.step_mm", 10.4, 200, "depth is written in coarse steps", metric="size"),
    "noisy_rows": Cause("noise", "pixel.row_noise_e", 100, 1e4, "the supply's hum reaches the rows", metric="noise"),
    "telegraph_pixels": Cause("noise", "pixel.telegraph_e", 1000, 1e5, "a few pixels jump between two levels", metric="size"),
    "sunlight": Cause("ambient", "world.ambient_ke", 80, 1000, "ambient light brings photon noise", metric="noise"),
    "neighbour_camera": Cause("interference", "world.neighbour", 0.05, 10, "another camera of the same type lights the scene"),
    "strict_threshold": Cause("dropout", "firmware.min_amplitude_e", 1500, 1e5, "the confidence threshold is too high", metric="loss"),
    "short_second_exposure": Cause(
        "phase_wrap", "clock.weight2", 15, 300, "the second frequency is hardly exposed: unwrapping errs", metric="wrap", falling=True
    ),
    "lamp_aside": Cause(
        "emitter_offset", "lamp.offset_x_mm", 15, 150, "the lamp is not where the firmware has it", {"lamp.offset_y_mm": 0.4}
    ),
    "cover_glass": Cause(f"{OUTSIDE} cover glass", "optics.cover_share", 0.01, 2, "the cover glass reflects lamp light onto the sensor"),
    "ghost": Cause(f"{OUTSIDE} ghost image", "optics.ghost_share", 0.02, 0.5, "the lens mirrors the image through its centre", local=True),
    "glass_pane": Cause(f"{OUTSIDE} glass pane", "world.pane_mm", 6, 400, "half of the scene lies behind a pane of glass", local=True),
}


def applied(healthy: Device, sizes: Mapping[str, float]) -> Device:
    """The device with some causes at a size each."""
    values = flatten(healthy)
    bounds = {row.name: row for row in table(Device)}
    for name, size in sizes.items():
        if name not in CAUSES:
            raise ConfigError(f"there is no cause '{name}'", where="causes", todo=f"known: {', '.join(sorted(CAUSES))}")
        cause = CAUSES[name]
        if cause.falling:
            values[cause.knob] /= 1 + size
        else:
            for path, factor in {cause.knob: 1.0, **cause.beside}.items():
                row = bounds[path]
                low, high = (-float("inf") if row.low is None else row.low), (float("inf") if row.high is None else row.high)
                values[path] = min(max(values[path] + factor * size, low), high)
        values.update(cause.settings)
    return updated(healthy, values, where="device")
