# SPDX-License-Identifier: Apache-2.0
"""The graph for a long time at the camera's rate, then as fast as it goes: `make soak ARGS="--minutes 60 --write"`."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import table
from benchmarks.__main__ import PAGE, where
from benchmarks.figure import Figure, at_least, at_most
from benchmarks.looped_camera import ROOMS, LoopedCamera
from benchmarks.recorded import recorded
from tof_core.bag import open_bag
from toftwin.graph import GraphSpec, graph_process

if TYPE_CHECKING:
    from collections.abc import Iterator

    from toftwin.graph import GraphProcess

SESSION = {"plan": {"views": 12, "stations": 3, "captures": 30, "move_s": 0.1}, "seed": 4}
"""12 dwells of two seconds, a tenth of a second between them."""
RATES = (15, 18, 20, 22, 25, 27, 30, 35, 40)
RATE_S = 30.0
BEHIND_S = 0.25
"""How late the camera may be at most for a rate to count as one that was sent."""
WARM_S = 60.0
"""Memory grows until every kernel, camera and queue has been used once."""


@dataclass(frozen=True, slots=True)
class Run:
    """What one stretch came to."""

    hz: float
    sent: int
    lost: dict[str, int]
    p50_ms: float
    p95_ms: float
    grown_mb: float
    cpu_ms: dict[str, float]
    other_cores: float
    behind_s: float = 0.0
    """The most that the camera sent a frame after it was due."""

    def __str__(self) -> str:
        """One line."""
        lost = ", ".join(f"{room} {count}" for room, count in self.lost.items() if count) or "none"
        return (
            f"{self.hz:.1f} Hz, {self.sent} frames, lost: {lost}, raw to inferred p50 {self.p50_ms:.0f} p95 {self.p95_ms:.0f} ms, "
            f"memory {self.grown_mb:+.1f} MB, {self.load}"
        )

    @property
    def load(self) -> str:
        """Processor time a frame by node, and what else ran."""
        each = ", ".join(f"{name} {ms:.0f}" for name, ms in self.cpu_ms.items())
        return f"ms of processor a frame: {each}; other processes {self.other_cores:.2f} cores"


def specs(scene: str) -> list[GraphSpec]:
    """Preprocessing, labels and the network, each frame heard reliably; one process a node, as `ros2 launch` starts them."""
    patient = {"live.patience_s": 10.0}
    parameters: dict[str, dict[str, Any]] = {
        "preproc": {**patient, "live.reliable": True},
        "sim_label": {**patient, "live.scene": scene},
        "infer": {**patient, "live.reliable": True, "infer.threads": 1},
    }
    return [GraphSpec((name,), {name: values}, strict=True) for name, values in parameters.items()]


@dataclass(frozen=True, slots=True)
class Graph:
    """The processes of the graph."""

    parts: tuple[GraphProcess, ...]

    def alive(self) -> bool:
        """Whether all of them run."""
        return all(part.alive() for part in self.parts)

    def cpu_seconds(self) -> dict[str, float]:
        """Processor time by node."""
        return {room: part.cpu_seconds() for room, part in zip(ROOMS, self.parts, strict=True)}

    def resident_mb(self) -> float:
        """Their memory now."""
        lines = [line for p in self.parts for line in Path(f"/proc/{p.process.pid}/status").read_text(encoding="ascii").splitlines()]
        return sum(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def busy_s() -> float:
    """Processor time that all processes of this machine have used."""
    user, nice, system, idle, wait, *rest = (int(v) for v in Path("/proc/stat").read_text(encoding="ascii").split("\n")[0].split()[1:])
    del idle, wait
    return (user + nice + system + sum(rest[:2])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def running(scene: str, bag: Path, hz: float) -> Iterator[tuple[LoopedCamera, Graph]]:
    """A graph of its own with a camera that it hears."""
    import rclpy

    from tof_ros.environment import private_domain, ros_context
    from tof_ros.spin import spinning

    with ExitStack() as stack:
        domain = stack.enter_context(private_domain())
        context = stack.enter_context(ros_context(domain=domain))
        node = rclpy.create_node("soak", context=context)
        with open_bag(bag, cell_frame="cell") as reader:
            camera = LoopedCamera(node, reader, hz)
        stack.enter_context(spinning([node]))
        graph = Graph(tuple(stack.enter_context(graph_process(spec, domain)) for spec in specs(scene)))
        deadline = time.monotonic() + 120.0
        while not camera.heard:
            if not graph.alive() or time.monotonic() > deadline:
                raise SystemExit("soak: the graph did not start; its messages are above")
            time.sleep(0.1)
        if not camera.warm_up(graph.alive):
            raise SystemExit("soak: frames do not flow through the graph; its messages are above")
        yield camera, graph


def stretch(scene: str, bag: Path, hz: float, seconds: float, *, say: bool) -> Run:
    """Play so long; memory is compared with that after `WARM_S`, or after a third of a short run."""
    with running(scene, bag, hz) as (camera, graph):
        handler = signal.signal(signal.SIGINT, lambda *_: camera.stop())
        watch = Watch(camera, graph, min(WARM_S, seconds / 3), say=say)
        busy, mine, theirs, begin = busy_s(), time.process_time(), graph.cpu_seconds(), time.monotonic()
        reached = watch.play(seconds)
        camera.settle()
        took = time.monotonic() - begin
        used = {room: after - theirs[room] for room, after in graph.cpu_seconds().items()} | {"camera": time.process_time() - mine}
        others = max(busy_s() - busy - sum(used.values()), 0.0) / took
        grown = graph.resident_mb() - watch.warm_mb
        signal.signal(signal.SIGINT, handler)
        lost = {room: camera.lost(room) for room in ROOMS}
        cpu_ms = {name: 1e3 * seconds / len(camera.sent) for name, seconds in used.items()}
        return Run(reached, len(camera.sent), lost, camera.latency_ms(50), camera.latency_ms(95), grown, cpu_ms, others, camera.behind_s)


class Watch:
    """Looks at memory while the camera plays, and says every minute how it goes."""

    def __init__(self, camera: LoopedCamera, graph: Graph, warm_s: float, *, say: bool) -> None:
        """Not begun."""
        self._camera, self._graph, self._warm_s, self._say = camera, graph, warm_s, say
        self.warm_mb = 0.0

    def play(self, seconds: float) -> float:
        """Play in a thread of its own; gives the rate reached."""
        import threading

        reached: list[float] = []
        player = threading.Thread(target=lambda: reached.append(self._camera.play(seconds)))
        player.start()
        begin, minute = time.monotonic(), 1
        while player.is_alive():
            player.join(1.0)
            passed = time.monotonic() - begin
            if not self.warm_mb and passed > self._warm_s:
                self.warm_mb = self._graph.resident_mb()
            if self._say and passed > 60 * minute:
                minute += 1
                lost = {room: self._camera.lost(room) for room in ROOMS}
                print(
                    f"  {passed / 60:.0f} min: {len(self._camera.sent)} sent, open or lost {lost}, p95 {self._camera.latency_ms(95):.0f} ms, "
                    f"{self._graph.resident_mb():.0f} MB",
                    file=sys.stderr,
                    flush=True,
                )
        return reached[0]


def highest_rate(scene: str, bag: Path, *, say: bool) -> tuple[float, str]:
    """The highest of `RATES` that is held for `RATE_S` without a lost frame, and what happened at the next."""
    held, why = 0.0, ""
    for hz in RATES:
        run = stretch(scene, bag, hz, RATE_S, say=False)
        if say:
            print(f"  {hz} Hz: {run}", file=sys.stderr, flush=True)
        if any(run.lost.values()) or run.behind_s > BEHIND_S:
            why = f"at {hz} Hz: {run}"
            break
        held = float(hz)
    return held, why


def rows(run: Run, minutes: float) -> list[Figure]:
    """The long stretch's figures beside their bars."""
    remark = f"{run.sent} frames at {run.hz:.1f} Hz in {minutes:.0f} min, one process a node; {run.load}"
    return [
        at_most("soak: frames lost by any node of preproc, sim_label, infer, 224x171", max(run.lost.values()), 0, "", remark=remark),
        at_most("soak: growth of the graph's memory after the first minute", run.grown_mb, 20, "MB", remark=remark),
        at_most("soak: raw frame to repaired frame, p95", run.p95_ms, 100, "ms", remark=f"p50 {run.p50_ms:.0f} ms; {remark}"),
    ]


