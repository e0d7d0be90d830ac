# SPDX-License-Identifier: Apache-2.0
"""Write docs/nodes/*.md, docs/commands.md and docs/limits.md from the code they describe: `.venv/bin/python scripts/make_docs.py`."""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import limits_page
from node_pages import INPUTS, NODE_TEXTS, STATE, TALLY, NodeText, Topic
from tof_core.config import table
from toftwin.cli import build_parser, command_names, load_command
from toftwin.graph import DONE, NODES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.config import ParamInfo

DOCS = Path(__file__).resolve().parent.parent / "docs"
NAMES = "Names are the same in `--set`, `--config` and `config/graph.yaml`."
LIFE = (
    "A managed node. With `live.autostart` (the default) it configures and activates itself at the start; otherwise a lifecycle manager or `ros2 lifecycle set` does. "
    "It loads its files when it is configured. A failure leaves it unconfigured and appears in the diagnostics (level ERROR); correct the parameter "
    "and configure again. While inactive it has no subscriptions and refuses its services."
)
MADE = "<!-- Made by scripts/make_docs.py; a test holds it up to date. -->"


def pages() -> dict[str, str]:
    """Every generated page: its path under docs/, and its text."""
    nodes = {f"nodes/{name}.md": node_page(name) for name in NODES}
    return {**nodes, "nodes/README.md": nodes_index(), "commands.md": commands_page(), "limits.md": limits_page.page()}


