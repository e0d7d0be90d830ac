# SPDX-License-Identifier: Apache-2.0
"""Every physical quantity of the camera, its mount and its surroundings: one number per cause, with unit and bounds."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class Lamp:
    """Laser, its driver, and where it sits."""

    rise_ns: float = param(0.5, "time constant of the driver's rising edge", unit="ns", low=0, high=20)
    fall_ns: float = param(0.6, "time constant of the driver's falling edge", unit="ns", low=0, high=20)
    duty: float = param(0.5, "share of the modulation period in which the driver is on", low=0.1, high=0.9)
    jitter_ps: float = param(60.0, "standard deviation of the pulse's timing", unit="ps", low=0, high=5000)
    delay_ps: float = param(0.0, "delay of the pulse since the factory calibration", unit="ps", low=-5000, high=5000)
    baseline_mm: float = param(
        15.0, "place of the lamp beside the lens, along image x, that the firmware knows of", unit="mm", low=0, high=200
    )
    offset_x_mm: float = param(0.0, "place of the lamp off its nominal one, along image x", unit="mm", low=-300, high=300)
    offset_y_mm: float = param(0.0, "place of the lamp off its nominal one, along image y", unit="mm", low=-300, high=300)
    tempco_ps_K: float = param(4.0, "delay of the pulse per kelvin of the lamp", unit="ps/K", low=-100, high=100)
    power_tempco: float = param(-0.003, "change of the emitted power per kelvin of the lamp", unit="1/K", low=-0.02, high=0.02)
    flood_share: float = param(
        0.0, "light not projected as dots: of flood light the indirect part is measured too; dots separate it", low=0, high=1
    )


@dataclass(frozen=True, slots=True)
class Pixel:
    """The two-tap pixel, its clock tree and its converter."""

    gate_ns: float = param(0.6, "time constant of the gate's edges", unit="ns", low=0, high=20)
    leak: float = param(0.06, "share of the charge that the closed gate lets into the other tap", low=0, high=0.49)
    trap_ke: float = param(0.0, "electrons of a pixel that charge traps hold back, however bright it is", unit="1000 e-", low=0, high=100)
    trap_ns: float = param(8.0, "time constant with which trapped charge is released", unit="ns", low=0.01, high=1000)
    column_ps: float = param(0.0, "clock delay from column to column since calibration, standard deviation", unit="ps", low=0, high=1000)
    row_ps: float = param(0.0, "clock delay from row to row since calibration, standard deviation", unit="ps", low=0, high=1000)
    pixel_ps: float = param(0.0, "gate delay from pixel to pixel since calibration, standard deviation", unit="ps", low=0, high=1000)
    clock_ps: float = param(
        250.0, "clock delay across the array as built, from the driver's side to the far one", unit="ps", low=0, high=5000
    )
    mismatch: float = param(0.02, "gain difference of the two taps, standard deviation over pixels", low=0, high=0.3)
    pedestal_e: float = param(300.0, "dark offset of a tap, standard deviation over taps", unit="e-", low=0, high=5000)
    dark_e: float = param(
        20.0, "dark current's electrons of a tap and sub-frame at the calibration temperature", unit="e-", low=0, high=1e5
    )
    read_e: float = param(15.0, "read noise of a tap", unit="e-", low=0, high=1e4)
    row_noise_e: float = param(0.0, "noise that all taps of a row's read-out share", unit="e-", low=0, high=1e5)
    telegraph_e: float = param(0.0, "jump of a telegraph pixel between two levels", unit="e-", low=0, high=1e6)
    telegraph_share: float = param(0.02, "share of pixels that have telegraph noise", low=0, high=1)
    full_well_ke: float = param(250.0, "charge at which a tap saturates", unit="1000 e-", low=1, high=1e5)
    adc_bits: int = param(14, "resolution of the converter", unit="bit", low=6, high=24)
    tempco_ps_K: float = param(1.5, "delay of the gates per kelvin of the sensor", unit="ps/K", low=-100, high=100)


@dataclass(frozen=True, slots=True)
class Optics:
    """The lens as it is; CameraInfo states it without these."""

    focal_pct: float = param(0.0, "focal length beyond the stated one", unit="%", low=-20, high=20)
    centre_x_px: float = param(0.0, "principal point beyond the stated one, x", unit="px", low=-100, high=100)
    centre_y_px: float = param(0.0, "principal point beyond the stated one, y", unit="px", low=-100, high=100)
    k1: float = param(0.0, "first radial coefficient beyond the stated one", low=-0.5, high=0.5)
    defocus_px: float = param(0.0, "blur that widens a pixel's footprint", unit="px", low=0, high=10)
    stray_share: float = param(0.0, "share of all light that scattering in the lens spreads over the image", low=0, high=0.9)
    stray_px: float = param(30.0, "width of that spread", unit="px", low=1, high=500)
    cover_share: float = param(
        0.0, "lamp light that the cover glass reflects onto the sensor, over the light of albedo 0.5 at 0.8 m", low=0, high=10
    )
    cover_mm: float = param(40.0, "path of that light from lamp to sensor", unit="mm", low=0, high=1000)
    ghost_share: float = param(0.0, "share of the light that returns as a ghost, mirrored through the image's centre", low=0, high=0.5)


@dataclass(frozen=True, slots=True)
class Clock:
    """Modulation frequencies and the order of the sub-frames."""

    f1_mhz: float = param(100.0, "first modulation frequency", unit="MHz", low=1, high=500)
    f2_mhz: float = param(80.0, "second modulation frequency", unit="MHz", low=1, high=500)
    f3_mhz: float = param(0.0, "third modulation frequency; 0 for none", unit="MHz", low=0, high=500)
    weight2: float = param(1.0, "exposure at the second and third frequency over that at the first", low=0.001, high=10)
    pll_ppm: float = param(0.0, "true modulation frequency beyond the nominal one", unit="ppm", low=-1e5, high=1e5)
    subframe_ms: float = param(0.0, "time from one sub-frame to the next; 0: all at once", unit="ms", low=0, high=100)


@dataclass(frozen=True, slots=True)
class Thermal:
    """Heat: what is warm when, and when the session begins."""

    ambient_c: float = param(24.0, "air", unit="degC", low=-30, high=60)
    lamp_K: float = param(32.0, "lamp above housing in steady state", unit="K", low=0, high=100)
    sensor_K: float = param(14.0, "sensor above housing in steady state", unit="K", low=0, high=100)
    housing_K: float = param(12.0, "housing above air in steady state", unit="K", low=0, high=100)
    lamp_s: float = param(60.0, "time constant of the lamp", unit="s", low=1, high=1e5)
    sensor_s: float = param(150.0, "time constant of the sensor", unit="s", low=1, high=1e5)
    housing_s: float = param(700.0, "time constant of the housing", unit="s", low=1, high=1e5)
    thermometer_s: float = param(150.0, "lag of the thermometer behind the housing", unit="s", low=0.1, high=1e5)
    warmup_ahead: float = param(
        0.0, "warm-up still ahead at the session's start: 0 steady, 1 just switched on, more: stored colder than the air", low=0, high=4
    )


@dataclass(frozen=True, slots=True)
class Firmware:
    """What the camera makes of its taps."""

    filter: bool = param(True, "drop pixels between two surfaces (flying pixels)")
    denoise_px: int = param(1, "window over which distances of one surface are averaged, 1 for none", unit="px", low=1, high=15)
    min_amplitude_e: float = param(150.0, "amplitude below which a pixel is invalid", unit="e-", low=0, high=1e6)
    captures: int = param(1, "internal captures that are averaged; a pixel must be valid in each", low=1, high=8)
    agree_mm: float = param(100.0, "largest difference of internal captures of a valid pixel", unit="mm", low=1, high=1e5)
    range_m: float = param(5.0, "largest distance that unwrapping considers", unit="m", low=0.5, high=50)
    step_mm: float = param(1.0, "step of the depth output", unit="mm", low=0.01, high=200)
    radial: bool = param(False, "write the distance along the ray instead of z")
    latency_ms: float = param(0.0, "latency of the driver: stamps are late by it", unit="ms", low=-1000, high=1000)


@dataclass(frozen=True, slots=True)
class Factory:
    """The factory calibration: what it removes, and how well."""

    nodes: int = param(1440, "nodes of the cyclic correction over one period", low=4, high=10000)
    pixel_noise_ps: float = param(0.0, "noise of the calibrated delay of each pixel", unit="ps", low=0, high=100)
    target_ke: float = param(40.0, "brightness of the calibration target", unit="1000 e-", low=0.1, high=1e4)


@dataclass(frozen=True, slots=True)
class Mount:
    """The camera on its hand."""

    hand_eye_mm: float = param(0.0, "place on the hand beyond the stated one", unit="mm", low=0, high=500)
    hand_eye_deg: float = param(0.0, "attitude on the hand beyond the stated one", unit="deg", low=0, high=45)


@dataclass(frozen=True, slots=True)
class World:
    """Light and surfaces as they are."""

    signal_ke: float = param(40.0, "electrons of a pixel and sub-frame from albedo 0.5 at 0.8 m", unit="1000 e-", low=0.01, high=1e4)
    ambient_ke: float = param(8.0, "the same of ambient light from albedo 0.5", unit="1000 e-", low=0, high=1e5)
    albedo_off: float = param(0.0, "largest relative error of the stated infrared albedo of a part", low=0, high=0.9)
    texture: float = param(0.0, "relative texture of the infrared albedo", low=0, high=0.9)
    gloss: float = param(0.0, "mirror-like reflectance of one part", low=0, high=1)
    gloss_rough: float = param(0.15, "roughness of the glossy coat", low=0.03, high=1)
    translucent_mm: float = param(0.0, "mean way of light within one translucent part", unit="mm", low=0, high=1000)
    moved_mm: float = param(0.0, "distance by which parts stand off their CAD", unit="mm", low=0, high=300)
    moved_parts: int = param(3, "how many parts do", low=1, high=100)
    bent_mm: float = param(0.0, "sagitta by which one part is bent", unit="mm", low=0, high=300)
    foreign_m: float = param(0.0, "edge of a box that stands in the cell and not in the CAD; 0: none", unit="m", low=0, high=2)
    missing: bool = param(False, "one part of the CAD is not there")
    arm_share: float = param(0.0, "share of the views into which a person's arm reaches, each time elsewhere", low=0, high=1)
    pane_mm: float = param(0.0, "thickness of a glass pane between camera and half of the scene", unit="mm", low=0, high=500)
    neighbour: float = param(0.0, "power of another camera's lamp on the scene over the own one", low=0, high=100)


@dataclass(frozen=True, slots=True)
class Device:
    """Camera, mount and world. The defaults are the perfect camera: calibration removes all, nothing has aged."""

    lamp: Lamp = section(Lamp, "laser, driver, place")
    pixel: Pixel = section(Pixel, "pixel, clock tree, converter")
    optics: Optics = section(Optics, "lens")
    clock: Clock = section(Clock, "modulation")
    thermal: Thermal = section(Thermal, "heat")
    firmware: Firmware = section(Firmware, "firmware")
    factory: Factory = section(Factory, "factory calibration")
    mount: Mount = section(Mount, "mount")
    world: World = section(World, "light and surfaces")
    serial: int = param(0, "serial number: seed of whatever is individual about this camera", low=0)

    @property
    def frequencies(self) -> tuple[float, ...]:
        """Nominal modulation frequencies in hertz."""
        c = self.clock
        return tuple(1e6 * f for f in (c.f1_mhz, c.f2_mhz, c.f3_mhz) if f > 0)
