# SPDX-License-Identifier: Apache-2.0
"""Build tf2_msgs into the running virtual environment, where ROS 2 comes from pip and lacks it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

SOURCE = Path(__file__).resolve().parent / "interfaces" / "tf2_msgs"
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


def build_and_install() -> None:
    """Configure, build and install tf2_msgs into the environment's prefix."""
    environment = build_environment()
    with tempfile.TemporaryDirectory(prefix="toftwin-tf2-") as build:
        configure = [
            "cmake", "-G", "Ninja", "-S", str(SOURCE), "-B", build,
            f"-DCMAKE_INSTALL_PREFIX={PREFIX}", "-DCMAKE_BUILD_TYPE=Release", "-DBUILD_TESTING=OFF",
            f"-DPython3_EXECUTABLE={sys.executable}", f"-DPYTHON_EXECUTABLE={sys.executable}",
        ]  # fmt: skip
        subprocess.run(configure, env=environment, check=True)
        subprocess.run(["cmake", "--build", build, "--target", "install"], env=environment, check=True)


def main() -> int:
    """Relocate, build, install; the exit status is 1 when CMake or the compiler failed."""
    sys.stdout.write(f"relocated {relocate_cmake_files()} CMake files\n")
    sys.stdout.flush()
    try:
        build_and_install()
    except subprocess.CalledProcessError as error:
        sys.stderr.write(f"tf2_msgs: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
