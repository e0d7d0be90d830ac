# SPDX-License-Identifier: Apache-2.0
"""Run the benches and print their figures: every module benchmarks/bench_*.py has `run() -> list[Figure]`."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks import table
from benchmarks.figure import Figure
from tof_core.cores import one_thread

if TYPE_CHECKING:
    from collections.abc import Iterable

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parent / "docs" / "figures.md"
EXAMPLE = "example: python -m benchmarks --only footprints --write"


def names(*, long: bool) -> list[str]:
    """Benches to run: those whose module says LONG = True belong to `--long` alone."""
    found = sorted(path.stem.removeprefix("bench_") for path in FOLDER.glob("bench_*.py"))
    return [name for name in found if is_long(name) == long]


def is_long(name: str) -> bool:
    """Whether a bench declares itself long; read from the text, since importing may be heavy."""
    return "\nLONG = True" in (FOLDER / f"bench_{name}.py").read_text(encoding="utf-8")


def measure(name: str) -> list[Figure]:
    """The figures of one bench; one that fails is a figure that is missed, and the others still run."""
    command = f"python -m benchmarks --only {name}"
    try:
        figures: list[Figure] = importlib.import_module(f"benchmarks.bench_{name}").run()
    except Exception as error:  # noqa: BLE001  (whatever broke, the table must say so and go on)
        figures = [
            Figure(f"{name} did not finish", float("nan"), "", "finishes", met=False, remark=f"{type(error).__name__}: {error}"[:200])
        ]
    return [figure if figure.command else replace(figure, command=command) for figure in figures]


def where() -> str:
    """Date, processor count and interpreter, for the page."""
    cores = len(os.sched_getaffinity(0))
    return f"{datetime.now(tz=UTC):%Y-%m-%d} on {cores} cores ({platform.machine()}), Python {platform.python_version()}"


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__, epilog=EXAMPLE)
    parser.add_argument("--only", action="append", metavar="NAME", help="run this bench, or several with commas between; may be repeated")
    parser.add_argument("--list", action="store_true", help="name the benches and stop")
    parser.add_argument("--long", action="store_true", help="run the long benches in place of the short ones")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument("--write", action="store_true", help="renew these rows of docs/figures.md")
    return parser.parse_args(arguments)


def run(chosen: Iterable[str], *, quiet: bool) -> dict[str, list[Figure]]:
    """Measure one bench after the other, saying which and for how long."""
    results: dict[str, list[Figure]] = {}
    chosen = list(chosen)
    for number, name in enumerate(chosen, 1):
        started = time.monotonic()
        print(f"[{number}/{len(chosen)}] {name} ...", file=sys.stderr, flush=True)
        results[name] = measure(name)
        print(f"[{number}/{len(chosen)}] {name}: {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
        if not quiet:
            print("\n".join(table.line(figure) for figure in results[name]), flush=True)
    return results


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 when every bar that ran is met, 1 when one is missed, 2 when the call was wrong."""
    options = parse(arguments)
    options.only = [name for names_ in options.only or [] for name in names_.split(",")]
    known = names(long=False) + names(long=True)
    if options.list:
        print("\n".join(known))
        return 0
    if unknown := [name for name in options.only or [] if name not in known]:
        print(f"benchmarks: no bench named {', '.join(unknown)}; there are {', '.join(known) or 'none'}", file=sys.stderr)
        return 2
    one_thread()  # As the commands and nodes do, before a bench imports NumPy: its threads wait for each other on small matrices.
    results = run(options.only or names(long=options.long), quiet=options.json)
    figures = [figure for found in results.values() for figure in found]
    if options.json:
        print(json.dumps({"where": where(), "figures": [figure.to_dict() for figure in figures]}, indent=1))
    if options.write:
        table.write_page(PAGE, dict(results), where())
    missed = sum(figure.met is False for figure in figures)
    print(f"{len(figures)} figures, {missed} missed their bar", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
