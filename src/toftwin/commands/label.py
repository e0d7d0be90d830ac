# SPDX-License-Identifier: Apache-2.0
"""`toftwin label`: a bag and its CAD to a dataset in which each pixel has its true depth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from tof_core.errors import UsageError
from tof_core.shares import in_percent

if TYPE_CHECKING:
    import argparse

    from tof_sim_label.config import LabelConfig
    from toftwin.known import Known
    from toftwin.label_call import Outcome
    from toftwin.labelling import LabelResult
    from toftwin.pipeline import PipelineConfig

NAME = "label"
HELP = "write a dataset with the true depth of each pixel, from a bag and its CAD"
ABOUT = (
    "Averages and filters the captures, estimates where the camera was, and renders the CAD from there. The rendered depth "
    "is the label: what each pixel should have measured. The dataset holds captures, labels and their standard deviations. "
    "Several bags make a batch. A run that was interrupted continues where it stopped. "
    "State how far hand-eye may be off in align.priors.hand_eye_mm (docs/calibration.md)."
)
EXAMPLE = "toftwin label session/bag --scene cell/scene.yaml --out out/session\n  toftwin label 'bags/*.mcap' --scene cell/scene.yaml --out out/bags"


EXPLAINED = {
    "missing: ": "  (missing: its pixels are no labels. Put the part back, or take it out of scene.yaml, and label again)",
    "parts disagree": (
        "  (parts disagree: a part is off its CAD by this much relative to the others, or the camera has an error there, for instance by light "
        "from its neighbours (multipath). toftwin gap tells which; move no part before it is measured. With --joint, labels show such a part "
        "where it stands)"
    ),
}
"""Meaning of words in verdicts, and remedies."""
TABLE = "  (raw: single captures with their noise; filtered: means of dwells. alignment: mean of 100 % minus the relative error)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, add_config_arguments, add_scene_arguments, add_sensor, at_least

    parser.add_argument(
        "bag", nargs="+", metavar="BAG", help="folder of the bag, or its .mcap or .db3 file; several, or a quoted pattern, make a batch"
    )
    add_scene_arguments(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for dataset.zarr, poses.json, metrics.json, config.yaml"
    )
    parser.add_argument(
        "--mode",
        choices=("final", "causal", "per_view", "robot"),
        help=(
            "source of the camera poses, in place of the setting align.mode. final: one solution of the whole session (align.mode: session), for training; causal: each from the views before it, "
            "as live; per_view: each view on its own, as in the paper; robot: TF, or the corners of --board, alone (default: final; with --board robot)"
        ),
    )
    add_sensor(parser, "poses are solved")
    parser.add_argument(
        "--joint",
        action="store_true",
        help="diagnose the session (as toftwin gap), solve the poses together with the effects found, and show displaced parts where they stand; mode final, needs a minute or more",
    )
    parser.add_argument(
        "--engine", choices=("local", "ray"), help="where a batch runs: in processes of this host, or on a Ray cluster (default: local)"
    )
    parser.add_argument(
        "--workers", type=at_least(1), default=0, metavar="N", help="worker processes of a batch, one core each (default: number of cores)"
    )
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.pipeline:PipelineConfig")


def run(args: argparse.Namespace) -> int:
    """Label one bag or a batch, and print the figures; 1 if a bag of a batch failed."""
    from toftwin.batch import is_batch
    from toftwin.known import Known
    from toftwin.label_call import LabelCall
    from toftwin.options import load_config
    from toftwin.pipeline import PipelineConfig

    config = load_config(PipelineConfig, args)
    mode = args.mode or ("final" if args.board is None else "robot")
    known = Known(args.sensor, args.joint)
    known.check(mode)
    if is_batch(args.bag, args.engine):
        return _batch(args, config, known)
    result = LabelCall(
        args.bag[0], args.scene, args.out, config, mode, args.initial_pose or "", args.board or "", calibrate=args.calibrate, known=known
    ).run()
    if args.json:
        print(json.dumps(result.to_dict(), indent=1))
    else:
        _print(result)
        if args.sensor is None and not args.joint:
            print(in_common(1e3 * result.filtered.error.bias, config.label.unseen_offset_mm), end="")
        if mode == "final" and result.label_sigma_mm is not None:
            print(unsure(result.label_sigma_mm, config.label, joint=args.joint), end="")
    return 0


def _batch(args: argparse.Namespace, config: PipelineConfig, known: Known) -> int:
    from dataclasses import asdict

    from toftwin.batch import REPORT, label_bags
    from toftwin.label_call import FAILED, KEPT

    if args.scene is None:
        what = "a batch is of one scene" if args.board else "no scene is given"
        raise UsageError(what, where="label", todo="pass --scene FILE, or label each bag of a board in a call of its own")

    def show(outcome: Outcome) -> None:
        if not args.json:
            print(outcome.line(), flush=True)

    outcomes = label_bags(
        args.bag,
        args.scene,
        args.out,
        config,
        mode=args.mode or "final",
        initial_pose=args.initial_pose or "",
        known=known,
        engine=args.engine or "local",
        workers=args.workers,
        each=show,
    )
    failed, kept = (sum(o.state == state for o in outcomes) for state in (FAILED, KEPT))
    if args.json:
        print(json.dumps([asdict(o) for o in outcomes], indent=1))
    else:
        print(f"{len(outcomes)} bags: {len(outcomes) - failed} labelled ({kept} of them before), {failed} failed; {args.out / REPORT}")
    return int(failed > 0)


def _print(result: LabelResult) -> None:
    from tof_eval.tables import depth_table
    from tof_scene.world.words import lines

    if result.note:
        print(result.note)
    skipped = "; skipped: " + ", ".join(f"{reason} {count}" for reason, count in result.skipped.items()) if result.skipped else ""
    print(f"{result.captures} captures, {result.views} views in {result.dataset}{skipped}")
    print("verdicts: " + ", ".join(f"{verdict} {count}" for verdict, count in result.verdicts.most_common()))
    for mark, meaning in EXPLAINED.items():
        if any(mark in verdict for verdict in result.verdicts):
            print(meaning)
    print(depth_table(result.rows))
    print(TABLE)
    print(_usable(result))
    print("\n".join(lines(result.world)), end="\n" if any(result.world.values()) else "")


def in_common(bias_mm: float, offset_mm: float) -> str:
    """A line if the mean difference of depth and label exceeds the label's stated standard deviation (95 %); otherwise "".

    Args:
        bias_mm: mean of filtered depth minus label.
        offset_mm: standard deviation of a constant offset, which is part of the label's sigma.
    """
    if not abs(bias_mm) > 2.0 * offset_mm:
        return ""
    way = "farther" if bias_mm > 0 else "nearer"
    return (
        f"the camera measures {abs(bias_mm):.1f} mm {way} than the labels in the mean of all pixels. Up to {2.0 * offset_mm:.1f} mm is usual (it is part of the labels' sigma); more "
        "comes from the camera's range, its lens or multipath, and may have moved the labels, too. Diagnose the session (toftwin gap BAG --scene FILE --out DIR), then label "
        "it with --sensor DIR/sensor.yaml, or with --joint\n"
    )


def unsure(sigma_mm: float, config: LabelConfig, *, joint: bool) -> str:
    """A line if the labels' standard deviation is `open_mm` or more; otherwise "".

    Unmodelled depth errors increase the labels' sigma. They may have moved the poses, which no comparison with depth shows.

    Args:
        sigma_mm: standard deviation of a label, median of the session.
        config: standard deviation of an unseen offset, and `open_mm`.
        joint: whether the poses were solved together with the effects of the diagnosis.
    """
    own_mm = max(sigma_mm**2 - config.unseen_offset_mm**2, 0.0) ** 0.5
    if own_mm < config.open_mm:
        return ""
    todo = (
        "the remaining error is no effect that the diagnosis finds: add views from other sides, or see toftwin gap"
        if joint
        else "label again with --joint, which removes the effects found from the depth before the poses are solved (toftwin gap names them)"
    )
    return (
        f"the labels are accurate to {sigma_mm:.1f} mm only (one standard deviation, median): the views do not determine the poses well, or the depth has errors common to neighbouring "
        f"pixels, such as light between surfaces (multipath), which may have moved the poses. To do: {todo}\n"
    )


def _usable(result: LabelResult) -> str:
    """Share of the pixels that are usable for training, and reasons for the others."""
    total = max(result.reasons.total(), 1)
    shares = [f"{name} {in_percent(count / total, 1)}" for name, count in result.reasons.most_common() if name != "usable"]
    return f"labels usable in {in_percent(result.reasons['usable'] / total, 1)} of all pixels; the others: {', '.join(shares) or 'none'}"
