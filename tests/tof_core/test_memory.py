# SPDX-License-Identifier: Apache-2.0
"""Freed images are kept for the next ones, or given back to the system, in the processes that ask for it."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import pytest

CODE = """
import resource
import numpy as np
from tof_core.memory import keep_freed
if {kept} and not keep_freed():
    raise SystemExit("no glibc")
def frame():
    return [np.ones((576, 640), np.float32) for _ in range(12)]
frame()
frame()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    frame()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def faults(*, kept: bool) -> int:
    """Page faults of ten frames of twelve images each, freed before the next frame."""
    done = subprocess.run([sys.executable, "-c", CODE.format(kept=kept)], capture_output=True, text=True, check=False)
    if "no glibc" in done.stderr:
        pytest.skip("no glibc")
    return int(done.stdout)


def test_a_frame_takes_the_memory_of_the_one_before() -> None:
    assert faults(kept=True) < 100
    assert faults(kept=False) > faults(kept=True) + 100


FREED_MB = 200
HELD = f"""
import numpy as np
from tof_core.memory import give_back

def resident_mb():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

arrays = [np.ones(100_000, np.uint8) for _ in range({FREED_MB} * 10)]
last = arrays[-1]
del arrays
before = resident_mb()
give_back()
print(before - resident_mb())
"""
"""Arrays that glibc takes from its heap, whose end the last one holds."""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="the C library is not glibc")
def test_freed_arrays_leave_the_process() -> None:
    done = subprocess.run([sys.executable, "-c", HELD], check=True, capture_output=True, text=True)
    assert float(done.stdout) > 0.9 * FREED_MB


ONE_HEAP = f"""
import threading
import numpy as np
from tof_core.memory import one_heap

def resident_mb():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

def arrays():
    return [np.ones(100_000, np.uint8) for _ in range({FREED_MB} * 10)]

def work():
    global last
    every = arrays()
    last = every[-1]

if {{one}}:
    one_heap()
thread = threading.Thread(target=work)
thread.start()
thread.join()
before = resident_mb()
again = arrays()
print(resident_mb() - before)
"""
"""Arrays that a thread has freed, and as many of the main thread."""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="the C library is not glibc")
def test_what_a_thread_has_freed_serves_the_others() -> None:
    more = [
        float(subprocess.run([sys.executable, "-c", ONE_HEAP.format(one=one)], check=True, capture_output=True, text=True).stdout)
        for one in (True, False)
    ]
    assert more[0] < 0.2 * FREED_MB
    assert more[1] > 0.8 * FREED_MB