def parse(arguments: list[str] | None) -> Any:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="how long at --hz (default: 60); Ctrl-C ends it early and reports")
    parser.add_argument("--hz", type=float, default=15.0, help="frames a second (default: 15)")
    parser.add_argument("--no-rate", action="store_true", help="leave out the search for the highest rate")
    parser.add_argument("--rate-only", action="store_true", help="search for the highest rate alone")
    parser.add_argument("--write", action="store_true", help="renew these rows of docs/figures.md")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 when every bar is met, 1 when one is missed."""
    options = parse(arguments)
    session = recorded("body_section", SESSION)
    results: dict[str, list[Figure]] = {}
    if not options.rate_only:
        print(f"soak: {options.minutes:g} min at {options.hz:g} Hz", file=sys.stderr, flush=True)
        run = stretch("body_section", session.bag, options.hz, 60 * options.minutes, say=True)
        print(f"  {run}", file=sys.stderr, flush=True)
        command = f"python -m benchmarks.soak --minutes {options.minutes:g}"
        results["soak"] = [replace(f, command=command) for f in rows(run, run.sent / max(run.hz, 1e-9) / 60)]
    if not options.no_rate:
        held, why = highest_rate("body_section", session.bag, say=True)
        highest = at_least("soak: highest rate that the whole graph holds without loss", held, 30, "Hz", remark=why)
        results["soak_rate"] = [replace(highest, command="python -m benchmarks.soak --rate-only")]
    figures = [figure for room in results.values() for figure in room]
    print("\n".join(table.line(figure) for figure in figures))
    if options.write:
        table.write_page(PAGE, results, where())
    return 1 if any(figure.met is False for figure in figures) else 0


if __name__ == "__main__":
    sys.exit(main())
