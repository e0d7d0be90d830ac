# SPDX-License-Identifier: Apache-2.0
"""An evaluation as text for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


def methods_table(methods: Mapping[str, Any]) -> str:
    """One line a method, over all views."""
    lines = [
        f"{'method':<14}{'MAE mm':>9}{'bias mm':>9}{'RMSE mm':>9}{'complete':>10}{'align %':>9}{'equal cov. MAE':>16}{'flying left':>13}{'ms':>8}"
    ]
    for name, m in methods.items():
        a = m["all"]
        lines.append(
            f"{name:<14}{_n(a['mae_mm']):>9}{_n(a['bias_mm']):>9}{_n(a['rmse_mm']):>9}{_p(a['completeness']):>10}{_n(a['alignment'], 3):>9}"
            f"{_n(m['equal_coverage']['mae_mm']):>16}{_p(m['flying_left_wrong']):>13}{_n(m['ms_per_frame'], 1):>8}"
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


def _n(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _p(value: float | None) -> str:
    return "-" if value is None else f"{value:.1%}"
