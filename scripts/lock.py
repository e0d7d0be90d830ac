# SPDX-License-Identifier: Apache-2.0
"""`python scripts/lock.py`: requirements/*.txt, every package with the hashes of all its files; versions are those of constraints.txt.

Takes `uv`, which set-up installs. One lock holds for Python 3.11 and 3.12 and for every machine that the packages have wheels for.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "requirements"
HEAD = "# Made by scripts/lock.py from pyproject.toml and constraints.txt; installed with pip --require-hashes --no-deps.\n"
LOCKS: dict[str, tuple[bool, tuple[str, ...]]] = {
    "run": (True, ()),
    "open3d": (False, ("open3d",)),
    "dev": (True, ("open3d", "view", "dev", "bench")),
    "ros": (False, ("ros", "ros-build")),
    "uv": (False, ("set-up",)),
}
"""By name: whether toftwin's own dependencies are in it, and which extras."""
PYTHON = "3.11"
"""The oldest; `--universal` resolves for all later ones that pyproject.toml allows."""


def wanted(name: str) -> list[str]:
    """Requirements of a lock, from pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    own, extras = LOCKS[name]
    lines = [*project["project"]["dependencies"], *project["build-system"]["requires"]] if own else []
    lines += [line for extra in extras for line in project["project"]["optional-dependencies"][extra]]
    return [line for line in lines if not line.startswith("toftwin[")]


def lock(name: str) -> int:
    """Write one lock; gives how many packages it has."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "in.txt", Path(folder) / "out.txt"
        source.write_text("\n".join(wanted(name)) + "\n", encoding="utf-8")
        options = ["--universal", "--generate-hashes", "--no-header", "--no-annotate", "--python-version", PYTHON, "-q"]
        command = [sys.executable, "-m", "uv", "pip", "compile", str(source), "-c", "constraints.txt", *options, "-o", str(out)]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        text = out.read_text(encoding="utf-8")
    (FOLDER / f"{name}.txt").write_text(HEAD + text, encoding="utf-8")
    return len(re.findall(r"^\S+==", text, re.MULTILINE))


def main() -> int:
    """Write all locks."""
    FOLDER.mkdir(exist_ok=True)
    for name in LOCKS:
        print(f"requirements/{name}.txt: {lock(name)} packages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
