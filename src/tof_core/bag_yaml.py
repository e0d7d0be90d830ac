# SPDX-License-Identifier: Apache-2.0
"""The YAML of bags, read and written by libyaml: rosbags' own library takes as long for it as for a second of frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml

from tof_core.errors import ConfigError
from tof_core.yamlio import yaml_values

if TYPE_CHECKING:
    from typing import IO

DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class BagYaml:
    """Stands for `ruamel.yaml.YAML` in rosbags: the same values, within the limits of `yamlio`."""

    def __init__(self, typ: str = "safe") -> None:
        """Plain values only, whatever `typ` is."""
        self.typ = typ
        self.default_flow_style: bool | None = None

    def load(self, text: str) -> Any:
        """The values of a text, such as `metadata.yaml` or the QoS of a topic; an error is one that rosbags expects."""
        from ruamel.yaml.error import YAMLError

        try:
            return yaml_values(text, where="line")
        except ConfigError as error:
            raise YAMLError(f"{error.what} ({error.where})") from None

    def dump(self, values: object, stream: IO[str]) -> None:
        """Write plain values, keys sorted."""
        yaml.dump(values, stream, Dumper=DUMPER, default_flow_style=self.default_flow_style)


def use_libyaml() -> None:
    """Let rosbags read and write its YAML by `BagYaml`."""
    from rosbags.rosbag2 import metadata, reader, writer

    for module in (metadata, reader, writer):
        vars(module)["YAML"] = BagYaml
