# SPDX-License-Identifier: Apache-2.0
"""Write the bringup package's parameter file from the nodes' typed configuration: `.venv/bin/python scripts/make_params.py`."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

from tof_ros.parameters import parameter_yaml
from toftwin.graph import NODES

FILE = Path(__file__).resolve().parent.parent / "ros_ws" / "src" / "toftwin_bringup" / "config" / "graph.yaml"
HEAD = """# SPDX-License-Identifier: Apache-2.0
# Made by scripts/make_params.py from the nodes' configuration; every value is the default. Copy it, change it, pass params_file:=.
"""


def text() -> str:
    """What the file must hold."""
    return HEAD + "\n".join(parameter_yaml(name, import_module(module).CONFIG) for name, module in NODES.items())


def main() -> int:
    """Write the file."""
    FILE.write_text(text(), encoding="utf-8")
    print(f"{FILE.name}: {len(NODES)} nodes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
