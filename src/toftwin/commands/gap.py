# SPDX-License-Identifier: Apache-2.0
"""`toftwin gap`: where measured and simulated depth differ, which effects explain it, how far the difference shrinks."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from tof_gap.compare.comparison import Against
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import SensorModel
    from toftwin.diagnosis import GapPipelineConfig
    from toftwin.retraining import Retrained

NAME = "gap"
HELP = "find why measured and simulated depth differ, and how far they agree once the causes are simulated"
ABOUT = (
    "Estimates the camera poses, renders the CAD from there, and compares the measured depth with it. The report says where "
    "the two differ, which effects of the camera explain the difference, and how much of it disappears once these effects "
    "are simulated, on views that took no part in the fit. sensor.yaml holds the fitted effects, for simulation and "
    "training. calibration.yaml beside scene.yaml states how good the calibration of hand-eye and lens is (docs/calibration.md): "
    "without it, both are assumed to be exact."
)
EXAMPLE = "toftwin gap session/bag --scene cell/scene.yaml --out out/gap"

EFFECTS = (
    "ambient, amplitude_bias, cad_deviation, depth_scale, dropout, emitter_offset, fixed_pattern, flying_pixels, hand_eye, interference, intrinsics, lens_scatter, motion, "
    "multipath, noise, phase_wrap, quantization, radial_depth, range_offset, specular, subsurface, temperature_drift, time_sync, wiggling, z_conversion"
)
"""Names of `tof_sensor.registry.VOCABULARY`; copied, since its import takes half a second and help must be fast."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, add_config_arguments, add_scene_arguments

    parser.add_argument("bag", metavar="BAG", help="folder of the bag, or its .mcap or .db3 file; with --board also a folder of PNG pairs")
    add_scene_arguments(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for gap.json, report.html, gap_maps.npz and sensor.yaml"
    )
    parser.add_argument(
        "--sensor",
        type=Path,
        metavar="FILE",
        help="sensor.yaml of this camera: its effects are removed first and the rest is diagnosed; prints promised and kept shrink",
    )
    parser.add_argument(
        "--against",
        metavar="SIMULATED",
        help="bag of a simulator, of the same scene from any poses; diagnosed too, and compared effect by effect (writes against.json)",
    )
    parser.add_argument(
        "--leave-out",
        action="append",
        default=[],
        metavar="EFFECT",
        help=f"do not consider this effect; what it would explain is then unknown. May be repeated. Effects: {EFFECTS} (docs/effects.md)",
    )
    parser.add_argument(
        "--retrain",
        action="store_true",
        help="train a network on simulated views with the fitted effects and one without, and compare both on the held-out views (minutes)",
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.diagnosis:GapPipelineConfig")


@dataclass(slots=True)
class _Progress:
    """Progress on standard error."""

    quiet: bool
    steps: list[str] = field(default_factory=list)

    def __call__(self, step: str) -> None:
        import sys

        self.steps.append(step)
        if not self.quiet:
            print(f"gap: {step}", file=sys.stderr)


def run(args: argparse.Namespace) -> int:
    """Diagnose a bag and write the report."""
    import json
    from dataclasses import asdict

    from tof_gap.advice import advise
    from tof_gap.tell.report.files import write
    from tof_gap.tell.report.kept import kept
    from tof_gap.tell.report.page import write_page
    from tof_gap.tell.report.summary import summary
    from tof_sensor.model import load_model
    from tof_sensor.registry import left_out
    from toftwin.boarded import BoardSource, save_lens
    from toftwin.diagnosis import GapPipelineConfig, diagnose_bag
    from toftwin.inputs import source
    from toftwin.options import load_config
    from toftwin.paths import session_name

    config = load_config(GapPipelineConfig, args)
    forbidden = left_out(args.leave_out, "--leave-out")
    known = load_model(args.sensor) if args.sensor else None
    say = _Progress(args.json or args.quiet)
    opened = source(args.bag, config, scene=args.scene, board=args.board, calibrate=args.calibrate, initial_pose=args.initial_pose)
    with opened as (reader, scene):
        diagnosis, caster = diagnose_bag(reader, scene, config, known=known, left_out=forbidden, progress=say)
    if args.calibrate and isinstance(reader, BoardSource):
        save_lens(reader.session, args.out)
    compared = _compared(args, config, diagnosis, caster, known, forbidden, say) if args.against else None
    say("advice and report")
    again = kept(diagnosis, known)
    content = write(diagnosis, caster, args.out, advise(diagnosis, caster), again)
    if compared is not None:
        content["against"] = compared.to_dict() | {"lines": compared.lines(), "head": compared.head(), "foot": compared.foot()}
    page = write_page(diagnosis, content, args.out, session_name(args.bag), caster.scene.names)
    learned = _retrained(diagnosis, caster, args.out, config, say) if args.retrain else None
    if args.json:
        print(json.dumps(content | ({} if learned is None else {"retrain": asdict(learned)}), indent=1))
    else:
        lines = [
            *(f"capture: {line}" for line in content["advice"]),
            *([] if again is None else [again.line()]),
            *([] if compared is None else compared.lines()),
            *([] if learned is None else [worth(learned)]),
        ]
        print("\n".join([*summary(diagnosis), *(w["sentence"] for w in content["words"]), *lines, f"report: {page}"]))
    return 0


def _compared(
    args: argparse.Namespace,
    config: GapPipelineConfig,
    real: Diagnosis,
    caster: Raycaster,
    known: SensorModel | None,
    left_out: frozenset[str],
    say: Callable[[str], None],
) -> Against:
    """Diagnose the simulator's bag in the same scene, compare, and write against.json."""
    import json

    from tof_gap.compare.against import against
    from toftwin.against import diagnose_simulated

    say("the simulator's bag")
    simulated = diagnose_simulated(args.against, caster, real.camera, config, known=known, left_out=left_out, progress=say)
    compared = against(real, simulated, caster.scene.names, config.against, known, left_out)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "against.json").write_text(json.dumps(compared.to_dict(), indent=1, allow_nan=False))
    return compared


def _retrained(diagnosis: Diagnosis, caster: Raycaster, out: Path, config: GapPipelineConfig, say: Callable[[str], None]) -> Retrained:
    """Train two networks, with and without the fitted effects, and validate both on the session."""
    from tof_gap.tell.report.files import sensor_model
    from toftwin.retraining import retrain

    return retrain(diagnosis, sensor_model(diagnosis), caster, out / "retrain", config.retrain, say)


def worth(r: Retrained) -> str:
    """Result of the retraining in one line."""
    return (
        f"learned repair of the held-out views: {r.raw_mm:.2f} mm raw, {r.without_mm:.2f} trained without {', '.join(r.effects)}, "
        f"{r.with_mm:.2f} trained with ({r.pixels:,} pixels)"
    )
