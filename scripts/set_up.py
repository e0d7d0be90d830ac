# SPDX-License-Identifier: Apache-2.0
"""Make .venv once, with everything pinned: `run` for the commands, `dev` for tests, benchmarks and training too."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

import packages
import ros
import system
import torch_cpu
from progress import SetUpError, Steps

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STATE = VENV / "toftwin-set-up.json"
NEEDED_GB = 5.0
EMBREE_MACHINES = ("x86_64", "AMD64")
"""Where embreex has wheels; elsewhere open3d casts the rays, with all that its wheel asks for (60 packages more)."""
LEVELS = ("run", "dev")
OWN = ("build_interfaces.py", "check_tf.py", "packages.py", "progress.py", "ros.py", "set_up.py", "system.py", "torch_cpu.py")
"""The scripts that set-up runs; the others of that folder change nothing that is installed."""


def identity(ros_source: str) -> str:
    """What a virtual environment cannot survive a change of."""
    return f"{sys.version_info.major}.{sys.version_info.minor} {sys.base_prefix} {ROOT} ros={ros_source}"


def content() -> str:
    """Hash of everything that decides what is installed."""
    digest = hashlib.sha256()
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8").split("\n[tool.", 1)[0]
    digest.update(project.encode())
    scripts = ROOT / "scripts"
    files = [
        ROOT / "constraints.txt",
        *(ROOT / "requirements").glob("*.txt"),
        *(scripts / name for name in OWN),
        *(scripts / "interfaces").rglob("*.*"),
        *(ROOT / "ros_ws" / "src" / "toftwin_msgs").rglob("*.*"),
    ]
    for path in sorted(path for path in files if path.is_file()):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def read_state() -> dict[str, str]:
    """What the last set-up finished; empty when there was none."""
    try:
        state = json.loads(STATE.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return state if isinstance(state, dict) else {}


def is_done(state: dict[str, str], wanted: dict[str, str]) -> bool:
    """Whether an earlier set-up already gives what is wanted; `dev` holds `run`."""
    same = all(state.get(key) == wanted[key] for key in ("identity", "content"))
    return same and state.get("level") in {wanted["level"], "dev"} and (VENV / "bin" / "toftwin").exists()


def make_venv(steps: Steps, ros_source: str) -> None:
    """Create .venv, or keep the one that fits."""
    if read_state().get("identity") == identity(ros_source) and PYTHON.exists():
        steps.note("kept")
        return
    options = ["--system-site-packages"] if ros_source == "sourced" else []
    base = getattr(sys, "_base_executable", None) or sys.executable
    steps.run([base, "-m", "venv", "--clear", *options, str(VENV)])
    STATE.write_text(json.dumps({"identity": identity(ros_source)}), encoding="utf-8")


def check_room() -> None:
    """Refuse before the first download what the disk cannot hold."""
    free = shutil.disk_usage(ROOT).free / 1e9
    if free < NEEDED_GB and not (VENV / "bin" / "toftwin").exists():
        raise SetUpError(f"{ROOT} has {free:.1f} GB free and set-up needs {NEEDED_GB:.0f}: make room, or clone elsewhere")


def install_packages(steps: Steps, *names: str) -> None:
    """Install locks, each file held to its hash."""
    files = [f"requirements/{name}.txt" for name in names]
    packages.install(steps, PYTHON, "--no-deps", "--require-hashes", *(word for file in files for word in ("-r", file)))


def install_toftwin(steps: Steps) -> None:
    """Install this checkout, editable."""
    packages.install(steps, PYTHON, "--no-deps", "--no-build-isolation", "-e", ".")


def locks(ros_source: str) -> list[str]:
    """Names of the locks (scripts/lock.py) that the commands take on this machine."""
    names = ["run"]
    if platform.machine() not in EMBREE_MACHINES:
        names.append("open3d")
    return [*names, "ros"] if ros_source == "pip" else names


def set_up(wanted: dict[str, str], ros_source: str) -> None:
    """All steps in order; each is skipped inside when already done."""
    level = wanted["level"]
    log = ROOT / "out" / "set-up.log"
    steps = Steps(total=8 if level == "dev" else 5, log=log, cwd=ROOT)
    with steps.step("system libraries"):
        system.ensure(steps, build_tools=ros_source == "pip")
    with steps.step("virtual environment"):
        make_venv(steps, ros_source)
    with steps.step("packages (1 GB)"):
        check_room()
        packages.ensure_uv(steps, PYTHON)
        install_packages(steps, *locks(ros_source))
        install_toftwin(steps)
    with steps.beside(
        [str(PYTHON), "scripts/compile_kernels.py", level]
    ) as compiled:  # The steps inside wait for downloads and one compiler.
        if level == "dev":
            with steps.step("packages of tests and benchmarks (2 GB)"):
                install_packages(steps, "dev")
            with steps.step("PyTorch for training, CPU build"):
                torch_cpu.ensure(steps, PYTHON)
            with steps.step("browser for the report test"):
                system.ensure_browser(steps)
        with steps.step("tf2_msgs, toftwin_msgs and a message over DDS"):
            ros.ensure_interfaces(steps, PYTHON, ros_source)
        with steps.step("compiled kernels"):
            compiled()
    shutil.rmtree(VENV / packages.CACHE, ignore_errors=True)
    STATE.write_text(json.dumps(wanted), encoding="utf-8")


def main() -> int:
    """Set up unless done; 0 when .venv is ready, 1 with one line when it is not."""
    level = sys.argv[1] if len(sys.argv) > 1 else "run"
    if level not in LEVELS:
        sys.stderr.write(f"set-up: unknown level {level!r}; choose from {', '.join(LEVELS)}\n")
        return 2
    os.environ.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    started = time.monotonic()
    with Path(__file__).open("rb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two makes at once: the second waits, then finds it done
        try:
            ros_source = ros.source()
            wanted = {"identity": identity(ros_source), "content": content(), "level": level}
            if is_done(read_state(), wanted):
                return 0
            set_up(wanted, ros_source)
        except KeyboardInterrupt:
            sys.stderr.write("\nset-up: stopped; what is installed is kept, run the same make again\n")
            return 130
        except (SetUpError, subprocess.SubprocessError, OSError) as error:
            sys.stderr.write(f"set-up: {error}\n")
            return 1
    print(f"set up in {time.monotonic() - started:.0f} s: .venv/bin/toftwin", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
