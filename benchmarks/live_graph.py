# SPDX-License-Identifier: Apache-2.0
"""A graph that runs, one process a node: its first output, its rest, a node that is killed, somebody who comes late."""

from __future__ import annotations

import tempfile
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import plain_node
from benchmarks.figure import Figure, at_most
from benchmarks.load import NODES, SCENE, SESSION, specs
from benchmarks.looped_camera import ROOMS, LoopedCamera
from benchmarks.recorded import recorded
from benchmarks.soak import busy_s
from tof_core.bag import open_bag
from tof_core.errors import ToftwinError
from tof_core.options import BagOptions
from toftwin.graph import GraphProcess

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

HZ = 15.0
RESPAWN_S = 0.1
"""Delay after which graph.launch.py starts a node again."""
IDLE_S = 30.0
KILLS = 5
"""Of each node: how long the middleware takes to match it again varies by seconds."""
SETTLED_S = 1.0
"""What preproc has answered for so long is on the disk: five flushes of its recording."""


@dataclass
class Supervised:
    """The nodes, each in a process; one that dies is started again, as by `ros2 launch`."""

    folder: str
    domain: int
    processes: dict[str, GraphProcess] = field(default_factory=dict)
    ended: threading.Event = field(default_factory=threading.Event)

    def start(self, name: str) -> None:
        """Start a node."""
        spec = dict(zip(NODES, specs(SCENE), strict=True))[name]
        if name == "preproc":
            spec.parameters[name]["live.record"] = self.folder  # type: ignore[index]
        self.processes[name] = GraphProcess(spec, self.domain)

    def watch(self) -> None:
        """Until the end: what died is started again."""
        while not self.ended.wait(0.02):
            for name in [name for name, process in self.processes.items() if not process.alive()]:
                if not self.ended.wait(RESPAWN_S):
                    self.start(name)

    def cpu_s(self) -> float:
        """Processor time of all nodes."""
        return sum(process.cpu_seconds() for process in self.processes.values())


@contextmanager
def running(folder: str) -> Iterator[tuple[Supervised, LoopedCamera, Any]]:
    """The graph, a camera that is still, and the node that listens."""
    import rclpy

    from tof_ros.environment import private_domain, ros_context
    from tof_ros.spin import spinning

    with ExitStack() as stack:
        domain = stack.enter_context(private_domain())
        context = stack.enter_context(ros_context(domain=domain))
        node = rclpy.create_node("bench", context=context)
        with open_bag(recorded(SCENE, SESSION).bag, cell_frame="cell") as reader:
            camera = LoopedCamera(node, reader, HZ)
        graph = Supervised(folder, domain)
        for name in NODES:
            graph.start(name)
        watcher = threading.Thread(target=graph.watch, daemon=True)
        watcher.start()
        stack.enter_context(spinning([node]))
        try:
            wait_for(lambda: camera.heard, 180.0, "every node to listen")
            yield graph, camera, node
        finally:
            camera.stop()
            graph.ended.set()
            watcher.join()
            for process in graph.processes.values():
                process.stop()


def wait_for(done: Callable[[], Any], seconds: float, what: str) -> float:
    """Seconds until it is done."""
    began = time.monotonic()
    while not done():
        if time.monotonic() - began > seconds:
            raise ToftwinError(f"waited {seconds:.0f} s for {what}", where="bench")
        time.sleep(0.005)
    return time.monotonic() - began


def figures() -> list[Figure]:
    """All of it, in one run of the graph."""
    with tempfile.TemporaryDirectory() as folder, running(folder) as (graph, camera, node):
        out = [late_joiner(node), idle(graph), *first_output(camera, node)]
        player = threading.Thread(target=camera.play, args=(3600.0,), daemon=True)
        player.start()
        wait_for(lambda: all(camera.fates[room] for room in ROOMS), 60.0, "frames through the graph")
        out += [*killed(graph, camera, node, Path(folder))]
        camera.stop()
        player.join()
        return out


def late_joiner(node: Any) -> Figure:
    """Somebody who subscribes once all nodes are active: the scene and the network by the diagnostics, the markers as they are latched."""
    from diagnostic_msgs.msg import DiagnosticArray
    from visualization_msgs.msg import MarkerArray

    from tof_ros import qos

    known: dict[str, float] = {}
    began = time.monotonic()

    def diagnosed(message: Any) -> None:
        for value in (v for status in message.status for v in status.values if v.key in ("scene", "model") and v.value):
            known.setdefault(value.key, time.monotonic() - began)

    def drawn(message: Any) -> None:
        if message.markers:
            known.setdefault("markers", time.monotonic() - began)

    heard = [
        node.create_subscription(DiagnosticArray, "/diagnostics", diagnosed, qos.OUTPUT),
        node.create_subscription(MarkerArray, "scene/markers", drawn, qos.LATCHED),
    ]
    wait_for(lambda: {"scene", "model", "markers"} <= known.keys(), 60.0, "what a late joiner must know")
    for subscription in heard:
        node.destroy_subscription(subscription)
    each = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in sorted(known.items()))
    return at_most("a late joiner has scene, model and markers after", max(known.values()), 3.0, "s", remark=each)


