# SPDX-License-Identifier: Apache-2.0
"""The graph for a long time at the cameras' rate, then as fast as it goes: `make soak ARGS="--minutes 60 --write"`."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import table
from benchmarks.__main__ import PAGE, where
from benchmarks.figure import Figure, at_least, at_most
from benchmarks.load import NODES, STOCK_LOAD, Load
from benchmarks.looped_camera import LoopedCamera
from tof_core.bag import open_bag
from tof_core.cores import CORES
from toftwin.graph import graph_process

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from toftwin.graph import GraphProcess

RATES = (2, 4, 6, 8, 10, 12, 15, 18, 20, 22, 25, 27, 30, 35, 40)
RATE_S = 30.0
MOST_CAMERAS = 5
"""As Spot has them on its body."""
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
    labels: int
    """Of all cameras."""
    behind_s: float = 0.0
    """The most that the camera sent a frame after it was due."""

    def __str__(self) -> str:
        """One line."""
        return f"{self.hz:.1f} Hz, {self.sent} frames, {self.losses}, {self.latency}memory {self.grown_mb:+.1f} MB, {self.load}"

    @property
    def losses(self) -> str:
        """Frames lost by each node that lost any."""
        return f"lost: {', '.join(f'{room} {count}' for room, count in self.lost.items() if count) or 'none'}"

    @property
    def latency(self) -> str:
        """From raw to inferred, with a comma after it; empty where no network ran."""
        return "" if isnan(self.p50_ms) else f"raw to inferred p50 {self.p50_ms:.0f} p95 {self.p95_ms:.0f} ms, "

    @property
    def load(self) -> str:
        """Processor time a frame by node, the labels made, and what else ran."""
        each = ", ".join(f"{name} {ms:.1f}" for name, ms in self.cpu_ms.items())
        labels = f", {self.labels} labels" if any(room.endswith("label") for room in self.lost) else ""
        return f"ms of processor a frame: {each}{labels}; other processes {self.other_cores:.2f} cores"


@dataclass(frozen=True, slots=True)
class Graph:
    """The processes of the graph."""

    processes: tuple[GraphProcess, ...]
    parts: tuple[str, ...]
    """What the processes of each camera serve, in their order."""

    def alive(self) -> bool:
        """Whether all of them run."""
        return all(process.alive() for process in self.processes)

    def cpu_seconds(self) -> dict[str, float]:
        """Processor time by part, that of all cameras together."""
        used = dict.fromkeys(self.parts, 0.0)
        for number, process in enumerate(self.processes):
            used[self.parts[number % len(self.parts)]] += process.cpu_seconds()
        return used

    def resident_mb(self) -> float:
        """Their memory now."""
        lines = [line for p in self.processes for line in Path(f"/proc/{p.process.pid}/status").read_text(encoding="ascii").splitlines()]
        return sum(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def busy_s() -> float:
    """Processor time that all processes of this machine have used."""
    user, nice, system, idle, wait, *rest = (int(v) for v in Path("/proc/stat").read_text(encoding="ascii").split("\n")[0].split()[1:])
    del idle, wait
    return (user + nice + system + sum(rest[:2])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def running(given: Load, *, paced: bool = False) -> Iterator[tuple[LoopedCamera, Graph]]:
    """A graph of its own with cameras that it hears."""
    import rclpy

    from tof_ros.environment import private_domain, ros_context
    from tof_ros.spin import spinning

    with ExitStack() as stack:
        domain = stack.enter_context(private_domain())
        context = stack.enter_context(ros_context(domain=domain))
        node = rclpy.create_node("soak", context=context)
        with open_bag(given.bag(), cell_frame="cell") as reader:
            camera = LoopedCamera(node, reader, given.hz, given.namespaces, given.rooms, paced=paced)
        stack.enter_context(spinning([node]))
        graph = Graph(tuple(stack.enter_context(graph_process(spec, domain)) for spec in given.specs()), given.parts)
        deadline = time.monotonic() + 120.0
        while not camera.heard:
            if not graph.alive() or time.monotonic() > deadline:
                raise SystemExit("soak: the graph did not start; its messages are above")
            time.sleep(0.1)
        if not camera.warm_up(graph.alive):
            raise SystemExit("soak: frames do not flow through the graph; its messages are above")
        yield camera, graph


def stretch(given: Load, seconds: float, *, say: bool, paced: bool = False) -> Run:
    """Play so long; memory is compared with that after `WARM_S`, or after a third of a short run."""
    with running(given, paced=paced) as (camera, graph):
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
        lost = {room: camera.lost(room) for room in camera.rooms}
        cpu_ms = {name: 1e3 * seconds / (len(camera.sent) * given.cameras) for name, seconds in used.items()}
        late = (camera.latency_ms(50), camera.latency_ms(95))
        return Run(reached, len(camera.sent), lost, *late, grown, cpu_ms, others, camera.labels, camera.behind_s)


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
                lost = {room: self._camera.lost(room) for room in self._camera.rooms}
                print(
                    f"  {passed / 60:.0f} min: {len(self._camera.sent)} sent, open or lost {lost}, p95 {self._camera.latency_ms(95):.0f} ms, "
                    f"{self._graph.resident_mb():.0f} MB",
                    file=sys.stderr,
                    flush=True,
                )
        return reached[0]


def last_held(loads: Iterable[Load], *, say: bool) -> tuple[Load | None, str]:
    """The last load that is held for `RATE_S` without a lost frame, and what happened at the next."""
    held = None
    for given in loads:
        run = stretch(given, RATE_S, say=False)
        if say:
            print(f"  {given}: {run}", file=sys.stderr, flush=True)
        if any(run.lost.values()) or run.behind_s > BEHIND_S:
            return held, f"{given}: {run}"
        held = given
    return held, ""


def highest_rate(given: Load, *, say: bool) -> Figure:
    """The highest of `RATES` that the graph holds with cameras of this kind."""
    held, why = last_held((replace(given, hz=hz) for hz in RATES if hz >= given.lowest_hz), say=say)
    bar = 30.0 if given.stock else 0.0
    kind = "" if given.stock else f", {given.cameras} x {given.width}x{given.height}"
    what = f"soak: highest rate that the whole graph holds without loss{kind}"
    rate = held.hz if held else 0.0
    return at_least(what, rate, bar, "Hz", remark=why) if bar else Figure(what, rate, "Hz", remark=why)


def most_cameras(given: Load, *, say: bool) -> Figure:
    """How many cameras of this kind the nodes hold."""
    held, why = last_held((replace(given, cameras=number) for number in range(1, MOST_CAMERAS + 1)), say=say)
    what = f"soak: cameras of {replace(given, cameras=1)} that {', '.join(given.nodes)} hold without loss"
    return at_least(what, held.cameras if held else 0, MOST_CAMERAS, "", remark=why)


def rows(run: Run, minutes: float, given: Load = STOCK_LOAD) -> list[Figure]:
    """The long stretch's figures beside their bars."""
    each = "" if given.cameras == 1 else f" of each of {given.cameras} cameras"
    process = "camera" if given.together else "node"
    remark = f"{run.sent} frames{each} at {run.hz:.1f} Hz in {minutes:.0f} min, one process a {process}; {run.load}"
    name = "" if given == STOCK_LOAD else f", {given}"
    bar = 100.0 if given.hz <= STOCK_LOAD.hz else 2e3 / given.hz
    nodes = "preproc, sim_label, infer, 224x171" if given == STOCK_LOAD else ", ".join(given.nodes)
    return [
        at_most(f"soak: frames lost by any node of {nodes}{name}", max(run.lost.values()), 0, "", remark=f"{run.losses}; {remark}"),
        at_most(f"soak: growth of the graph's memory after the first minute{name}", run.grown_mb, 20 * given.cameras, "MB", remark=remark),
    ] + [
        at_most(f"soak: raw frame to repaired frame, p95{name}", run.p95_ms, bar, "ms", remark=f"p50 {run.p50_ms:.0f} ms; {remark}")
        for node in given.nodes
        if node == "infer"
    ]