def node_page(name: str) -> str:
    """One node: how to start it, topics, services, diagnostics, parameters."""
    module, text = import_module(NODES[name]), text_of(name)
    room = DONE[name].partition("/")[0]
    rows = [Topic(f"`{room}/{topic}`", _type(kind), text.outputs.get(topic, "")) for topic, kind in module.OUTPUTS.items()]
    rows += [Topic(f"`{topic}`", _type(kind), SHARED[topic]) for topic, kind in getattr(module, "SHARED", {}).items()]
    rows += [Topic(f"`{room}/{topic}`", f"toftwin_msgs/{name}", TYPED[name]) for topic, name in getattr(module, "TYPED", {}).items()]
    if "DepthOutput(" in inspect.getsource(module):
        rows.append(Topic(f"`{room}/depth/compressedDepth`", "sensor_msgs/CompressedImage", PACKED))
    rows += [Topic(*row) for row in text.more]
    fates = f"result of each frame: `kept`, {text.fates}or the reason why it was skipped"
    rows.append(Topic(f"`{room}/done`", "sensor_msgs/TimeReference", fates))
    managed = "ManagedNode[" in inspect.getsource(module)
    when = "while the node is unconfigured" if managed else "at the start only"
    parts = [
        f"# Node `{name}`", MADE, f"{text.about} Terms: [glossary](../glossary.md).",
        "## Start", "\n".join(f"    {line}" for line in text.start),
        *(("## Life cycle", LIFE) if managed else ()),
        "## Subscribed", _topics(INPUTS.get(name, [])),
        "## Published", _topics(rows),
        "## Services", _services(module),
        *(("## Actions", _actions(module)) if hasattr(module, "ACTIONS") else ()),
        "## Diagnostics", _diagnostics(text, managed=managed),
        "## Parameters", f"{changes(fixed_of(module), module.CONFIG, when)}. {NAMES}",
        parameters(list(table(module.CONFIG))),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


TYPED = {
    "Dwell": "the dwell and the station of the view, number of captures, temperature, and whether the dwell has `ended`: where that shows after its last view was published, once more with that view's stamp; in place of `dwell`",
    "InspectionVerdict": "verdict, probability, displacement and tolerance of each part; in place of `verdict`",
    "CorrectionProposal": "target, motion, covariance and reason, one message a registration, refused ones too; in place of `verdict`",
    "GapReport": "gap, floor, usual gap and alarm of each view; in place of `report`",
}
SHARED = {
    "scene/markers": "the CAD, one marker a part, by its pixels in the last 20 accepted views: green where they confirm it (less than 5 % contradict the CAD), orange where they contradict it in part (displaced, or partly hidden by what the CAD lacks), red where they contradict most of it (half or more: absent, displaced or hidden), blue where refused views alone show it, grey where none does; `inspect` decides which of these it is; latched",
    "label/path": "poses of the camera as the labels correct them, since the session began; latched",
    "inspect/markers": "the inspected parts: green present, orange displaced, red absent, grey not observable; in the cell's frame, or where no TF has it in the frame in which it is placed; latched",
    "gap/markers": "the parts by their gap: green none, red `live.red_mm` and more, grey not seen; latched, published where a colour changes",
}
PACKED = "`depth` as image_transport compresses it (PNG or RVL, `live.depth_code`, of the inverse depth, 0.1 mm a count at 1 m, up to 10 m); computed only while subscribed"
ACTIONS = {
    "judge": "as `~/judge`, in a process of its own; feedback names each part as its turn comes; a cancelled goal ends at once",
    "propose": "as `~/propose`, with the proposals as its result; a goal that is cancelled during the registration publishes nothing and moves nothing",
    "diagnose": "diagnoses the last `live.views` dwells as `toftwin gap` does a bag, in a process of its own; `out` names the folder of the report, `leave_out` effects not to consider; "
    "feedback names each step with its usual share of the time, again every two seconds; a cancelled goal ends at once",
}


def _actions(module: Any) -> str:
    """The actions of a node."""
    rows = [f"| `~/{name}` | toftwin_msgs/{kind} | {ACTIONS[name]} |" for name, kind in module.ACTIONS.items()]
    about = (
        "One at a time, services included. A goal that cannot be worked on (the node is inactive or busy, there is no view) is aborted, with the reason in the result's `message`. "
        "Where toftwin_msgs is not installed the node says so once and has neither typed topics nor actions."
    )
    return "\n".join([about, "", "| action | type | what |", "|---|---|---|", *rows])


def text_of(name: str) -> NodeText:
    """A node's prose; one that has none here is described by its module's docstring."""
    text = (import_module(NODES[name]).__doc__ or "").partition(":")[2].strip() or name
    return NODE_TEXTS.get(name) or NodeText(
        text.rstrip("."), text, (f"toftwin node {name}", f"ros2 run toftwin {name}"), {}, {}, "its input is missing"
    )


def _type(kind: type[Any]) -> str:
    return f"{kind.__module__.partition('.')[0]}/{kind.__name__}"


def _topics(rows: list[Topic]) -> str:
    return "\n".join(["| topic | type | what |", "|---|---|---|", *(f"| {t.name} | {t.type} | {t.what} |" for t in rows)])


SERVICES = {
    "capture": "end the dwell: the accumulated captures are a view, and the next frame begins another",
    "flush": "publish every frame that is waiting, as at the end of a bag",
    "capture_reference": "store the last dwell as the reference, with which later views are compared",
    "propose": "register the last dwell and publish the correction; the answer is false, with the reason, if nothing is proposed",
    "judge": "decide on every part from the last `live.views` dwells",
    "start_recording": "begin to record a bag in the folder `live.record`",
    "stop_recording": "finish the bag",
}


def services_of(module: Any) -> list[str]:
    """Names of the services that a node's source offers, the base node's included."""
    source = inspect.getsource(module) + inspect.getsource(import_module("tof_ros.base"))
    found = set(re.findall(r"self\.service\(\"(\w+)\"", source))
    return sorted(found | ({"start_recording", "stop_recording"} if "RecordService(" in source else set()))


def _services(module: Any) -> str:
    own = SERVICES | {"reset": reset_of(module)}
    rows = [f"| `~/{name}` | {own[name]} |" for name in services_of(module)]
    return "\n".join(
        [
            "All are `std_srvs/Trigger`; the message of the answer reports what was done, or why not.",
            "",
            "| service | what |",
            "|---|---|",
            *rows,
        ]
    )


def reset_of(module: Any) -> str:
    """What `~/reset` of a node discards: the docstring of its method."""
    nodes = (
        kind for kind in vars(module).values() if inspect.isclass(kind) and kind.__module__ == module.__name__ and "reset" in vars(kind)
    )
    text = (inspect.getdoc(vars(next(nodes))["reset"]) or "").rstrip(".")
    return text[:1].lower() + text[1:]


def fixed_of(module: Any) -> list[str]:
    """Prefixes of the parameters that cannot change while the node runs."""
    found = re.search(r"fixed=\(([^)]*)\)", inspect.getsource(module))
    return re.findall(r"\"([^\"]+)\"", found.group(1)) if found else []


def changes(fixed: list[str], kind: type[Any], when: str) -> str:
    """When the parameters of a node can be changed."""
    if all(i.name.startswith(tuple(fixed)) for i in table(kind)):
        return f"All parameters are set {when}"
    named = ", ".join(f"`{p}`" for p in fixed)
    return f"Parameters that begin with {named} are set {when}; the others can be changed while the node runs (`ros2 param set`) and are checked together"


def _diagnostics(text: NodeText, *, managed: bool) -> str:
    values = TALLY | (STATE if managed else {}) | text.figures
    error = "ERROR while it cannot be configured or activated; " if managed else ""
    return "\n".join(
        [
            f"`/diagnostics`, once a second on the wall clock. Level {error}WARN while frames are skipped or {text.warns}; STALE after 5 s without frames, with topic, publishers, candidates and the flag to pass; that line is logged once, and the first frame after it.",
            "",
            "| value | what |",
            "|---|---|",
            *(f"| `{key}` | {_cell(what)} |" for key, what in values.items()),
        ]
    )


def parameters(rows: list[ParamInfo]) -> str:
    """A table of parameters for each section, which says what its numbers are about."""
    head = ["| parameter | default | unit | bounds | what |", "|---|---|---|---|---|"]
    parts = []
    for group, members in groupby(rows, key=lambda i: (i.group, i.section)):
        name, about = group
        lines = [f"| `{i.name}` | {_default(i.default)} | {i.unit} | {bounds(i)} | {_cell(i.text)} |" for i in members]
        parts += [f"`{name}`{f': {about}' if about else ''}"] if name else []
        parts += ["\n".join([*head, *lines])]
    return "\n\n".join(parts)


def _default(value: float | str) -> str:
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value:g}`"


def bounds(info: ParamInfo) -> str:
    """What values are taken."""
    if info.choices:
        return ", ".join(info.choices)
    low, high = ("" if v is None else f"{v:g}" for v in (info.low, info.high))
    return f"{low} .. {high}".strip() if low or high else ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def nodes_index() -> str:
    """The nodes, and the quality of service of their subscriptions and publishers."""
    listed = "\n".join(f"- [`{name}`]({name}.md): {text_of(name).short}" for name in NODES)
    text = (
        "A reliable subscription receives nothing from a best-effort publisher, a transient-local one nothing from a volatile publisher. When such a peer appears, the node logs "
        "topic, policy, peer and remedy, and repeats them in its diagnostics while the peer exists. `toftwin doctor --live` shows "
        "what each publisher offers and which policy does not match. Every profile can be overridden by `qos_overrides.TOPIC.*` parameters."
    )
    reach = (
        "Nodes started by `ros2 run` and `ros2 launch` have the discovery range of every ROS node. `toftwin node` keeps to this host unless one of `ROS_AUTOMATIC_DISCOVERY_RANGE`, "
        "`ROS_LOCALHOST_ONLY`, `ROS_STATIC_PEERS`, `ROS_DISCOVERY_SERVER`, `CYCLONEDDS_URI` or `ZENOH_SESSION_CONFIG_URI` is set; its first line names the range. A node logs `active, hears ...` "
        "once it has subscribed. `toftwin node --auto` subscribes to the only camera that is published, whatever the names of its topics."
    )
    given = (
        "ROS ignores a parameter that a node does not have. Here `toftwin node --param` refuses it; where it comes from a parameter file, `-p` or a launch file, the node warns in its log and its diagnostics, "
        "with the nearest name. A parameter file that addresses no node of the process (`/preproc`, where the node is `/spot/preproc`) is reported too; `/**/preproc` fits every namespace. "
        "In a launch, whose processes share their files, sections for the other nodes are no fault. Names under `qos_overrides.` are not checked."
    )
    faults = (
        "Faults of a robot, how the nodes handle them, and the tests: [pains and faults](../pains.md). Terms: [glossary](../glossary.md)."
    )
    return f"# Nodes\n\n{MADE}\n\n{listed}\n\n{faults}\n\n## Discovery range\n\n{reach}\n\n## Parameters\n\n{given}\n\n## Quality of service\n\n{text}\n\n{qos_table()}\n"


def qos_table() -> str:
    """One row per kind of topic, from the profiles in use."""
    from tof_ros import qos

    kinds = {
        "sensors, subscribed (`live.reliable: false`, the default)": qos.sensor(depth=32),
        "sensors, subscribed (`live.reliable: true`)": qos.sensor(reliable=True, depth=32),
        "`/tf`, subscribed": qos.TF,
        "`/tf_static`, subscribed": qos.TF_STATIC,
        "results and `/diagnostics`, published; `preproc/*`, subscribed by other nodes": qos.OUTPUT,
    }
    lines = [
        f"| {kind} | {p.reliability.name.lower()} | {p.durability.name.lower()} | {p.history.name.lower()} {p.depth} |"
        for kind, p in kinds.items()
    ]
    return "\n".join(["| topics | reliability | durability | history |", "|---|---|---|---|", *lines])


def commands_page() -> str:
    """Every command with its flags, from the parsers."""
    about = (
        "Exit codes: 0 done, 1 the data do not support a result (with the reason), 2 the call was wrong, 130 stopped with Ctrl-C, 70 a fault in toftwin itself. "
        "With a result, 1 also says that it is not the wished one: `correct` refuses, `inspect` finds a part absent or displaced, `doctor` finds something to correct, "
        "`replay --against` finds a difference, one of several bags of `label` failed. An error is one line: what, where, what to do; "
        "`--debug` shows its traceback. `--settings` prints every number that a command uses; `--config` and `--set` change them. `doctor` has no such numbers. "
        "The numbers of `node` are ROS parameters: `--list-params` prints them, `--params-file` and `--param` change them. Terms: [glossary](glossary.md)."
    )
    return "\n\n".join(["# Commands", MADE, about, *(part for name in command_names() for part in command_parts(name))]) + "\n"


def command_parts(name: str) -> Iterator[str]:
    """One command: what it does, an example, its flags; the bag's flags are listed once, under `doctor`."""
    command = load_command(name)
    yield f"## `toftwin {command.NAME}`"
    yield f"{command.HELP[0].upper()}{command.HELP[1:]}. {command.ABOUT}"
    yield "\n".join(f"    {line.strip()}" for line in command.EXAMPLE.splitlines())
    rows = [row for group in subparser(name)._action_groups for row in _rows(group, name)]  # noqa: SLF001  (argparse has no public access to it)
    yield "\n".join(["| argument | what |", "|---|---|", *rows])


def subparser(name: str) -> argparse.ArgumentParser:
    """The parser of one command."""
    actions = build_parser(name)._actions  # noqa: SLF001
    commands = next(a for a in actions if isinstance(a, argparse._SubParsersAction))  # noqa: SLF001
    parser: argparse.ArgumentParser = commands.choices[name]
    return parser


COMMON = {"help", "debug", "quiet"}


def _rows(group: Any, command: str) -> Iterator[str]:
    if group.title == "the bag" and command != "doctor":
        yield "| `--depth-topic`, ... `--initial-pose` | topics, frames and units of the bag: [as for `doctor`](#toftwin-doctor) |"
        return
    for action in group._group_actions:  # noqa: SLF001
        if action.dest not in COMMON:
            yield f"| `{_shown(action)}` | {_cell(' '.join((action.help or '').split()))} |"


def _shown(action: argparse.Action) -> str:
    value = (
        "" if action.nargs == 0 else action.metavar or (" \\| ".join(map(str, action.choices)) if action.choices else action.dest.upper())
    )
    return " ".join(filter(None, [", ".join(action.option_strings), str(value)]))


def main() -> int:
    """Write the pages."""
    for name, text in pages().items():
        path = DOCS / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(f"docs/{name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
