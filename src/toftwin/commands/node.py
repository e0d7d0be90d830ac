# SPDX-License-Identifier: Apache-2.0
"""`toftwin node`: run nodes of the graph live, in one process."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

NAME = "node"
HELP = "run nodes of the graph live on ROS 2, all in one process"
ABOUT = (
    "Starts one or more nodes in this process. They subscribe to the camera's topics and publish their results until "
    "Ctrl-C. Their settings are ROS parameters: --list-params prints them."
)
EXAMPLE = "toftwin node preproc sim_label --param sim_label.live.scene=cell/scene.yaml --namespace spot"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.graph import NODES

    parser.add_argument("nodes", nargs="+", metavar="NODE", help=f"one or more of {', '.join(NODES)}")
    parser.add_argument("--scene", default="", metavar="FILE", help="scene.yaml for every node that needs one")
    parser.add_argument(
        "--initial-pose",
        default="",
        metavar="POSE",
        help="where the cell is if TF does not know it: 'odom: x y z qx qy qz qw' (metres, quaternion); RViz's 2D Pose Estimate changes it",
    )
    parser.add_argument(
        "--param",
        action="append",
        default=[],
        metavar="NODE.NAME=VALUE",
        help="a ROS parameter, for instance preproc.preproc.sor.enable=false; a name that the node does not have is refused",
    )
    parser.add_argument(
        "--params-file",
        action="append",
        default=[],
        metavar="FILE",
        help="a ROS parameter file; names in it that no node here has, and a file for none of them, are reported",
    )
    parser.add_argument("--remap", action="append", default=[], metavar="FROM:=TO", help="a topic under another name")
    parser.add_argument("--namespace", default="", help="namespace of the robot")
    parser.add_argument(
        "--auto", action="store_true", help="subscribe to the only camera that is published, whatever the names of its topics"
    )
    parser.add_argument("--use-sim-time", action="store_true", help="follow /clock")
    parser.add_argument(
        "--strict", action="store_true", help="stop when a node cannot be configured (default: it waits for valid parameters)"
    )
    parser.add_argument("--list-params", action="store_true", help="print the parameter file of these nodes and stop")


def run(args: argparse.Namespace) -> int:
    """Run until stopped."""
    from tof_core.errors import UsageError
    from toftwin.graph import PLACED, WITH_SCENE, GraphSpec, parse_parameters, run_graph

    remaps = [tuple(pair.split(":=", 1)) for pair in args.remap]
    if bad := [pair for pair, parts in zip(args.remap, remaps, strict=True) if len(parts) != 2]:
        raise UsageError(f"'{bad[0]}' is not FROM:=TO", where="--remap")
    parameters = parse_parameters(args.param, args.nodes)
    for name in args.nodes:
        if args.scene and name in WITH_SCENE:
            parameters[name].setdefault("live.scene", args.scene)
        if args.initial_pose and name in PLACED:
            parameters[name].setdefault("live.initial_pose", args.initial_pose)
    if args.auto and not args.list_params:
        import sys

        from toftwin.auto import find_live, taken, with_topics

        topics = find_live()
        print(taken(topics), file=sys.stderr, flush=True)
        parameters = with_topics(parameters, topics, args.nodes)
    spec = GraphSpec(
        tuple(args.nodes),
        parameters,
        tuple((a, b) for a, b in remaps),
        args.namespace,
        args.use_sim_time,
        tuple(args.params_file),
        args.strict,
    )
    if args.list_params:
        print(parameter_file(spec.nodes))
        return 0
    return run_graph(spec)


def parameter_file(nodes: tuple[str, ...]) -> str:
    """The ROS parameter file of nodes at their defaults."""
    from importlib import import_module

    from tof_ros.parameters import parameter_yaml
    from toftwin.graph import NODES

    return "\n".join(parameter_yaml(name, import_module(NODES[name]).CONFIG) for name in nodes)
