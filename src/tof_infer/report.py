# SPDX-License-Identifier: Apache-2.0
"""Report page of a network: errors before and after correction, calibration of sigma, course of the training."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tof_core.page import PALETTE, axes, figure_uri, render_page
from tof_core.shares import in_percent

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from tof_infer.card import Card

ONE_SIGMA, TWO_SIGMA = 0.683, 0.954
"""Shares of a normal distribution within one and two standard deviations."""
CALIBRATED = 0.05
"""Difference from these shares up to which sigma counts as calibrated."""
FLAT = 0.03
"""Share of the validation error that the last quarter of the epochs must remove for longer training to be recommended."""


def write(card: Card, out: Path) -> Path:
    """Write the page beside the network `out` (.onnx); returns it."""
    figures = card.figures
    page = out.with_suffix(".html")
    text = render_page(
        "tof_infer",
        "training.html.j2",
        f"Network {out.name}",
        sentence=sentence(figures),
        todo=todo(card),
        figures=figures,
        unseen="unseen_mae_mm" in figures,
        split=card.split,
        held=held_out(card),
        base=card.base,
        curve="Validation while training: all pixels, other stations" if _checked(card.curves) else "Loss of training by pass",
        data=card.data,
        camera=card.camera,
        config=card.config,
        range_m=card.range_m,
        max_sigma_mm=1e3 * card.max_sigma_m,
        errors=_errors(figures, held_out(card)),
        curves=_curves(card.curves, figures),
        name=out.name,
    )
    page.write_text(text, encoding="utf-8")
    return page


def held_out(card: Card) -> str:
    """The views that the network was validated on, in words."""
    return "the other half" if card.base else "other stations"


def sentence(figures: Mapping[str, Any]) -> str:
    """The verdict: errors on the validation views."""
    mae, raw = figures["val_mae_known_mm"], figures["val_raw_mae_mm"]
    if mae is None:
        return "The network repairs no pixel: its sigma is nowhere below the limit."
    if mae >= raw:
        return f"The network repairs nothing: the mean error is {mae:.2f} mm where raw depth has {raw:.2f} mm."
    return f"The network brings the mean error from {raw:.2f} to {mae:.2f} mm, on the {in_percent(figures['val_known'])} of the pixels that it repairs."


def todo(card: Card) -> list[str]:
    """Recommendations."""
    figures, lines = card.figures, []
    mae, raw = figures["val_mae_known_mm"], figures["val_raw_mae_mm"]
    if mae is None or mae >= raw:
        lines.append(
            "Add views: more stations and ranges of this camera. Look at the labels first: toftwin label names views that were refused."
        )
    else:
        lines.append("Use it: toftwin infer, evaluate and node infer take it as --model.")
    if "unseen_mae_mm" not in figures:
        lines.append(
            "State what it is worth elsewhere: pass datasets of other scenes of this camera as --unseen; sigma is then calibrated on them."
        )
    elif figures["unseen_mae_known_mm"] is not None and figures["unseen_mae_known_mm"] > figures["unseen_raw_mae_mm"]:
        lines.append("Use it in the trained scenes alone: in scenes that it has never seen it repairs nothing.")
    one, two = figures["val_within_1_sigma"], figures["val_within_2_sigma"]
    if abs(one - ONE_SIGMA) > CALIBRATED or abs(two - TWO_SIGMA) > CALIBRATED:
        lines.append(
            f"Do not rely on sigma yet: {in_percent(one)} of the errors are within one and {in_percent(two)} within two; wanted are 68 and 95 %."
        )
    if _still_falls(card.curves):
        lines.append("Train longer: the validation error was still falling at the end.")
    return lines


def _still_falls(curves: list[dict[str, float]]) -> bool:
    """Whether the last quarter of the epochs reduced the validation error."""
    values = [c["val_mae_mm"] for c in _checked(curves)]
    if len(values) < 8:
        return False
    before = min(values[: -len(values) // 4])
    return min(values) < (1 - FLAT) * before


def _errors(figures: Mapping[str, Any], held: str) -> str:
    """Mean errors raw and repaired, on held-out views and, where known, of unseen scenes; one axis."""
    groups = [(held, "val"), *([("scenes never seen", "unseen")] if "unseen_mae_mm" in figures else [])]
    figure, ((ax,),) = axes(5.4, 2.9)
    names, values, colours = [], [], []
    for words, key in groups:
        for part, colour in (("raw_mae_mm", "neutral"), ("mae_mm", "third"), ("mae_known_mm", "accent")):
            value = figures[f"{key}_{part}"]
            label = {"raw_mae_mm": "raw", "mae_mm": "network, all pixels", "mae_known_mm": "network, repaired pixels"}[part]
            names.append(f"{label}\n{words}")
            values.append(0.0 if value is None else value)
            colours.append(PALETTE[colour])
    ax.barh(names[::-1], values[::-1], color=colours[::-1], height=0.62)
    for row, value in enumerate(values[::-1]):
        ax.text(value, row, f" {value:.2f}", va="center", fontsize=8.5)
    ax.set_xlabel("mean absolute error, mm")
    ax.margins(x=0.15)
    return figure_uri(figure)


def _checked(curves: list[dict[str, float]]) -> list[dict[str, float]]:
    """The epochs with a validation."""
    return [c for c in curves if "val_mae_mm" in c]


def _curves(curves: list[dict[str, float]], figures: Mapping[str, Any]) -> str:
    """Validation error by epoch, with that of raw depth; the loss for an adapted network, which is validated only at the end."""
    figure, ((ax,),) = axes(5.4, 2.9)
    checked = _checked(curves)
    if not checked:
        ax.plot([c["epoch"] for c in curves], [c["loss"] for c in curves], color=PALETTE["accent"])
        ax.set_xlabel("pass")
        ax.set_ylabel("loss")
        return figure_uri(figure)
    ax.plot(
        [c["epoch"] for c in checked],
        [c["val_mae_mm"] for c in checked],
        color=PALETTE["accent"],
        marker="o",
        ms=3,
        label="network, other stations",
    )
    ax.axhline(figures["val_raw_mae_mm"], color=PALETTE["neutral"], ls="--", label="raw depth")
    ax.set_xlabel("epoch")
    ax.set_ylabel("mean absolute error, mm")
    ax.set_ylim(bottom=0)
    ax.legend(frameon=False)
    return figure_uri(figure)