def idle(graph: Supervised) -> Figure:
    """Processor time of the graph while no frame comes."""
    time.sleep(2.0)
    before, busy, began = graph.cpu_s(), busy_s(), time.monotonic()
    time.sleep(IDLE_S)
    took = time.monotonic() - began
    used = graph.cpu_s() - before
    others = (busy_s() - busy - used) / took
    share = 100 * used / took
    return at_most("idle graph (preproc, sim_label, infer; no frames), of one core", share, 3.0, "%", remark=load(others))


def first_output(camera: LoopedCamera, node: Any) -> list[Figure]:
    """From the first frame that active nodes are sent to what they publish."""
    from sensor_msgs.msg import Image

    from tof_ros import qos

    heard: dict[str, float] = {}
    topics = ("preproc/depth", "infer/depth")
    for topic in topics:
        node.create_subscription(Image, topic, lambda _, topic=topic: heard.setdefault(topic, time.monotonic()), qos.RECORD)
    wait_for(lambda: all(node.count_publishers(topic) for topic in topics), 30.0, "publishers")
    time.sleep(1.0)
    busy, began = busy_s(), time.monotonic()
    player = threading.Thread(target=camera.play, args=(60.0,), daemon=True)
    player.start()
    wait_for(lambda: heard.keys() == set(topics), 60.0, "the first outputs")
    first = min(camera.sent.values())
    others = (busy_s() - busy) / (time.monotonic() - began)
    camera.stop()
    player.join()
    camera.settle(5.0)
    camera._stop.clear()  # noqa: SLF001  (as its own warm_up does)
    return [
        at_most(f"first frame to first {topic}, all nodes active", heard[topic] - first, 1.0, "s", remark=load(others)) for topic in topics
    ]


def killed(graph: Supervised, camera: LoopedCamera, node: Any, folder: Path) -> Iterator[Figure]:
    """Each node in turn is killed (SIGKILL) while frames come: until it answers again, and what its recording lost."""
    from std_srvs.srv import Trigger

    client = node.create_client(Trigger, "preproc/start_recording")
    answer = client.call(Trigger.Request(), timeout_sec=60.0) if client.wait_for_service(60.0) else None
    if answer is None or not answer.success:
        raise ToftwinError("no answer" if answer is None else answer.message, where="preproc/start_recording")
    time.sleep(3.0)
    plain = plain_node.back_after_s(graph.domain, KILLS, RESPAWN_S)
    for name, room in zip(NODES, ROOMS, strict=True):
        busy, began, back = busy_s(), time.monotonic(), []
        for number in range(KILLS):
            answered = set(camera.fates["preproc"])
            time.sleep(SETTLED_S)
            at_ns = time.time_ns()
            graph.processes[name].process.kill()
            back.append(wait_for(partial(answers, camera, room, at_ns), 120.0, f"{name} to answer again"))
            if name == "preproc" and number == 0:
                yield recording(folder, answered)
        others = (busy_s() - busy) / (time.monotonic() - began)
        remark = (
            f"the longest of {listed(back)} s; a node of rclpy with one subscription, killed likewise: {listed(plain)} s; {load(others)}"
        )
        what = f"kill -9 of {name}, started again after {RESPAWN_S:g} s: answers frames after"
        yield at_most(what, max(back), 3.0, "s", remark=remark)


def listed(seconds: list[float]) -> str:
    """Times of several trials."""
    return ", ".join(f"{value:.1f}" for value in sorted(seconds))


def answers(camera: LoopedCamera, room: str, after_ns: int) -> bool:
    """Whether a frame that was sent after the kill has been kept."""
    return any(stamp > after_ns and fate == "kept" for stamp, fate in tuple(camera.fates[room].items())[-5:])


def recording(folder: Path, answered: set[int]) -> Figure:
    """Frames that the killed node's recording lacks, of those that it had answered `SETTLED_S` before."""
    (bag,) = folder.iterdir()
    with open_bag(bag, BagOptions(recover=True)) as reader:
        kept = {m.stamp_ns for m in reader.messages((reader.topics.depth,))}
    due = {stamp for stamp in answered if stamp >= min(kept)}
    if not due:
        raise ToftwinError("no frame was answered between the start of the recording and the kill", where="bench")
    lost = len(due - kept)
    return at_most(
        "kill -9 of preproc while it records: recorded frames lost",
        lost,
        0,
        "",
        remark=f"of {len(due)} that were answered {SETTLED_S:g} s before",
    )


def load(cores: float) -> str:
    """What this machine did meanwhile."""
    return f"all processes: {cores:.2f} cores"
