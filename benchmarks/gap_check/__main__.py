# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.gap_check`: record and seal, diagnose, score; each step a process of its own."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

from tof_core.cores import one_thread

FORMS = {"short": (40, "160x122"), "long": (500, "224x171"), "wide": (72, ""), "foreign": (500, "224x171")}
"""Cases and pixels of the camera: the short form is the tests', its nulls are smaller; the wide one has other cameras and parts in each, the foreign one
records a camera that shares no formula with the diagnosis."""


def main() -> int:
    """Run all steps, or one."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_check", description=__doc__)
    parser.add_argument("--form", choices=sorted(FORMS), default="short", help="how many cases, of what size")
    parser.add_argument("--count", type=int, help="how many cases, instead of a form")
    parser.add_argument("--out", type=Path, default=Path("out/gap-check"), help="folder of cases and reports; what is done is kept")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw")
    parser.add_argument("--size", help="pixels of the camera, instead of the form's")
    parser.add_argument("--views", type=int, default=20, help="views of a session of the foreign form")
    parser.add_argument("--scenes", default="", help="built-in scenes, joined by commas; all if empty")
    parser.add_argument(
        "--step",
        choices=("record", "examine", "baselines", "score", "second", "labels"),
        help="one step alone; of the foreign form, second: promises on second sessions, labels: labels without any sensor model, and with --joint",
    )
    parser.add_argument(
        "--also", type=Path, nargs="+", default=[], help="folders of other seeds, whose foreign sessions are scored in the same table"
    )
    parser.add_argument("--baselines", action="store_true", help="run least squares after ICP, and boosted trees, on the same bags")
    parser.add_argument("--write", action="store_true", help="write docs/gap_check.md")
    args = parser.parse_args()
    one_thread()  # as `toftwin gap` does it
    if args.step is None:
        for step in ("record", "examine", *(["baselines"] if args.baselines else []), "score"):
            if code := subprocess.call([sys.executable, "-m", "benchmarks.gap_check", "--step", step, *sys.argv[1:]]):
                return code
        return 0
    return {"record": _record, "examine": _examine, "baselines": _baselines, "score": _score, "second": _second, "labels": _labels}[
        args.step
    ](args)


def _record(args: argparse.Namespace) -> int:
    from benchmarks.gap_check.cases import draw, with_small_nulls
    from benchmarks.gap_check.record import record_all
    from benchmarks.gap_check.wide import draw_wide
    from tof_scene.builtin import builtin_names

    if args.form == "foreign":
        from benchmarks.gap_check.foreign.cases import draw_foreign
        from benchmarks.gap_check.foreign.record import record_foreign

        width, height = (int(x) for x in (args.size or FORMS["foreign"][1]).split("x"))
        record_foreign(draw_foreign(args.count or FORMS["foreign"][0], args.seed, args.views), args.out, (width, height))
        return 0
    if args.form == "wide":
        record_all(draw_wide(args.count or FORMS["wide"][0], args.seed), args.out, (224, 171))
        return 0

    scenes = tuple(args.scenes.split(",")) if args.scenes else tuple(builtin_names())
    cases = draw(args.count or FORMS[args.form][0], scenes, args.seed)
    width, height = (int(x) for x in (args.size or FORMS[args.form][1]).split("x"))
    record_all(with_small_nulls(cases) if args.form == "short" else cases, args.out, (width, height))
    return 0


def _examine(args: argparse.Namespace) -> int:
    from benchmarks.gap_check.examine import examine_all

    examine_all(args.out)
    return 0


def _second(args: argparse.Namespace) -> int:
    from benchmarks.gap_check.foreign.second import keep_promises, table

    print(table(keep_promises(args.out)))
    return 0


def _labels(args: argparse.Namespace) -> int:
    from benchmarks.gap_check.foreign.labels import HEAD, label_rows, line, summary

    rows = []
    print(HEAD)
    for row in label_rows(args.out):
        rows.append(row)
        print(line(row), flush=True)
    print(summary(rows))
    return 0


def _baselines(args: argparse.Namespace) -> int:
    from benchmarks.gap_check.examine import compare_all

    compare_all(args.out)
    return 0


def _score(args: argparse.Namespace) -> int:
    if args.form == "foreign":
        return _score_foreign(args)
    from benchmarks.gap_check.score import score_all
    from benchmarks.gap_check.table import page, summary

    rows = score_all(args.out)
    (args.out / "scores.json").write_text(json.dumps([asdict(r) for r in rows], indent=1))
    print(summary(rows))
    if args.write:
        drawn = f"--form {args.form}" + (f" --count {args.count}" if args.count else "") + (f" --size {args.size}" if args.size else "")
        Path("docs/gap_check.md").write_text(page(rows, f"make gap-check ARGS='{drawn} --seed {args.seed}'"))
    return 0


def _score_foreign(args: argparse.Namespace) -> int:
    from benchmarks.gap_check.foreign.score import score_foreign
    from benchmarks.gap_check.foreign.table import page, summary

    rows = score_foreign(args.out)
    (args.out / "scores.json").write_text(json.dumps([asdict(r) for r in rows], indent=1))
    print(summary([*rows, *(row for folder in args.also for row in score_foreign(folder))]))
    if args.write:
        drawn = f"--form foreign --count {len(rows)} --views {args.views}" + (f" --size {args.size}" if args.size else "")
        (args.out / "foreign.md").write_text(page(rows, f"make gap-check ARGS='{drawn} --seed {args.seed}'"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
