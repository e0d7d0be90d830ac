# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.mutate --room correction`: small faults put into deciding functions, one at a time; which do the tests find?

A mutant is one changed operator, constant, condition or call (`benchmarks.mutants`). It takes the place of its function in a forked
process, which runs a test that executes the changed statement; the first test that fails has found it. A mutant whose statement no
test executes survives. Survivors are printed with their line; so are the shares found, with an interval for a sample.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import subprocess
import sys
import time
from math import sqrt
from typing import TYPE_CHECKING

from benchmarks.mutants import REPOSITORY, Mutant, mutants, source_of
from benchmarks.mutated_rooms import ROOMS, Room
from benchmarks.mutated_tests import Asked, in_session

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.mutated_tests import Asker

Z_95 = 1.96
"""Standard deviations of a 95 % interval."""


def of_room(room: Room) -> list[Mutant]:
    """All mutants of a room."""
    return [m for module, functions in room.functions.items() for m in mutants(module, source_of(module).read_text(), functions)]


def chosen_of(name: str, every: Sequence[Mutant], most: int) -> list[Mutant]:
    """A repeatable sample of at most `most` mutants in a random order; all where it is 0."""
    order = random.Random(hashlib.sha256(name.encode()).digest())
    return order.sample(list(every), min(most or len(every), len(every)))


def mutate(name: str, most: int, seconds: float) -> tuple[int, int]:
    """Try the mutants of a room (a sample of at most `most`, ended after `seconds`); prints survivors and the share found."""
    room = ROOMS[name]
    every = of_room(room)
    chosen = chosen_of(name, every, most)
    counted = [0, 0]
    start = time.monotonic()

    def ask(asker: Asker) -> None:
        for mutant in chosen:
            if seconds and time.monotonic() - start > seconds:
                break
            answer = asker.ask(mutant)
            counted[0] += answer is Asked.FOUND
            counted[1] += 1
            if answer is not Asked.FOUND:
                why = "" if answer is Asked.SURVIVES else "no test gets there: "
                told = f"{mutant.module}:{mutant.line} {mutant.function}: {' '.join(mutant.what.split())[:110]}"
                asker.say(f"  survives: {why}{told}")

    in_session(room.tests, [source_of(module) for module in room.functions], ask)
    found, tried = counted
    sample = "" if tried == len(every) else f" (sample of {len(every)}; 95 % interval {interval(found, tried)})"
    bar = "" if 100 * found >= room.bar * tried else f"  BELOW the bar of {room.bar:.0f} %"
    took = f" in {time.monotonic() - start:.0f} s"
    print(f"{name}: {found} of {tried}{sample} mutants found, {100 * found / max(tried, 1):.1f} %{took}{bar}", flush=True)
    return found, tried


def interval(found: int, tried: int) -> str:
    """Wilson's interval of a share at 95 %, in per cent (Wilson, JASA 1927)."""
    if not tried:
        return "0 to 100"
    share, z2 = found / tried, Z_95**2 / tried
    middle, half = share + z2 / 2, Z_95 * sqrt(share * (1 - share) / tried + z2 / (4 * tried))
    return f"{100 * (middle - half) / (1 + z2):.0f} to {100 * (middle + half) / (1 + z2):.0f}"


def main() -> int:
    """Try one room, or all; exit code 1 below a bar."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.mutate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--room", choices=[*ROOMS, "all"], default="all")
    parser.add_argument("--most", type=int, default=0, help="a sample of at most so many mutants a room (default: all)")
    parser.add_argument("--seconds", type=float, default=0.0, help="end a room after so long (default: never)")
    args = parser.parse_args()
    sys.path[:0] = [str(REPOSITORY), str(REPOSITORY / "src"), str(REPOSITORY / "scripts")]
    os.chdir(REPOSITORY)
    if args.room != "all":
        return int(_below(args.room, args.most, args.seconds))
    # Each room in a process of its own: what one has loaded is not to slow the forks of the next.
    again = ["--most", str(args.most), "--seconds", str(args.seconds)]
    command = [sys.executable, "-m", "benchmarks.mutate", *again, "--room"]
    codes = [subprocess.run([*command, name], check=False).returncode for name in ROOMS]
    return int(any(codes))


def _below(name: str, most: int, seconds: float) -> bool:
    found, tried = mutate(name, most, seconds)
    return 100 * found < ROOMS[name].bar * tried


if __name__ == "__main__":
    sys.exit(main())
