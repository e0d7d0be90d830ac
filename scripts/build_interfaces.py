# SPDX-License-Identifier: Apache-2.0
"""Build interface packages into the running virtual environment, where ROS 2 comes from pip: those named, or all that changed."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCES = {
    "tf2_msgs": ROOT / "scripts" / "interfaces" / "tf2_msgs",
    "bond": ROOT / "scripts" / "interfaces" / "bond",
    "toftwin_msgs": ROOT / "ros_ws" / "src" / "toftwin_msgs",
}
"""What no wheel has: the one message of `/tf`, that of a bond to a lifecycle manager, and the messages and actions of the nodes."""
WITHOUT_CPP = ROOT / "scripts" / "interfaces" / "without_cpp.cmake"
PREFIX = Path(sys.prefix)

# The ROS wheels' CMake files name folders that exist only where the wheels were built.
BUILD_MACHINE_NUMPY = re.compile(r"/opt/python/[^\";]+?/numpy/_?core/include")
BUILD_MACHINE_PYTHON = re.compile(r"/opt/python/cp\d+-cp\d+/include/python3\.\d+")


def relocate_cmake_files() -> int:
    """Point the wheels' CMake files at this interpreter's headers; return how many files changed."""
    import numpy as np

    headers, numpy_headers = sysconfig.get_path("include"), np.get_include()
    changed = 0
    for path in (PREFIX / "share").rglob("*.cmake"):
        text = path.read_text(encoding="utf-8", errors="surrogateescape")
        moved = BUILD_MACHINE_NUMPY.sub(lambda _: numpy_headers, text)
        moved = BUILD_MACHINE_PYTHON.sub(lambda _: headers, moved)
        if moved != text:
            path.write_text(moved, encoding="utf-8", errors="surrogateescape")
            changed += 1
    return changed


def build_environment() -> dict[str, str]:
    """The environment in which CMake finds the pip-installed ROS and nothing else."""
    libraries = [str(PREFIX / "lib"), os.environ.get("LD_LIBRARY_PATH", "")]
    return os.environ | {
        "AMENT_PREFIX_PATH": str(PREFIX),
        "CMAKE_PREFIX_PATH": str(PREFIX),
        "LD_LIBRARY_PATH": os.pathsep.join(filter(None, libraries)),
        "PATH": os.pathsep.join([str(PREFIX / "bin"), os.environ["PATH"]]),
    }


def digest(name: str) -> str:
    """Hash of a package's definitions."""
    files = sorted(path for path in SOURCES[name].rglob("*") if path.is_file())
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def built(name: str) -> Path:
    """Where the hash of the definitions that are installed is kept."""
    return PREFIX / "share" / name / "toftwin-built.sha256"


def is_current(name: str) -> bool:
    """Whether what is installed was built from these definitions."""
    return built(name).exists() and built(name).read_text(encoding="ascii") == digest(name)


def build_and_install(name: str) -> None:
    """Configure, build and install one package into the environment's prefix."""
    environment = build_environment()
    with tempfile.TemporaryDirectory(prefix=f"toftwin-{name}-") as build:
        configure = [
            "cmake", "-G", "Ninja", "-S", str(SOURCES[name]), "-B", build,
            f"-DCMAKE_INSTALL_PREFIX={PREFIX}", "-DCMAKE_BUILD_TYPE=Release", "-DBUILD_TESTING=OFF",
            f"-DPython3_EXECUTABLE={sys.executable}", f"-DPYTHON_EXECUTABLE={sys.executable}", f"-DCMAKE_PROJECT_INCLUDE={WITHOUT_CPP}",
        ]  # fmt: skip
        subprocess.run(configure, env=environment, check=True)
        subprocess.run(["cmake", "--build", build, "--target", "install"], env=environment, check=True)
    built(name).write_text(digest(name), encoding="ascii")


def main() -> int:
    """Relocate, build, install; the exit status is 1 when CMake or the compiler failed."""
    sys.stdout.write(f"relocated {relocate_cmake_files()} CMake files\n")
    for name in sys.argv[1:] or [name for name in SOURCES if not is_current(name)]:
        sys.stdout.write(f"{name}\n")
        sys.stdout.flush()
        try:
            build_and_install(name)
        except subprocess.CalledProcessError as error:
            sys.stderr.write(f"{name}: {error}\n")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
