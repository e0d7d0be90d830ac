# SPDX-License-Identifier: Apache-2.0
"""Scores as text tables for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tof_core.metrics import DepthError
    from tof_eval.sessions import PoseErrors


def methods_table(methods: Mapping[str, Any]) -> str:
    """One line per method, over all views."""
    lines = [
        f"{'method':<14}{'MAE mm':>9}{'bias mm':>9}{'RMSE mm':>9}{'complete %':>12}{'align %':>9}{'equal cov. MAE':>16}{'flying left %':>15}{'ms':>8}"
    ]
    for name, m in methods.items():
        a = m["all"]
        lines.append(
            f"{name:<14}{_n(a['mae_mm']):>9}{_n(a['bias_mm']):>9}{_n(a['rmse_mm']):>9}{_p(a['completeness']):>12}{_n(a['alignment'], 3):>9}"
            f"{_n(m['equal_coverage']['mae_mm']):>16}{_p(m['flying_left_wrong']):>15}{_n(m['ms_per_frame'], 1):>8}"
        )
    return "\n".join(lines)


def captures_table(methods: Mapping[str, Any]) -> str:
    """The paper's figure 9: alignment rate of every capture."""
    lines = [
        "alignment rate per capture, at equal coverage (the paper's figure 9)",
        f"{'capture':<10}" + "".join(f"{n:>12}" for n in methods),
    ]
    rows = zip(*(m["captures_equal_coverage"] for m in methods.values()), strict=True)
    return "\n".join([*lines, *(f"{k:<10}" + "".join(f"{_n(c['alignment'], 3):>12}" for c in row) for k, row in enumerate(rows, 1))])


def depth_table(rows: Iterable[tuple[str, DepthError]]) -> str:
    """One line per row: errors, completeness, alignment rate, pixels."""
    head = f"{'depth':<28}{'MAE mm':>9}{'RMSE mm':>9}{'bias mm':>9}{'complete %':>12}{'alignment %':>13}{'pixels':>12}"
    lines = [
        f"{name:<28}{1e3 * e.mae:>9.2f}{1e3 * e.rmse:>9.2f}{1e3 * e.bias:>+9.2f}{_p(e.completeness):>12}{e.alignment:>13.2f}{e.pixels:>12,}"
        for name, e in rows
    ]
    return "\n".join([head, *lines])


def pose_table(poses: Sequence[PoseErrors]) -> str:
    """One line per pose estimate: median and largest error over the views."""
    head = f"{'pose of the camera':<28}{'median mm':>10}{'max mm':>9}{'median deg':>12}{'max deg':>9}"
    lines = [
        f"{p.name:<28}{np.median(p.millimetres):>10.2f}{p.millimetres.max():>9.2f}{np.median(p.degrees):>12.3f}{p.degrees.max():>9.3f}"
        for p in poses
    ]
    return "\n".join([head, *lines])


def _n(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _p(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"
