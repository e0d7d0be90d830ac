# SPDX-License-Identifier: Apache-2.0
"""A bag through the ROS graph over DDS, and its results."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tof_core.config import flatten
from tof_core.errors import BagError
from tof_core.options import NOT_WANTED
from tof_core.progress import progress
from tof_core.topics import TF
from toftwin.graph import DONE, NODES, GraphProcess, GraphSpec, RunningGraph, graph_process

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.bag import BagReader
    from tof_ros.player import Player, PlayOptions, PlayReport
    from tof_ros.recorder import Recorder
    from toftwin.pipeline import PipelineConfig

PATIENCE_S = 8.0
"""Seconds after which a frame without its transform is skipped; DDS repeats lost messages after three seconds."""
OWN_GRAPH_S = 300.0
"""Seconds that the graph of a replay may take to start while its process lives: on a busy host it imports and compiles for minutes."""
NOT_PLAYED = ("/clock", "/diagnostics", "/rosout", "/parameter_events")


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """Result of a replay: frames by outcome, largest memory of the graph in bytes, its processor time since its start."""

    report: PlayReport
    memory_bytes: int
    cpu_s: float = 0.0
    recorded: int = 0
    nodes: tuple[str, ...] = field(default=())


def graph_for(reader: BagReader, config: PipelineConfig, scene: Path | None) -> GraphSpec:
    """The graph whose live results equal those of the offline pipeline for this bag and configuration."""
    t, camera = reader.topics, reader.camera.frame_id
    cell = reader.chain.cell or (reader.transforms.root(camera) if camera in reader.transforms.frames() else "")
    values = flatten(config)
    names = {
        "depth_topic": t.depth,
        "points_topic": t.points,
        "info_topic": t.info,
        "amplitude_topic": t.amplitude or NOT_WANTED,
        "temperature_topic": t.temperature or NOT_WANTED,
        "cell_frame": cell,
    }
    preproc = {k: v for k, v in values.items() if k.startswith(("input.", "still.", "station.", "preproc."))}
    preproc |= {f"input.{k}": v for k, v in names.items()} | {
        "live.reliable": True,
        "live.keep_tf_s": 3600.0,
        "live.patience_s": PATIENCE_S,
        "live.need_tf": bool(cell),
    }
    if scene is None:
        return GraphSpec(("preproc",), {"preproc": preproc}, use_sim_time=True)
    label = {k: v for k, v in values.items() if k.startswith(("align.", "label."))}
    label |= {
        "live.scene": str(scene),
        "live.cell_frame": cell,
        "live.body_frame": config.input.body_frame,
        "live.max_gap_s": config.input.max_gap_s,
        "live.settle_s": 0.0,
        "live.keep_tf_s": 3600.0,
        "live.patience_s": PATIENCE_S,
    }
    return GraphSpec(("preproc", "sim_label"), {"preproc": preproc, "sim_label": label}, use_sim_time=True, strict=True)


def outputs_of(node: str, *, points: bool = False) -> list[tuple[str, type[Any]]]:
    """Topics and message classes that a node publishes."""
    kinds: dict[str, type[Any]] = import_module(NODES[node]).OUTPUTS
    room = DONE[node].partition("/")[0]
    return [(f"{room}/{name}", kind) for name, kind in kinds.items() if points or name != "points"]


def _played(reader: BagReader, spec: GraphSpec) -> dict[str, str]:
    """Topics of the bag that are played, with their types: all except those that the graph or a recorder publishes."""
    own = tuple(DONE[n].partition("/")[0] + "/" for n in spec.nodes)
    return {t: kind for t, kind in reader.types.items() if t not in NOT_PLAYED and not t.lstrip("/").startswith(own)}


def _subscribed(reader: BagReader) -> list[str]:
    """Topics that the graph subscribes to."""
    t = reader.topics
    return [name for name in (t.depth or t.points, t.info, t.amplitude, t.temperature) if name]


def _check_recording(recorder: Recorder, report: PlayReport) -> None:
    """Refuse an incomplete recording: its gaps would look like those of the graph."""
    if recorder.failed:
        raise BagError(recorder.failed, where=recorder.path)
    kept = recorder.counts["/preproc/depth"]
    if kept != report.fates["kept"]:
        raise BagError(f"holds {kept} of {report.fates['kept']} frames", where=recorder.path, todo="this host is overloaded; replay again")


def replay(
    reader: BagReader,
    config: PipelineConfig,
    *,
    scene: Path | None,
    options: PlayOptions,
    record: Path | None = None,
    points: bool = False,
    running: bool = False,
) -> ReplayResult:
    """Play a bag through a graph in another process and a ROS domain of its own.

    Args:
        reader: the bag.
        config: the configuration of the nodes that are started.
        scene: the CAD, or None for preprocessing alone.
        options: pace and waiting times.
        record: bag in which the results of the graph are recorded.
        points: record point clouds too.
        running: start no nodes; the graph runs already, in the ROS domain of the environment.

    Raises:
        TransformError: TF contains no cell or no camera.
        ReplayError: the graph has no subscriptions, stopped, or does not answer.
    """
    from tof_ros.environment import named_domain, private_domain, ros_context
    from tof_ros.player import Player
    from tof_ros.recorder import Recorder
    from tof_ros.spin import spinning

    if scene is not None:
        reader.chain.resolve(reader.camera.frame_id)
    spec = graph_for(reader, config, scene)
    with ExitStack() as stack:
        domain = named_domain() if running else stack.enter_context(private_domain())
        context = stack.enter_context(ros_context(domain=domain))
        player = Player(context, [reader.topics.depth or reader.topics.points], [DONE[n] for n in spec.nodes], options)
        recorder = None
        if record is not None:
            recorder = Recorder(player, record, [output for node in spec.nodes for output in outputs_of(node, points=points)])
            stack.callback(recorder.close)
        stack.enter_context(spinning([player]))
        graph = RunningGraph() if running else stack.enter_context(graph_process(spec, domain))
        _play(reader, player, recorder, spec, graph)
        memory, cpu_s = graph.memory_bytes(), graph.cpu_seconds()
    return ReplayResult(player.report, memory, cpu_s, recorder.count if recorder else 0, spec.nodes)


def _play(reader: BagReader, player: Player, recorder: Recorder | None, spec: GraphSpec, graph: GraphProcess | RunningGraph) -> None:
    """Wait for all subscriptions, play, and wait until each frame is answered and recorded."""
    played = _played(reader, spec)
    player.advertise({**played, "/tf": TF, "/tf_static": TF}.items())
    shared = ("/tf", "/tf_static") if isinstance(graph, RunningGraph) else ("/tf", "/tf_static", "/clock")
    subscriptions = {**dict.fromkeys(_subscribed(reader), 1), **dict.fromkeys(shared, len(spec.nodes))}
    patience = {} if isinstance(graph, RunningGraph) else {"timeout_s": OWN_GRAPH_S}
    player.wait_for_graph(subscriptions, graph.alive, lambda: recorder.mute if recorder is not None else [], **patience)
    if (placed := reader.chain.placed) is not None:
        player.place(placed.frame, reader.chain.cell or "cell", placed.T_frame_cell)
    rest = tuple(t for t in played if t != "/tf")
    for _ in progress(player.play(reader.messages(rest), reader.messages(("/tf",)), graph.alive), "replay", reader.frame_count):
        pass
    player.finish([f"{node}/flush" for node in spec.nodes if node != "preproc"])
    if recorder is not None:
        recorder.settle()
        _check_recording(recorder, player.report)
