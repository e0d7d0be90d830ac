# SPDX-License-Identifier: Apache-2.0
"""System libraries that pip's wheels expect: installed where that is allowed, else the one line to type."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

from progress import SetUpError, Steps

# What open3d's wheel links and does not bring, and numba's and scikit-learn's OpenMP.
LIBRARIES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
    "libidn2.so.0": "libidn2-0",
    "libudev.so.1": "libudev1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def missing_packages(*, build_tools: bool) -> list[str]:
    """Debian packages that this machine lacks; `build_tools` are what building interface packages takes."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    missing = [package for library, package in LIBRARIES.items() if not loads(library)]
    if importlib.util.find_spec("ensurepip") is None:
        missing.append(f"{version}-venv")
    if build_tools and shutil.which("g++") is None:
        missing.append("g++")
    if build_tools and not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        missing.append(f"{version}-dev")
    return sorted(missing)


def loads(library: str) -> bool:
    """Whether the dynamic linker finds a library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


NO_SUDO = "TOFTWIN_NO_SUDO"
"""Environment variable: any value keeps set-up from using sudo."""
TIME_TO_REFUSE_S = 5.0
"""Pause between the line that announces sudo and its use, where somebody sits at a terminal."""


def privilege() -> list[str] | None:
    """What to put before apt-get: nothing for root, sudo where it asks no password, None where it may not run."""
    if shutil.which("apt-get") is None:
        return None
    if os.geteuid() == 0:
        return []
    if os.environ.get(NO_SUDO):
        return None
    if shutil.which("sudo") and subprocess.run(["sudo", "-n", "true"], check=False, capture_output=True).returncode == 0:
        return ["sudo", "-n"]
    return None


def ensure(steps: Steps, *, build_tools: bool) -> None:
    """Install what is missing, or say the line that does."""
    missing = missing_packages(build_tools=build_tools)
    if not missing:
        steps.note("all there")
        return
    line = f"apt-get install -y --no-install-recommends {' '.join(missing)}"
    before = privilege()
    if before is None:
        raise SetUpError(f"system libraries are missing and may not be installed from here; type: sudo {line}")
    apt_install(steps, before, missing)
    if still := missing_packages(build_tools=build_tools):
        raise SetUpError(f"apt-get ran, yet this is still missing: {' '.join(still)}; type: sudo {line}")
    steps.note(f"installed {' '.join(missing)}")


def apt_install(steps: Steps, before: list[str], packages: list[str], *, quiet_failure: bool = False) -> bool:
    """Refresh apt's lists and install, with sudo only after a line that says so; True when it worked."""
    if before:
        steps.announce(f"sudo apt-get will install {' '.join(packages)}; to refuse: Ctrl-C, then make again with {NO_SUDO}=1")
        if steps.is_terminal:
            time.sleep(TIME_TO_REFUSE_S)
    steps.run([*before, "apt-get", "update", "-q"], quiet_failure=True)
    command = [*before, "apt-get", "-o", "DPkg::Lock::Timeout=120", "install", "-y", "-q", "--no-install-recommends", *packages]
    return steps.run(command, quiet_failure=quiet_failure)


def ensure_browser(steps: Steps) -> None:
    """Chromium for the one test that opens the report; without it that test is skipped and says so."""
    if found := next(filter(shutil.which, BROWSERS), None):
        steps.note(found)
        return
    before = privilege()
    # Ubuntu's package of that name only asks for a snap, which a server or a container does not have.
    is_ubuntu = "ubuntu" in Path("/etc/os-release").read_text(encoding="utf-8").lower() if Path("/etc/os-release").exists() else False
    if before is not None and not is_ubuntu and apt_install(steps, before, ["chromium"], quiet_failure=True):
        steps.note("installed chromium")
        return
    steps.note("none found, the report test will be skipped; to have it: install Chromium or Chrome")
