# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.second_opinion FOLDER`: a second judge on the evidence of every session that `benchmarks.gap_check` recorded and examined.

FOLDER is what `--out` named there. Opinions are formed from the bags alone and kept under `reports/`; then the answers are opened.
Needs numpyro (`pip install toftwin[rivals]`).
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

from benchmarks.gap_check.examine import REPORTS, diagnosed
from benchmarks.gap_check.record import BAGS, SEALED
from benchmarks.second_opinion.listen import listening
from benchmarks.second_opinion.opinion import Opinion, opinion_of
from benchmarks.second_opinion.score import Session, table
from tof_core.cores import one_thread
from tof_core.progress import progress

KEPT = "second_opinion.json"


def main() -> int:
    """Form the opinions that are missing, then score all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.second_opinion", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of cases and reports of a gap check")
    folder = parser.parse_args().folder
    if find_spec("numpyro") is None:
        print("no second opinion: numpyro is not installed (pip install toftwin[rivals])")
        return 0
    one_thread()
    cases = sorted(c for c in (folder / REPORTS).iterdir() if (c / "gap.json").exists())
    for report in progress(cases, "second opinions", len(cases)):
        if not (report / KEPT).exists():
            _judge(folder / BAGS / report.name, report / KEPT)
    print(table([s for report in cases if (s := _scored(folder, report)) is not None]))
    return 0


def _judge(case: Path, out: Path) -> None:
    """The opinion on one session, null where the diagnosis had no hypotheses to choose from."""
    with listening() as heard:
        diagnosed(case)
    out.write_text(json.dumps(asdict(opinion_of(heard[-1])) if heard else None))


def _scored(folder: Path, report: Path) -> Session | None:
    """A session with its answer opened."""
    found = json.loads((report / KEPT).read_text())
    if found is None:
        return None
    tuples = {k: tuple(found[k]) for k in ("asked", "exceeds", "chosen")}
    answer = json.loads((folder / SEALED / report.name / "case.json").read_text())
    return Session.of(answer, json.loads((report / "gap.json").read_text()), Opinion(**found | tuples))


if __name__ == "__main__":
    sys.exit(main())