def cost(run: Run, given: Load) -> Figure:
    """Processor time of a frame beside what the cores have for it; frames that were lost cost less than they would have."""
    share = 1e3 * CORES / (given.hz * given.cameras)
    total = sum(run.cpu_ms.values())
    what = f"soak: processor time a frame of {given}, {', '.join(given.nodes)} and the camera, which waits for their answers"
    held = f"{CORES} cores have {share:.0f} ms, so much as {given.cameras * share / total:.1f} such cameras take"
    return at_most(what, total, share, "ms", remark=f"{run.sent} frames, {run.losses}; {run.load}; {held}")


def parse(arguments: list[str] | None) -> Any:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="how long at --hz (default: 60); Ctrl-C ends it early and reports")
    parser.add_argument("--hz", type=float, default=15.0, help="frames a second (default: 15)")
    parser.add_argument("--size", default="224x171", metavar="WxH", help="columns and rows of each camera (default: 224x171)")
    parser.add_argument("--cameras", type=int, default=1, help="so many cameras of one robot, a graph for each (default: 1)")
    parser.add_argument("--nodes", default=",".join(NODES), help="nodes that run for each camera (default: all three)")
    parser.add_argument("--view-every", type=int, default=1, help="live.view_every of preproc (default: 1; 0: the last view of each dwell)")
    parser.add_argument("--label-share", type=float, default=0.0, help="live.share of sim_label (default: 0, a label for each dwell)")
    parser.add_argument("--recipe", default="default", help="recipe of the network; one that is not in the package has untrained weights")
    parser.add_argument("--together", action="store_true", help="the nodes of a camera in one process (default: one process a node)")
    parser.add_argument("--no-rate", action="store_true", help="leave out the search for the highest rate")
    parser.add_argument("--rate-only", action="store_true", help="search for the highest rate alone")
    parser.add_argument("--paced", action="store_true", help="processor time a frame alone: the camera waits for the graph's answers")
    parser.add_argument("--most-cameras", action="store_true", help="search for the number of cameras that is held, alone")
    parser.add_argument("--write", action="store_true", help="renew these rows of docs/figures.md")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 when every bar is met, 1 when one is missed."""
    options = parse(arguments)
    width, height = (int(side) for side in options.size.split("x"))
    nodes = tuple(options.nodes.split(","))
    shares = (options.label_share, options.view_every)
    given = Load(options.hz, width, height, options.cameras, nodes, *shares, options.recipe, options.together)
    results: dict[str, list[Figure]] = {}
    if options.most_cameras:
        figure = most_cameras(given, say=True)
        results[f"{given.section}_cameras"] = [replace(figure, command=f"python -m benchmarks.soak --most-cameras{given.flags}")]
    elif options.paced:
        run = stretch(given, 60 * options.minutes, say=False, paced=True)
        print(f"  {run}", file=sys.stderr, flush=True)
        command = f"python -m benchmarks.soak --paced --minutes {options.minutes:g}{given.flags}"
        results[f"{given.section}_cost"] = [replace(cost(run, given), command=command)]
    elif not options.rate_only:
        print(f"soak: {options.minutes:g} min, {given}", file=sys.stderr, flush=True)
        run = stretch(given, 60 * options.minutes, say=True)
        print(f"  {run}", file=sys.stderr, flush=True)
        command = f"python -m benchmarks.soak --minutes {options.minutes:g}{given.flags}"
        results[given.section] = [replace(f, command=command) for f in rows(run, run.sent / max(run.hz, 1e-9) / 60, given)]
    if options.rate_only or (given == STOCK_LOAD and not (options.no_rate or options.most_cameras or options.paced)):
        figure = highest_rate(given, say=True)
        results[f"{given.section}_rate"] = [replace(figure, command=f"python -m benchmarks.soak --rate-only{given.flags}")]
    figures = [figure for room in results.values() for figure in room]
    print("\n".join(table.line(figure) for figure in figures))
    if options.write:
        table.write_page(PAGE, results, where())
    return 1 if any(figure.met is False for figure in figures) else 0


if __name__ == "__main__":
    sys.exit(main())
