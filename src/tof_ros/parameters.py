# SPDX-License-Identifier: Apache-2.0
"""ROS parameters made from a configuration's table: declared with text, unit and bounds, changed live and as a whole."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException

from tof_core import config
from tof_core.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rclpy.node import Node
    from rclpy.parameter import Parameter

C = TypeVar("C")


def descriptor(info: config.ParamInfo, *, read_only: bool = False) -> ParameterDescriptor:
    """What `ros2 param describe` shows of one row of the table."""
    unit = f" [{info.unit}]" if info.unit else ""
    out = ParameterDescriptor(name=info.name, description=info.meaning + unit, read_only=read_only, dynamic_typing=True)
    if info.choices:
        out.additional_constraints = "one of " + ", ".join(info.choices)
    if info.low is not None or info.high is not None:
        _set_range(out, info)
    return out


def _set_range(out: ParameterDescriptor, info: config.ParamInfo) -> None:
    if info.kind is float:
        low = -sys.float_info.max if info.low is None else float(info.low)
        high = sys.float_info.max if info.high is None else float(info.high)
        out.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    elif info.kind is int:
        low_i = -(2**63) if info.low is None else int(info.low)
        high_i = 2**63 - 1 if info.high is None else int(info.high)
        out.integer_range = [IntegerRange(from_value=low_i, to_value=high_i, step=1)]


class Parameters(Generic[C]):
    """The configuration of a node: `.config` is always whole and valid.

    A change is checked as a whole before it is accepted and swapped in afterwards, so no frame
    ever sees half of it. Names in `fixed` (or groups, `scene.`) can be given at the start only, or, with `locked`,
    whenever that says no.
    """

    def __init__(
        self,
        node: Node,
        cls: type[C],
        *,
        fixed: Iterable[str] = (),
        locked: Callable[[], bool] | None = None,
        on_change: Callable[[C], None] | None = None,
    ) -> None:
        """Declare every row of the table on `node`; bad start values are a `ConfigError`."""
        self._cls, self._node, self._on_change = cls, node, on_change
        self._infos = {info.name: info for info in config.table(cls)}
        self._fixed, self._locked = tuple(fixed), locked
        read_only = self._fixed if locked is None else ()
        values = {name: self._declare(info, read_only=name.startswith(read_only)) for name, info in self._infos.items()}
        self.config: C = config.from_mapping(cls, values, where=node.get_name())
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._swap)

    def _declare(self, info: config.ParamInfo, *, read_only: bool) -> Any:
        try:
            return self._node.declare_parameter(info.name, info.default, descriptor(info, read_only=read_only)).value
        except ParameterException as error:
            raise ConfigError(str(error), where=f"{self._node.get_name()}.{info.name}") from error

    def _changed(self, parameters: Sequence[Parameter]) -> C | None:
        ours = {p.name: p.value for p in parameters if p.name in self._infos}
        if not ours:
            return None
        return config.from_mapping(self._cls, {**config.flatten(self.config), **ours}, where=self._node.get_name())

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            changed = self._changed(parameters)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        held = [p.name for p in parameters if p.name in self._infos and p.name.startswith(self._fixed)]
        if held and changed != self.config and self._locked is not None and self._locked():
            return SetParametersResult(successful=False, reason=f"{held[0]} can be set while the node is unconfigured; clean it up first")
        return SetParametersResult(successful=True)

    def _swap(self, parameters: Sequence[Parameter]) -> None:
        changed = self._changed(parameters)
        if changed is None or changed == self.config:
            return
        self.config = changed
        if self._on_change is not None:
            self._on_change(changed)


def parameter_yaml(name: str, cls: type[Any]) -> str:
    """The parameter file of a node: every value at its default, its meaning as a comment."""
    lines = [f"/**/{name}:", "  ros__parameters:"]
    for info in config.table(cls):
        unit = f" [{info.unit}]" if info.unit else ""
        lines += [f"    # {info.meaning}{unit}", f"    {info.name}: {_yaml(info.default)}"]
    return "\n".join(lines) + "\n"


def _yaml(value: float | str) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)
