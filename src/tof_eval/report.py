# SPDX-License-Identifier: Apache-2.0
"""The evaluation as `evaluation.json` and as `report.html`: figure 9, the tables, one view in pictures."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from tof_core.page import PALETTE, axes, figure_uri, render_page
from tof_core.panels import panels
from tof_eval.methods import METHODS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from tof_eval.methods import Estimate
    from tof_eval.reference import Judged

AXES = {"range_m": "range, m", "incidence_deg": "incidence, degrees", "albedo": "albedo", "edge_px": "pixels to an edge", "part": "part"}
COLOURS = {name: PALETTE[colour] for name, colour in zip(METHODS, ("neutral", "contrast", "third", "accent"), strict=True)}

LOST = 0.005
"""Share of pixels without a depth that is worth a word."""


def write(folder: Path, result: Mapping[str, Any], shown: tuple[Judged, Mapping[str, Estimate]]) -> Path:
    """Write both files; returns the report's path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "evaluation.json").write_text(json.dumps(result, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    tables = {AXES[axis]: _rows(result["methods"], axis) for axis in AXES}
    html = render_page(
        "tof_eval",
        "evaluation.html.j2",
        f"Depth errors in {result['bag']}",
        sentence=sentence(result["methods"]),
        best=best(result["methods"]),
        result=result,
        methods=result["methods"],
        tables={k: v for k, v in tables.items() if v},
        sweep=sweep_plot(result["methods"]),
        by=by_plot(result["methods"]),
        view=view_picture(*shown),
        names=list(result["methods"]),
    )
    path = folder / "report.html"
    path.write_text(html, encoding="utf-8")
    return path


def best(methods: Mapping[str, Any]) -> str:
    """The method with the least mean absolute error where all give a depth; "" where none has one."""
    known = {name: m["equal_coverage"]["mae_mm"] for name, m in methods.items() if m["equal_coverage"]["mae_mm"] is not None}
    return min(known, key=lambda name: known[name]) if known else ""


def sentence(methods: Mapping[str, Any]) -> str:
    """The verdict in words: the best method against the first one, with the price that it has."""
    name = best(methods)
    if not name:
        return "No pixel has a depth by every method, so the methods cannot be compared."
    first, m = next(iter(methods)), methods[name]
    error = m["equal_coverage"]["mae_mm"]
    if name == first:
        return f"Nothing improves on {first}: its mean error is {error:.2f} mm."
    before = methods[first]["equal_coverage"]["mae_mm"]
    words = f"{name} is best: its mean error is {error:.2f} mm where {first} has {before:.2f} mm"
    lost = methods[first]["all"]["completeness"] - m["all"]["completeness"]
    return words + (f"; it leaves {100 * lost:.0f} % of the pixels without a depth." if lost > LOST else ".")


def _rows(methods: Mapping[str, Any], axis: str) -> list[tuple[str, list[Any]]]:
    """(bin, one entry per method or None), in order of the bins."""
    first: list[str] = list(dict.fromkeys(name for m in methods.values() for name in m["by"].get(axis, {})))
    return [(name, [m["by"].get(axis, {}).get(name) for m in methods.values()]) for name in _ordered(first)]


def _ordered(names: Sequence[str]) -> list[str]:
    def key(name: str) -> tuple[float, str]:
        head = name.removeprefix("from ").split(" ")[0]
        try:
            return float(head), name
        except ValueError:
            return 0.0, name

    return sorted(names, key=key)


def _colour(name: str) -> str:
    return COLOURS.get(name.rstrip("0123456789"), PALETTE["soft"])


def sweep_plot(methods: Mapping[str, Any]) -> str:
    """Figure 9 of the paper: alignment rate of every capture, and beside it the mean absolute error."""
    figure, plots = axes(11, 3.2, columns=2)
    for ax, key, label in zip(plots[0], ("alignment", "mae_mm"), ("alignment rate, %", "mean absolute error, mm"), strict=True):
        for name, m in methods.items():
            values = [np.nan if c[key] is None else c[key] for c in m["captures_equal_coverage"]]
            style = "--" if name[-1].isdigit() else "-"
            ax.plot(range(1, len(values) + 1), values, style, marker="o", ms=4, color=_colour(name), label=name)
        ax.set_xlabel("capture")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_ylabel(label)
        ax.grid(axis="y", lw=0.8)
    plots[0, 1].set_ylim(bottom=0)
    plots[0, 0].legend(frameon=False, ncols=2)
    return figure_uri(figure)


def by_plot(methods: Mapping[str, Any]) -> str:
    """Mean absolute error and its bias against range, incidence, albedo and edge."""
    axes_shown = [axis for axis in ("range_m", "incidence_deg", "albedo", "edge_px") if any(axis in m["by"] for m in methods.values())]
    figure, plots = axes(11, 2.9, columns=max(len(axes_shown), 1), sharey=True)
    for ax, axis in zip(plots[0], axes_shown, strict=True):
        rows = _rows(methods, axis)
        for k, name in enumerate(methods):
            values = [np.nan if r[1][k] is None or r[1][k]["mae_mm"] is None else r[1][k]["mae_mm"] for r in rows]
            ax.plot(range(len(rows)), values, "--" if name[-1].isdigit() else "-", marker="o", ms=4, color=_colour(name), label=name)
        ax.set_xticks(range(len(rows)), [r[0] for r in rows], rotation=35, ha="right")
        ax.set_title(AXES[axis], loc="left")
        ax.grid(axis="y", lw=0.8)
    plots[0, 0].set_ylabel("mean absolute error, mm")
    plots[0, 0].set_yscale("log")
    plots[0, 0].yaxis.set_major_formatter("{x:g}")
    plots[0, 0].yaxis.set_minor_formatter("{x:g}")
    return figure_uri(figure)


def view_picture(judged: Judged, estimates: Mapping[str, Estimate]) -> str:
    """One view: what each method makes of it, and its error."""
    true = judged.reference
    images: list[tuple[str, Any, str]] = [(f"{name}: error", e.depth - true, "error") for name, e in estimates.items()]
    return panels(images, columns=min(len(images), 4))
