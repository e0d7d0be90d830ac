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
    "align": Room(
        {
            "tof_align.verdict": (),
            "tof_align.robust": (),
            "tof_align.observability": (),
            "tof_align.parts": (),
            "tof_align.approach": (),
            "tof_align.system": ("camera_step", "camera_cov", "stand_off", "without_each_part"),
            "tof_align.single": ("_conclude",),
            "tof_align.session": ("_conclude", "_keep", "_disputed"),
        },
        tuple(
            f"tests/tof_align/test_{name}.py"
            for name in (
                "verdict",
                "robust",
                "observability",
                "parts",
                "approaching",
                "approach",
                "concluding",
                "system",
                "single",
                "session",
            )
        ),
    ),
    "gap": Room(
        {
            "tof_gap.solve.choose.select": (),
            "tof_gap.solve.choose.judge": (),
            "tof_gap.solve.choose.small": (),
            "tof_gap.solve.choose.ties": (),
            "tof_gap.solve.choose.worth": (),
            "tof_gap.solve.causes": ("confidence", "smooth_ones"),
            "tof_gap.solve.confirmed": (),
            "tof_gap.solve.tolerance": (),
            "tof_gap.tell.account": (),
            "tof_gap.tell.diagnosis": (),
            "tof_gap.tell.figures.floor": (),
            "tof_gap.tell.figures.shrink": (),
        },
        (
            *(f"tests/tof_gap/solve/choose/test_{name}.py" for name in ("choosing", "ties", "scores", "select")),
            *(f"tests/tof_gap/solve/test_{name}.py" for name in ("confirmed", "tolerance")),
            *(f"tests/tof_gap/tell/test_{name}.py" for name in ("account", "told")),
            *(f"tests/tof_gap/tell/figures/test_{name}.py" for name in ("sums", "shrink", "floor")),
        ),
    ),
    "correction": Room(
        {
            "arm_correction.correction": ("propose", "step"),
            "arm_correction.unknown": (),
            "arm_correction.register": ("judge",),
            "arm_correction.bias": (),
            "arm_correction.reference": ("check", "check_scene"),
        },
        (
            *(f"tests/arm_correction/test_{name}.py" for name in ("limits", "correction", "verdict", "unknown", "reference")),
            "tests/arm_correction/test_bias.py::test_the_size_of_the_bias_is_what_the_residuals_state",
        ),
    ),
    "inspection": Room(
        {
            "tof_inspect.judge": (),
            "tof_inspect.evidence": (),
            "tof_inspect.displaced": (),
            "tof_inspect.place": (),
        },
        tuple(f"tests/tof_inspect/test_{name}.py" for name in ("deciding", "inspector", "judge", "evidence", "place", "displaced")),
    ),
    "core": Room(
        {
            "tof_core.motion": (),
            "tof_core.edge": (),
            "tof_core.tf": (),
            "tof_core.png": (),
            "tof_core.npz": (),
            "tof_core.unpack": ("unpack", "unzstd", "_count"),
            "tof_core.stats": (),
            "tof_core.se3": (),
        },
        tuple(f"tests/tof_core/test_{name}.py" for name in ("edge", "tf", "motion", "bounded", "unpack", "stats", "se3")),
    ),
    "label": Room(
        {"tof_sim_label.gate": (), "tof_sim_label.sigma": (), "tof_sim_label.label": (), "tof_sim_label.split": ()},
        tuple(f"tests/tof_sim_label/test_{name}.py" for name in ("gate", "sigma", "label", "split")),
    ),
    "network": Room(
        {"tof_infer.sigma_calibration": (), "tof_infer.validate": ()},
        ("tests/tof_infer/test_sigma_calibration.py", "tests/tof_infer/test_validate.py"),
    ),
}
