# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.limits`: each number halved and doubled on recorded sessions; goes on where it stopped."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.filtered import FILTERS
from benchmarks.gap_check.record import BAGS
from benchmarks.limits import results
from benchmarks.limits.names import FACTORS, SECTIONS, numbers, value_at
from benchmarks.limits.sessions import PLAN, SIZE, VIEWS, load, record, record_surprise
from benchmarks.limits.trial import Trials

if TYPE_CHECKING:
    from benchmarks.limits.sessions import Session
    from tof_core.config import ParamInfo

PAGE = Path(__file__).resolve().parent.parent / "limits.json"
"""What docs/limits.md is made of, by scripts/make_docs.py."""


def main() -> int:
    """Try the numbers and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.limits", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/limits"), help="folder of sessions and results; what is done is kept")
    parser.add_argument("--bags", type=Path, help="folder of a gap check (its bags/), instead of sessions of its own")
    parser.add_argument("--sessions", type=int, default=len(PLAN), help="how many sessions, the most telling first")
    parser.add_argument("--size", default=f"{SIZE[0]}x{SIZE[1]}", help="pixels of the sessions that are recorded; a folder has one size")
    parser.add_argument("--views", type=int, default=VIEWS, help="views of each of them")
    parser.add_argument(
        "--surprise", type=int, action="append", default=[], metavar="N", help="only this session of benchmarks.surprises, such as 7"
    )
    parser.add_argument("--filter", default="", choices=("", *FILTERS), help="denoising filter that the depth images pass first")
    parser.add_argument("--missing", action="store_true", help="only numbers without a row in benchmarks/limits.json")
    parser.add_argument("--session", action="append", default=[], metavar="NAME", help="this session; may be repeated")
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="numbers whose name begins so, such as gap.noise; may be repeated"
    )
    parser.add_argument("--table", action="store_true", help="print what was measured and stop")
    parser.add_argument(
        "--write", action="store_true", help="renew the measured rows of benchmarks/limits.json, which docs/limits.md is made of"
    )
    args = parser.parse_args()
    log = args.out / "trials.jsonl"
    if not args.table:
        args.out.mkdir(parents=True, exist_ok=True)
        width, height = (int(x) for x in args.size.split("x"))
        args.session += [record_surprise(args.out, number, (width, height), args.views) for number in args.surprise]
        if args.bags is None and not args.surprise:
            record(args.out, args.sessions, (width, height), args.views)
        folder, wanted = args.bags or args.out, _wanted(args.only, missing=args.missing)
        names = args.session or sorted(p.name for p in (folder / BAGS).iterdir())[: args.sessions]
        for name in names:
            _try(folder, name, args.filter, wanted, log)
    rows = results.rows(results.read(log))
    print("\n".join(results.text(row) for row in rows))
    if args.write:
        rows = results.renewed(json.loads(PAGE.read_text())["rows"], rows)
        PAGE.write_text(json.dumps({"measured": f"{time.strftime('%Y-%m-%d')}", "rows": rows}, indent=1) + "\n")
    return 0


def _wanted(only: list[str], *, missing: bool) -> set[str]:
    """Names of the numbers to try: all, those whose names begin as asked, or those that the page lacks."""
    done = {row["name"] for row in json.loads(PAGE.read_text())["rows"]} if missing else set()
    names = {f"{of}.{info.name}" for of in SECTIONS for info in numbers(of)} - done
    return {name for name in names if not only or name.startswith(tuple(only))}


def _try(folder: Path, recorded: str, firmware: str, wanted: set[str], log: Path) -> None:
    """The wanted numbers on one session."""
    session = f"{recorded}, {firmware}" if firmware else recorded
    code, done = _code(), {results.key(line) for line in results.read(log)}
    todo = [
        (of, info, factor)
        for of in SECTIONS
        for info in numbers(of)
        for factor in FACTORS
        if f"{of}.{info.name}" in wanted and (code, session, f"{of}.{info.name}", factor) not in done
    ]
    if not todo:
        return
    loaded: Session = load(folder, recorded, firmware)
    trials = Trials(loaded)
    trials.run_default()
    of_what = {"code": code, "session": session, "size": loaded.size}
    # Numbers that act late first: the earlier stages are not computed again.
    todo.sort(key=lambda t: -trials.reused(t[0], t[1].name))
    with log.open("a") as out:
        for of, info, factor in todo:
            line = of_what | {"name": f"{of}.{info.name}", "factor": factor} | _line(trials, of, info, factor)
            out.write(json.dumps(line) + "\n")
            out.flush()
            if line["read"]:
                print(
                    f"{session} {line['name']} x {factor:g}: {line.get('verdict', '')} {line.get('points', line.get('mm'))}",
                    file=sys.stderr,
                    flush=True,
                )


def _line(trials: Trials, of: str, info: ParamInfo, factor: float) -> dict[str, Any]:
    """One trial; a number that the session does not read changes nothing."""
    value, is_read = value_at(info, factor), trials.is_read(of, info.name)
    if value is None or not is_read:
        return {"value": value, "read": is_read}
    return {"value": value, "read": True} | trials.outcome(of, trials.run(of, info.name, value))


def _code() -> str:
    """The commit that is measured."""
    return subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
