# SPDX-License-Identifier: Apache-2.0
"""Parameters that nobody takes: ROS ignores a name that a node does not have, and a parameter file that addresses no node."""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.config import flatten_mapping
from tof_core.errors import ToftwinError, UsageError
from tof_core.yamlio import load_yaml
from toftwin.options import nearest

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

LATER = "qos_overrides."
"""Parameters that a node declares with its topics."""
ANYWAY = ("use_sim_time", "start_type_description_service")
"""Parameters of every ROS node."""
MISSPELT = 0.85
"""Likeness (`difflib`) from which a name is a misspelt one: `live.initial_pos` has 0.97 to its own, `live.scene` 0.76 to its nearest in `preproc`."""


@dataclass(frozen=True, slots=True)
class Addressed:
    """A node that runs: its full name (`/spot/preproc`) and the names of its parameters."""

    full_name: str
    names: tuple[str, ...]

    def has(self, name: str) -> bool:
        """Whether it takes a parameter of this name."""
        return name.startswith(LATER) or name in ANYWAY or name in self.names


@dataclass(frozen=True, slots=True)
class Section:
    """Names of parameters for the nodes that a pattern addresses (`/spot/preproc`, `/**/preproc`, `/**`), and where they were given."""

    where: str
    pattern: str
    names: tuple[str, ...]

    def addresses(self, full_name: str) -> bool:
        """Whether the pattern fits a node: `**` stands for any number of names, `*` for one."""
        tokens = {"**": r"(/\w+)*", "*": r"/\w+"}
        parts = self.pattern.strip("/").split("/")
        return re.fullmatch("".join(tokens.get(part, f"/{re.escape(part)}") for part in parts), full_name) is not None

    @property
    def node(self) -> str:
        """The name of the node, or a wildcard."""
        return self.pattern.rpartition("/")[2]


def refuse_unknown(given: Mapping[str, Any], node: Addressed) -> None:
    """Refuse a `--param` that the node does not have.

    Raises:
        UsageError: it names the nearest parameter.
    """
    for name in given:
        if not node.has(name):
            own = node.full_name.rpartition("/")[2]
            todo = f"did you mean {_meant(name, node)}? 'toftwin node {own} --list-params' lists them"
            raise UsageError(f"{own} has no parameter '{name}'", where="--param", todo=todo)


def sections_of(ros_args: Sequence[str]) -> list[Section]:
    """What follows `--ros-args`: parameter files (`--params-file FILE`), and single parameters (`-p NAME:=VALUE`, `-p NODE:NAME:=VALUE`)."""
    out: list[Section] = []
    for flag, value in pairwise(ros_args):
        if flag == "--params-file":
            try:
                out += _sections(value, load_yaml(Path(value)))
            except ToftwinError:  # ROS reads it too, and refuses it with the line
                continue
        elif flag in ("-p", "--param"):
            node, _, name = value.partition(":=")[0].rpartition(":")
            out.append(Section(flag, f"/**/{node}" if node else "/**", (name,)))
    return out


def _sections(where: str, values: Mapping[str, Any], above: str = "") -> Iterator[Section]:
    for key, below in values.items():
        if key == "ros__parameters":
            yield Section(where, above, tuple(flatten_mapping(below)) if isinstance(below, dict) else ())
        elif isinstance(below, dict):
            yield from _sections(where, below, f"{above}/{str(key).strip('/')}")


def ignored(sections: Sequence[Section], nodes: Sequence[Addressed], elsewhere: Sequence[str] = ()) -> dict[str, list[str]]:
    """What of the given parameters nobody takes: lines for each node, by its full name.

    `elsewhere`: names of nodes that run in other processes with the same files, as `ros2 launch` has them. A section for one of them is
    none of ours, and of a section for all nodes a name is reported only where it is a misspelt one of ours.
    """
    out: dict[str, list[str]] = {node.full_name: [] for node in nodes}
    for node in nodes:
        unknown = [line for s in sections if s.addresses(node.full_name) for line in _unknown(s, node, nodes, elsewhere)]
        if unknown:
            out[node.full_name].append(f"parameters that this node does not have are ignored: {', '.join(unknown)}")
    for file in dict.fromkeys(s.where for s in sections):
        own = [s for s in sections if s.where == file]
        others = all(s.node in elsewhere and not any(n.full_name.endswith(f"/{s.node}") for n in nodes) for s in own)
        if nodes and not others and not any(s.addresses(n.full_name) for s in own for n in nodes):
            running = ", ".join(n.full_name for n in nodes)
            todo = f"name it /**/{nodes[0].full_name.rpartition('/')[2]}, which fits every namespace"
            line = f"a parameter file addresses no node that runs: {file} is for {', '.join(s.pattern for s in own)}, the nodes here are {running}; {todo}"
            out[nodes[0].full_name].append(line)
    return out


def _unknown(section: Section, node: Addressed, nodes: Sequence[Addressed], elsewhere: Sequence[str]) -> Iterator[str]:
    """Names of a section that neither this node has nor another one here that it addresses, with the nearest."""
    taken = [n for n in nodes if section.addresses(n.full_name)]
    for name in section.names:
        if any(n.has(name) for n in taken):
            continue
        shared = elsewhere and section.node in ("*", "**") and not section.where.startswith("-")
        if not shared or get_close_matches(name, node.names, n=1, cutoff=MISSPELT):
            yield f"'{name}' ({section.where}; did you mean {_meant(name, node)}?)"


def _meant(name: str, node: Addressed) -> str:
    """The one parameter that a name misspells, else the nearest ones, in words."""
    alike = get_close_matches(name, node.names, n=1, cutoff=MISSPELT)
    return alike[0] if alike else nearest(name, node.names)
