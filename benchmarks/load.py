# SPDX-License-Identifier: Apache-2.0
"""What a running graph is given in a long run: cameras, their size and rate, the nodes that run for each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from benchmarks.looped_camera import ROOMS
from benchmarks.recorded import FOLDER, recorded
from benchmarks.untrained import untrained
from tof_core.camera import Camera
from toftwin.graph import GraphSpec

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

SCENE = "body_section"
SESSION = {"plan": {"views": 12, "stations": 3, "captures": 30, "move_s": 0.1}, "seed": 4}
"""12 dwells of two seconds, a tenth of a second between them."""
NODES = ("preproc", "sim_label", "infer")
STOCK = (224, 171)
"""Columns and rows of Spot's hand camera, for which the network that is shipped was made."""


def specs(scene: str, namespace: str = "", given: Mapping[str, Mapping[str, Any]] | None = None) -> list[GraphSpec]:
    """Preprocessing, labels and the network, each frame heard reliably; one process a node, as `ros2 launch` starts them.

    `given`: further parameters by node.
    """
    patient = {"live.patience_s": 10.0}
    parameters: dict[str, dict[str, Any]] = {
        "preproc": {**patient, "live.reliable": True},
        "sim_label": {**patient, "live.scene": scene},
        "infer": {**patient, "live.reliable": True, "infer.threads": 1},
    }
    return [
        GraphSpec((name,), {name: {**values, **(given or {}).get(name, {})}}, namespace=namespace, strict=True)
        for name, values in parameters.items()
    ]


@dataclass(frozen=True, slots=True)
class Load:
    """What the graph is given: so many equal cameras, their size in pixels and their rate; and which nodes run for each."""

    hz: float = 15.0
    width: int = 224
    height: int = 171
    cameras: int = 1
    nodes: tuple[str, ...] = NODES
    label_share: float = 0.0
    """`live.share` of sim_label: above 0 not every dwell has a label."""
    view_every: int = 1
    """`live.view_every` of preproc: other than 1 not every capture has a view of its own."""
    recipe: str = "default"
    """Recipe of `toftwin train` by which infer's network was made; one that is not in the package has untrained weights."""
    together: bool = False
    """The nodes of a camera run in one process, as `toftwin node` and `ros2 launch` with `together:=true` start them."""

    def __str__(self) -> str:
        """In a few words."""
        one = f"{self.width}x{self.height} at {self.hz:g} Hz"
        views = {0: ", a view a dwell", 1: ""}.get(self.view_every, f", a view every {self.view_every} captures")
        labels = f", labels in at most {self.label_share:.0%} of a core" if self.label_share else ""
        network = "" if self.recipe == "default" else f", network of --recipe {self.recipe}"
        process = ", one process a camera" if self.together else ""
        cameras = "" if self.cameras == 1 else f"{self.cameras} cameras of "
        return f"{cameras}{one}{views}{labels}{network}{process}"

    @property
    def rooms(self) -> tuple[str, ...]:
        """Under which the nodes publish."""
        return tuple(ROOMS[NODES.index(name)] for name in self.nodes)

    @property
    def parts(self) -> tuple[str, ...]:
        """The processes of a camera, by the room that each serves."""
        return ("graph",) if self.together else self.rooms

    @property
    def stock(self) -> bool:
        """One camera as Spot's hand has it, before the whole graph."""
        return self == replace(Load(), hz=self.hz)

    @property
    def lowest_hz(self) -> float:
        """Where the search for the highest rate begins."""
        return Load().hz if self.stock else 0.0

    @property
    def section(self) -> str:
        """Of docs/figures.md."""
        nodes = "" if self.nodes == NODES else f"_{'_'.join(self.nodes)}"
        share = f"_share{self.label_share:g}" if self.label_share else ""
        views = f"_every{self.view_every}" if self.view_every != 1 else ""
        recipe = "" if self.recipe == "default" else f"_{self.recipe}"
        together = "_together" if self.together else ""
        return "soak" if self == Load() else f"soak_{self.cameras}_{self.width}x{self.height}{nodes}{views}{share}{recipe}{together}"

    @property
    def flags(self) -> str:
        """Of the command that gives this load."""
        nodes = "" if self.nodes == NODES else f" --nodes {','.join(self.nodes)}"
        views = f" --view-every {self.view_every}" if self.view_every != 1 else ""
        share = f" --label-share {self.label_share:g}" if self.label_share else ""
        recipe = "" if self.recipe == "default" else f" --recipe {self.recipe}"
        together = " --together" if self.together else ""
        camera = f" --cameras {self.cameras} --size {self.width}x{self.height} --hz {self.hz:g}"
        return "" if self == Load() else f"{camera}{nodes}{views}{share}{recipe}{together}"

    @property
    def namespaces(self) -> tuple[str, ...]:
        """One graph each; a single camera is in none."""
        return ("",) if self.cameras == 1 else tuple(f"camera{number}" for number in range(self.cameras))

    def bag(self) -> Path:
        """The session that the cameras play."""
        stock = (self.width, self.height) == STOCK
        return recorded(SCENE, SESSION if stock else {**SESSION, "camera": {"width": self.width, "height": self.height}}).bag

    @property
    def model(self) -> str:
        """Network of infer: that of the package, or one of this recipe with untrained weights."""
        if self.recipe == "default":
            return "default"
        camera = Camera(self.width, self.height, self.width, self.width, (self.width - 1) / 2, (self.height - 1) / 2)
        return str(untrained(self.recipe, camera, FOLDER / f"{self.recipe}_{self.width}x{self.height}.onnx"))

    def specs(self) -> list[GraphSpec]:
        """The nodes of every camera. A network made for another camera is asked all the same: it takes the same time."""
        given: dict[str, dict[str, Any]] = {
            "preproc": {"live.view_every": self.view_every},
            "sim_label": {"live.share": self.label_share},
            "infer": {"infer.force": (self.width, self.height) != STOCK, "infer.model": self.model},
        }
        found = [[spec for spec in specs(SCENE, name, given) if spec.nodes[0] in self.nodes] for name in self.namespaces]
        return [spec for each in found for spec in ([joined(each)] if self.together else each)]


def joined(each: list[GraphSpec]) -> GraphSpec:
    """The nodes of several processes in one."""
    parameters = {name: values for spec in each for name, values in spec.parameters.items()}
    return replace(each[0], nodes=tuple(name for spec in each for name in spec.nodes), parameters=parameters)


STOCK_LOAD = Load()
