# SPDX-License-Identifier: Apache-2.0
"""The evaluation as `evaluation.json` and as `report.html`: alignment rate by view, tables, pictures of one view."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from tof_core.page import PALETTE, axes, figure_uri, render_page
from tof_core.panels import panels
from tof_eval.methods import METHODS
from tof_eval.words import best, called, sentence, todo

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from tof_core.arrays import Image
    from tof_eval.methods import Estimate
    from tof_eval.reference import Judged

AXES = {"range_m": "range, m", "incidence_deg": "incidence, degrees", "albedo": "albedo", "edge_px": "pixels to an edge", "part": "part"}
COLOURS = {name: PALETTE[colour] for name, colour in zip(METHODS, ("neutral", "contrast", "third", "accent"), strict=True)}


def write(folder: Path, result: Mapping[str, Any], shown: tuple[Judged, Mapping[str, Estimate]]) -> Path:
    """Write both files; returns the report's path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "evaluation.json").write_text(json.dumps(result, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    tables = {AXES[axis]: _rows(result["methods"], axis) for axis in AXES}
    html = render_page(
        "tof_eval",
        "evaluation.html.j2",
        f"Evaluation of {result['bag']}",
        sentence=sentence(result["methods"]),
        todo=todo(result["methods"]),
        best=best(result["methods"]),
        called=called,
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
    """Mean absolute error and alignment rate (figure 9 of the paper) of each view."""
    figure, plots = axes(11, 3.2, columns=2)
    for ax, key, label in zip(plots[0], ("mae_mm", "alignment"), ("mean absolute error, mm", "alignment rate, %"), strict=True):
        for name, m in methods.items():
            values = [np.nan if c[key] is None else c[key] for c in m["captures_equal_coverage"]]
            ax.plot(range(1, len(values) + 1), values, **_line(name))
        ax.set_xlabel("view")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_ylabel(label)
        ax.grid(axis="y", lw=0.8)
    plots[0, 0].set_ylim(bottom=0)
    plots[0, 0].legend(frameon=False, ncols=2)
    return figure_uri(figure)


def by_plot(methods: Mapping[str, Any]) -> str:
    """Mean absolute error against range, incidence, albedo and distance to an edge."""
    axes_shown = [axis for axis in ("range_m", "incidence_deg", "albedo", "edge_px") if any(axis in m["by"] for m in methods.values())]
    figure, plots = axes(11, 3.1, columns=max(len(axes_shown), 1), sharey=True)
    for ax, axis in zip(plots[0], axes_shown, strict=True):
        rows = _rows(methods, axis)
        for k, name in enumerate(methods):
            values = [np.nan if r[1][k] is None or r[1][k]["mae_mm"] is None else r[1][k]["mae_mm"] for r in rows]
            ax.plot(range(len(rows)), values, **_line(name))
        ax.set_xticks(range(len(rows)), [r[0] for r in rows], rotation=45, ha="right")
        ax.set_title(AXES[axis], loc="left")
        ax.grid(axis="y", lw=0.8)
    plots[0, 0].set_ylabel("mean absolute error, mm")
    plots[0, 0].set_yscale("log")
    plots[0, 0].yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    plots[0, 0].yaxis.set_minor_locator(NullLocator())
    plots[0, 0].yaxis.set_major_formatter("{x:g}")
    figure.legend(*plots[0, 0].get_legend_handles_labels(), loc="outside lower center", frameon=False, ncols=len(methods))
    return figure_uri(figure)


def _line(name: str) -> dict[str, Any]:
    """Line style of a method: raw depth broad and below the filters, whose line often covers it; several captures dashed."""
    broad = {"lw": 4.5, "alpha": 0.45, "zorder": 1.5} if name == "raw" else {"marker": "o", "ms": 4}
    return {"ls": "--" if name[-1].isdigit() else "-", "color": _colour(name), "label": called(name), **broad}


def view_picture(judged: Judged, estimates: Mapping[str, Estimate]) -> str:
    """One view: amplitude, where recorded, and the error of each method."""
    true, light = judged.reference, judged.captures[-1].amplitude
    images: list[tuple[str, Any, str]] = [] if light is None else [("amplitude", _visible(light), "grey")]
    images += [(f"error of {called(name)}", e.depth - true, "error") for name, e in estimates.items()]
    return panels(images, columns=min(len(images), 3))


def _visible(light: Image) -> Image:
    """Amplitude as a picture: square root, the brightest hundredth white."""
    return np.asarray(np.sqrt(np.clip(np.nan_to_num(light) / max(float(np.nanpercentile(light, 99)), 1e-9), 0.0, 1.0)), np.float32)
