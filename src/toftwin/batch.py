# SPDX-License-Identifier: Apache-2.0
"""Labelling of many bags: names and patterns, output folders, bags labelled before, outcomes."""

from __future__ import annotations

import glob
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from tof_core.errors import DatasetError, UsageError
from tof_core.progress import progress
from toftwin.known import Known
from toftwin.label_call import KEPT, LabelCall, Outcome, files
from toftwin.pipeline import PipelineConfig
from toftwin.resume import save_json

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

REPORT = "batch.json"


def label_bags(
    bags: Sequence[str],
    scene: Path,
    out: Path,
    config: PipelineConfig | None = None,
    *,
    mode: str = "final",
    initial_pose: str = "",
    known: Known | None = None,
    engine: str = "local",
    workers: int = 0,
    each: Callable[[Outcome], None] = lambda _: None,
) -> list[Outcome]:
    """Label every bag into a folder of its own under `out`, beside `batch.json`; a bag that fails does not stop the others.

    A bag that an earlier call labelled with the same scene, configuration and mode is kept, unless it has changed since. The kept bags
    come first in the list, the others in the order in which they finish.

    Args:
        bags: names and patterns of bags.
        scene: `scene.yaml`, its folder, or the name of a built-in scene.
        out: folder of the datasets' folders; made if it does not exist.
        config: settings; defaults if not given.
        mode: source of the poses, one of `toftwin.known.MODES`.
        initial_pose: the text of `--initial-pose`.
        known: known effects of the camera.
        engine: `local`, processes of this host, or `ray`, a Ray cluster.
        workers: processes, one core each; 0: number of cores.
        each: called with the outcome of each bag that is not kept, when the bag is finished.

    Raises:
        UsageError: a pattern fits nothing, two bags would be written to one folder, or Ray is not installed.
    """
    from toftwin.batch_engines import ENGINES

    config = config or PipelineConfig()
    calls = [LabelCall(bag, scene, out / _name(bag), config, mode, initial_pose, known=known or Known()) for bag in find_bags(bags)]
    wanted = calls[0].provenance()
    outcomes = [outcome for call in calls if (outcome := _kept(call, wanted)) is not None]
    before = {outcome.bag for outcome in outcomes}
    left = [call for call in calls if call.bag not in before]
    out.mkdir(parents=True, exist_ok=True)
    save_json(out / REPORT, [asdict(o) for o in outcomes])
    for outcome in progress(ENGINES[engine](left, workers), "bags", len(left)):
        outcomes.append(outcome)
        save_json(out / REPORT, [asdict(o) for o in outcomes])
        each(outcome)
    return outcomes


def is_batch(bags: Sequence[str], engine: str | None) -> bool:
    """Whether a call names several bags, a pattern, or an engine; an existing file is one bag, also if its name looks like a pattern."""
    return bool(engine) or len(bags) > 1 or (_is_pattern(bags[0]) and not Path(bags[0]).exists())


def find_bags(named: Sequence[str]) -> list[str]:
    """The bags that match names and patterns, each once, in order.

    Raises:
        UsageError: there are no names, a pattern fits nothing, or two bags would be written to one folder.
    """
    if not named:
        raise UsageError("no bag is named", where="label", todo="name a bag, or a pattern of bags")
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


def _kept(call: LabelCall, wanted: tuple[str, str, str]) -> Outcome | None:
    """The outcome of an earlier call with the same scene, configuration and mode, if the bag is older than its labels; otherwise None."""
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


def _youngest(path: Path) -> float:
    return max((p.stat().st_mtime for p in files(path) if p.exists()), default=0.0)
