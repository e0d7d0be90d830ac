# SPDX-License-Identifier: Apache-2.0
"""Configuration of the virtual robot: camera, errors, plan of a session, output."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """The AMCW camera."""

    width: int = param(224, "columns", unit="px", low=8, high=2000)
    height: int = param(171, "rows", unit="px", low=8, high=2000)
    fov_deg: float = param(55.9, "horizontal field of view", unit="deg", low=5, high=120)
    modulation_mhz: float = param(100.0, "modulation frequency of the fine phase", unit="MHz", low=1, high=500)
    signal_ke: float = param(
        90.0, "signal electrons a tap collects from albedo 0.5 at 0.8 m, seen straight on", unit="1000 e-", low=0.1, high=1e4
    )
    ambient_ke: float = param(60.0, "ambient electrons a tap collects from albedo 0.5", unit="1000 e-", low=0, high=1e4)
    contrast: float = param(0.8, "demodulation contrast", low=0.05, high=1)
    read_noise_e: float = param(60.0, "read noise of a tap", unit="e-", low=0, high=1e4)
    full_well_ke: float = param(1500.0, "charge at which a tap saturates", unit="1000 e-", low=1, high=1e5)
    adc_bits: int = param(12, "resolution of the converter", unit="bit", low=6, high=24)
    min_amplitude_e: float = param(700.0, "amplitude below which a pixel is reported invalid", unit="e-", low=0, high=1e6)
    subsamples: int = param(6, "rays along each side of a pixel that sees an edge", low=1, high=16)


@dataclass(frozen=True, slots=True)
class RobotConfig:
    """Errors of the robot's own pose."""

    base_min_mm: float = param(20.0, "least position error of the base, in the plane", unit="mm", low=0, high=500)
    base_max_mm: float = param(50.0, "largest position error of the base, in the plane", unit="mm", low=0, high=500)
    base_deg: float = param(2.0, "largest yaw error of the base", unit="deg", low=0, high=20)
    base_tilt_deg: float = param(0.2, "standard deviation of its roll and pitch error", unit="deg", low=0, high=5)
    base_height_mm: float = param(3.0, "standard deviation of its height error", unit="mm", low=0, high=100)
    arm_mm: float = param(1.0, "arm error, RMS length", unit="mm", low=0, high=50)
    arm_deg: float = param(0.1, "arm error, RMS angle", unit="deg", low=0, high=5)
    repeat_mm: float = param(0.25, "share of the arm error that does not repeat", unit="mm", low=0, high=50)
    repeat_deg: float = param(0.025, "share of the arm's angle error that does not repeat", unit="deg", low=0, high=5)


@dataclass(frozen=True, slots=True)
class PlanConfig:
    """Plan of a session: where the robot stands, where it looks, and when."""

    views: int = param(12, "views of the session", low=1, high=10000)
    stations: int = param(2, "stations among which the views are divided", low=1, high=1000)
    captures: int = param(1, "captures of each view", low=1, high=100000)
    range_min_m: float = param(0.45, "least range along the axis", unit="m", low=0.1, high=10)
    range_max_m: float = param(1.3, "largest range along the axis", unit="m", low=0.1, high=10)
    azimuth_deg: float = param(50.0, "largest azimuth to either side", unit="deg", low=0, high=180)
    elevation_min_deg: float = param(-10.0, "lowest elevation of the camera above the target", unit="deg", low=-89, high=89)
    elevation_max_deg: float = param(50.0, "highest elevation of the camera above the target", unit="deg", low=-89, high=89)
    sweep_deg: float = param(
        0.0,
        "the paper's sweep: azimuth from 0 to this in equal steps around one point, from one station; 0 varies everything",
        unit="deg",
        low=0,
        high=180,
    )
    roll_deg: float = param(15.0, "largest roll about the axis", unit="deg", low=0, high=180)
    facing_deg: float = param(0.0, "azimuth of the robot's side, from the cell's x", unit="deg", low=-180, high=180)
    target: str = param("", "target of the views as 'x,y,z' in the cell; empty: the centre of the subjects")
    spread: float = param(0.6, "largest aiming offset from the target, as a share of the subjects' size", low=0, high=1)
    rate_hz: float = param(15.0, "captures a second", unit="Hz", low=0.1, high=1000)
    tf_rate_hz: float = param(50.0, "transforms a second", unit="Hz", low=1, high=1000)
    move_s: float = param(1.2, "time of a move between views", unit="s", low=0.1, high=60)
    pause_s: float = param(0.0, "pause after each view, without TF", unit="s", low=0, high=3600)
    capture_moving: bool = param(False, "capture while the hand moves")
    speed_m_s: float = param(0.15, "speed of the hand when it captures in motion", unit="m/s", low=0, high=5)
    turn_deg_s: float = param(8.0, "turn rate of the hand when it captures in motion", unit="deg/s", low=0, high=180)


@dataclass(frozen=True, slots=True)
class WarmupConfig:
    """The camera's temperature after it was switched on."""

    start_c: float = param(26.0, "temperature at the start", unit="degC", low=-40, high=120)
    end_c: float = param(44.0, "temperature it settles at", unit="degC", low=-40, high=120)
    tau_s: float = param(300.0, "time constant", unit="s", low=1, high=1e5)


@dataclass(frozen=True, slots=True)
class OutputConfig:
    """Published topics and their names (spot_ros2's by default)."""

    namespace: str = param("", "robot namespace: prefix of topics and of all frames but the cell")
    cell_frame: str = param("cell", "root of the TF tree")
    encoding: str = param("16UC1", "depth as 16UC1 millimetres or 32FC1 metres", choices=("16UC1", "32FC1"))
    amplitude: bool = param(True, "publish the amplitude image")
    colour: bool = param(False, "publish one colour image a view")
    points: bool = param(False, "also publish the depth as a PointCloud2")
    temperature: bool = param(True, "publish the temperature once a second")
    storage: str = param("mcap", "bag storage", choices=("mcap", "sqlite3"))
    start_s: int = param(1_760_000_000, "stamp at which the session begins", unit="s", low=0)


@dataclass(frozen=True, slots=True)
class VirtualConfig:
    """A whole session of the virtual robot; equal configuration and effects give equal bags."""

    camera: CameraConfig = section(CameraConfig, "the camera")
    robot: RobotConfig = section(RobotConfig, "the robot's errors")
    plan: PlanConfig = section(PlanConfig, "the session")
    warmup: WarmupConfig = section(WarmupConfig, "temperature")
    output: OutputConfig = section(OutputConfig, "topics and frames")
    seed: int = param(0, "seed of all random numbers", low=0)
    day: int = param(0, "day on which the plan is driven: the same plan and camera, other errors of the robot, light and noise", low=0)
