# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from the configuration table: described, bounded, changed as a whole or not at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from tof_core import config
from tof_core.config import param, section
from tof_core.errors import ConfigError

rclpy = pytest.importorskip("rclpy", reason="no ROS 2 here")
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.node import Node

pytestmark = pytest.mark.dds


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage."""

    enable: bool = param(True, "whether it runs")
    ratio: float = param(2.0, "how many deviations", low=0.1, high=20.0)
    count: int = param(20, "how many", low=2)


@dataclass(frozen=True, slots=True)
class Settings:
    """A node's settings; `low` must stay under `high`."""

    scene: str = param("box", "which scene")
    mode: str = param("mean", "how", choices=("mean", "median"))
    low: float = param(0.1, "least depth", unit="m")
    high: float = param(1.0, "largest depth", unit="m")
    stage: Stage = section(Stage)

    def __post_init__(self) -> None:
        """Refuse an empty range."""
        if self.low >= self.high:
            raise ConfigError("low is not below high")


@pytest.fixture
def make_node(ros_domain: int) -> Iterator[Callable[..., Node]]:
    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        nodes = []

        def make(**values: object) -> Node:
            from rclpy.parameter import Parameter

            overrides = [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]
            nodes.append(rclpy.create_node("settings", context=context, parameter_overrides=overrides))
            return nodes[-1]

        yield make
        for node in nodes:
            node.destroy_node()


def test_a_descriptor_tells_text_unit_bounds_and_choices() -> None:
    from tof_ros.parameters import descriptor

    rows = {info.name: descriptor(info) for info in config.table(Settings)}
    assert rows["low"].description == "least depth [m]"
    assert rows["mode"].additional_constraints == "one of mean, median"
    ratio = rows["stage.ratio"].floating_point_range[0]
    assert (ratio.from_value, ratio.to_value) == (0.1, 20.0)
    count = rows["stage.count"].integer_range[0]
    assert (count.from_value, count.to_value) == (2, 2**63 - 1)


def test_start_values_become_the_configuration(make_node: Callable[..., Node]) -> None:
    from tof_ros.parameters import Parameters

    node = make_node(stage__ratio=3.5, mode="median")
    assert Parameters(node, Settings).config == Settings(mode="median", stage=Stage(ratio=3.5))


@pytest.mark.parametrize("bad", [{"stage__ratio": 99.0}, {"mode": "mode"}, {"low": 2.0}, {"stage__enable": 3}])
def test_bad_start_values_are_refused(make_node: Callable[..., Node], bad: dict[str, object]) -> None:
    from tof_ros.parameters import Parameters

    with pytest.raises(ConfigError):
        Parameters(make_node(**bad), Settings)


def test_a_live_change_is_taken_as_a_whole_or_not_at_all(make_node: Callable[..., Node]) -> None:
    from rclpy.parameter import Parameter

    from tof_ros.parameters import Parameters

    node = make_node()
    seen: list[Settings] = []
    parameters = Parameters(node, Settings, on_change=seen.append)
    moved = node.set_parameters_atomically([Parameter("low", value=2.0), Parameter("high", value=3.0)])
    assert moved.successful
    assert (parameters.config.low, parameters.config.high) == (2.0, 3.0)
    refused = node.set_parameters_atomically([Parameter("stage.count", value=50), Parameter("low", value=4.0)])
    assert not refused.successful
    assert "low is not below high" in refused.reason
    assert parameters.config.stage.count == 20
    assert seen == [parameters.config]


def test_an_integer_is_taken_for_a_float(make_node: Callable[..., Node]) -> None:
    from rclpy.parameter import Parameter

    from tof_ros.parameters import Parameters

    node = make_node()
    parameters = Parameters(node, Settings)
    assert node.set_parameters([Parameter("stage.ratio", value=3)])[0].successful
    assert parameters.config.stage.ratio == 3.0


def test_out_of_bounds_and_fixed_parameters_are_refused_live(make_node: Callable[..., Node]) -> None:
    from rclpy.parameter import Parameter

    from tof_ros.parameters import Parameters

    node = make_node()
    parameters = Parameters(node, Settings, fixed=("scene",))
    results = node.set_parameters(
        [Parameter("stage.ratio", value=21.0), Parameter("scene", value="tray"), Parameter("stage.count", value=1)]
    )
    assert [r.successful for r in results] == [False, False, False]
    assert parameters.config == Settings()


def test_the_parameter_file_holds_every_row_with_its_meaning() -> None:
    import yaml

    from tof_ros.parameters import parameter_yaml

    text = parameter_yaml("preproc", Settings)
    assert yaml.safe_load(text) == {"/**/preproc": {"ros__parameters": config.flatten(Settings())}}
    assert "# least depth [m]" in text
