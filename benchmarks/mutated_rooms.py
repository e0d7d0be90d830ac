# SPDX-License-Identifier: Apache-2.0
"""What `make mutate` changes, room by room: the functions that decide, the tests that should notice, and the share that must be found."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Room:
    """`functions`: of each module those that decide (none: all); `tests`: what should notice; `bar`: percent to be found."""

    functions: dict[str, tuple[str, ...]]
    tests: tuple[str, ...]
    bar: float = 85.0


ROOMS = {
    "limits": Room(  # what releases a motion of the arm: every fault must be found
        {
            "arm_correction.correction": ("verdict", "_refusal", "_moved", "_disagreement"),
            "arm_correction.corrector": ("twin_of",),
            "arm_correction.live": ("driver_frame",),
        },
        ("tests/arm_correction/test_limits.py",),
        bar=100.0,
    ),
    "correction": Room(
        {
            "arm_correction.correction": ("propose", "step"),
            "arm_correction.unknown": (),
            "arm_correction.register": ("judge",),
        },
        (
            "tests/arm_correction/test_limits.py",
            "tests/arm_correction/test_correction.py",
            "tests/arm_correction/test_register.py",
        ),
    ),
    "inspection": Room(
        {
            "tof_inspect.judge": ("decide", "probability", "of", "_part", "inspect"),
            "tof_inspect.evidence": (),
        },
        ("tests/tof_inspect/test_deciding.py", "tests/tof_inspect/test_judge.py"),
    ),
    "core": Room(
        {
            "tof_core.motion": (),
            "tof_core.edge": (),
            "tof_core.tf": (),
            "tof_core.png": (),
            "tof_core.npz": (),
            "tof_core.unpack": ("unpack", "unzstd", "_count"),
        },
        (
            "tests/tof_core/test_tf.py",
            "tests/tof_core/test_motion.py",
            "tests/tof_core/test_bounded.py",
        ),
    ),
    "label": Room(
        {"tof_sim_label.gate": (), "tof_sim_label.sigma": ()},
        ("tests/tof_sim_label/test_gate.py", "tests/tof_sim_label/test_sigma.py"),
    ),
    "network": Room({"tof_infer.honesty": ()}, ("tests/tof_infer/test_honesty.py",)),
}
