# SPDX-License-Identifier: Apache-2.0
"""Labelling many bags: which ones, where each goes, what is done already, and what came of all of them."""

from __future__ import annotations

import argparse
import glob
import json
import os
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.errors import UsageError
from tof_core.progress import progress, set_quiet

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

REPORT = "batch.json"
DONE, KEPT, FAILED = "done", "kept", "failed"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one bag: `done` now, `kept` from an earlier call, or `failed` with the line that says why."""

    bag: str
    out: str
    state: str
    error: str = ""
    seconds: float = 0.0
    megabytes: float = 0.0
    result: dict[str, Any] = field(default_factory=dict)

    def line(self) -> str:
        """The outcome as one line of text."""
        if self.state == FAILED:
            return f"failed  {self.bag}: {self.error}"
        views = self.result.get("views", 0)
        return f"{self.state:<6}  {self.bag}: {views} views" + (f" in {self.seconds:.1f} s" if self.state == DONE else "")


def is_batch(args: argparse.Namespace) -> bool:
    """Whether a call names several bags, a pattern, or an engine; a file that has a pattern's name is one bag."""
    return bool(args.engine) or len(args.bag) > 1 or (_is_pattern(args.bag[0]) and not Path(args.bag[0]).exists())


def label_batch(args: argparse.Namespace) -> int:
    """Label every bag into a folder of its own under `--out`; 1 if one failed, after all others were tried."""
    from toftwin.batch_engines import ENGINES
    from toftwin.commands.label import hashes

    calls, wanted = _calls(args, find_bags(args.bag)), hashes(args)
    kept = [outcome for call in calls if (outcome := _kept(call, wanted)) is not None]
    before = {outcome.bag for outcome in kept}
    left = [call for call in calls if call.bag not in before]
    args.out.mkdir(parents=True, exist_ok=True)
    outcomes = list(kept)
    for outcome in progress(ENGINES[args.engine or "local"](left, args.workers), "bags", len(left)):
        outcomes.append(outcome)
        _save(args.out / REPORT, outcomes)
        if not args.json:
            print(outcome.line(), flush=True)
    _save(args.out / REPORT, outcomes)
    failed = sum(o.state == FAILED for o in outcomes)
    if args.json:
        print(json.dumps([asdict(o) for o in outcomes], indent=1))
    else:
        print(f"{len(outcomes)} bags: {len(outcomes) - failed} labelled ({len(kept)} of them before), {failed} failed; {args.out / REPORT}")
    return int(failed > 0)


def find_bags(named: Sequence[str]) -> list[str]:
    """The bags that names and patterns mean, each once, in order.

    Raises:
        UsageError: a pattern fits nothing, or two bags would be written to one folder.
    """
    found: dict[str, None] = {}
    for name in named:
        fits = [name] if Path(name).exists() or not _is_pattern(name) else sorted(glob.glob(name, recursive=True))  # noqa: PTH207 (absolute patterns too)
        if not fits:
            raise UsageError("no bag fits this pattern", where=name, todo="quote it, and look at it with ls")
        found.update(dict.fromkeys(fits))
    names = [_name(bag) for bag in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise UsageError(f"two bags are called '{twice[0]}'", where="--out", todo="label them in two calls, each with its own --out")
    return list(found)


def label_one(call: argparse.Namespace) -> Outcome:
    """Label one bag in this process; whatever goes wrong is the outcome's one line."""
    from toftwin.cli import explain
    from toftwin.commands.label import label

    set_quiet()
    start = time.monotonic()
    try:
        result = label(call)
    except Exception as error:  # noqa: BLE001 (one bag's fault must not end the others)
        return Outcome(call.bag, str(call.out), FAILED, explain(error)[0], time.monotonic() - start)
    return Outcome(call.bag, str(call.out), DONE, "", time.monotonic() - start, _megabytes(result.dataset), result.to_dict())


def _calls(args: argparse.Namespace, bags: Iterable[str]) -> list[argparse.Namespace]:
    """The same call for each bag, with a folder of its own."""
    return [argparse.Namespace(**{**vars(args), "bag": bag, "out": args.out / _name(bag)}) for bag in bags]


def _kept(call: argparse.Namespace, wanted: tuple[str, str, str]) -> Outcome | None:
    """What an earlier call finished with the same scene, configuration and way of posing, from a bag that is no younger."""
    from tof_core.errors import DatasetError
    from tof_sim_label.dataset import open_dataset

    metrics = call.out / "metrics.json"
    try:
        made = open_dataset(call.out / "dataset.zarr").attributes
        if (made.cad_hash, made.config_hash, made.pose_source) != wanted or _youngest(Path(call.bag)) > metrics.stat().st_mtime:
            return None
        return Outcome(call.bag, str(call.out), KEPT, result=json.loads(metrics.read_text(encoding="utf-8")))
    except (DatasetError, OSError, ValueError):
        return None


def _is_pattern(name: str) -> bool:
    return any(c in name for c in "*?[")


def _name(bag: str) -> str:
    path = Path(bag).resolve()
    return path.stem if path.suffix in (".mcap", ".db3") else path.name


def _files(path: Path) -> Iterator[Path]:
    yield path
    if path.is_dir():
        for folder, _, names in os.walk(path):
            yield from (Path(folder) / name for name in names)


def _youngest(path: Path) -> float:
    return max((p.stat().st_mtime for p in _files(path) if p.exists()), default=0.0)


def _megabytes(path: Path) -> float:
    return sum(p.stat().st_size for p in _files(path) if p.is_file()) / 1e6


def _save(path: Path, outcomes: Sequence[Outcome]) -> None:
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps([asdict(o) for o in outcomes], indent=1) + "\n", encoding="utf-8")
    part.replace(path)
