# SPDX-License-Identifier: Apache-2.0
"""The result of a comparison in words: names of the methods, verdict, recommendations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tof_core.shares import in_percent
from tof_infer.report import CALIBRATED, TWO_SIGMA

if TYPE_CHECKING:
    from collections.abc import Mapping

WORDS = {"raw": "raw depth", "rules": "the filters", "corrected": "the filters after sensor.yaml", "model": "the network"}
"""Methods by their first name (`tof_eval.methods.METHODS`)."""
LOST = 0.005
"""Share of pixels that must lose their depth to be mentioned."""
WON = 0.1
"""Share of the error that more captures must remove before they are recommended, since each takes time."""


def called(name: str) -> str:
    """A method in words; a number at the end of its name is its number of captures."""
    first = name.rstrip("0123456789")
    captures = name[len(first) :]
    return WORDS.get(first, first) + (f" over {captures} captures" if captures else "")


def best(methods: Mapping[str, Any]) -> str:
    """The method with the least mean absolute error over the pixels common to all methods; "" without such pixels."""
    known = {name: m["equal_coverage"]["mae_mm"] for name, m in methods.items() if m["equal_coverage"]["mae_mm"] is not None}
    return min(known, key=lambda name: known[name]) if known else ""


def sentence(methods: Mapping[str, Any]) -> str:
    """The verdict: error of the best method and of the first one, and the pixels that the best one loses."""
    name = best(methods)
    if not name:
        return "No pixel has a depth by every method, so the methods cannot be compared."
    first, m = next(iter(methods)), methods[name]
    error = m["equal_coverage"]["mae_mm"]
    if name == first:
        return f"Nothing improves on {called(first)}: its mean error is {error:.2f} mm."
    before = methods[first]["equal_coverage"]["mae_mm"]
    words = f"{_capital(called(name))} has the least error: {error:.2f} mm in the mean, where {called(first)} has {before:.2f} mm"
    lost = methods[first]["all"]["completeness"] - m["all"]["completeness"]
    return words + (f". It leaves {in_percent(lost)} of the pixels without a depth." if lost > LOST else ".")


def todo(methods: Mapping[str, Any]) -> list[str]:
    """Recommendations."""
    name, lines = best(methods), list[str]()
    if not name:
        return ["Compare fewer methods: --methods raw,rules."]
    use = _use(name, methods)
    if use:
        lines.append(use)
    first = next(iter(methods))
    before = methods[first]["equal_coverage"]["mae_mm"]
    model = methods.get("model")
    if model and name != "model" and model["equal_coverage"]["mae_mm"] > before:
        lines.append(
            f"Do not use this network here: its mean error is {model['equal_coverage']['mae_mm']:.2f} mm, that of {called(first)} {before:.2f} mm. "
            "Train one on sessions of this camera (toftwin label, then toftwin train) and pass it as --model."
        )
    if not any(n.startswith("corrected") for n in methods):
        lines.append(
            "Look for the cause of the error that is left: toftwin gap. Its sensor.yaml, passed as --sensor with --methods "
            f"{','.join(dict.fromkeys([*(n.rstrip('0123456789') for n in methods), 'corrected']))}, shows how much a correction removes."
        )
    far = [n for n, m in methods.items() if m["within_2_sigma"] is not None and m["within_2_sigma"] < TWO_SIGMA - CALIBRATED]
    if far:
        shares = " and ".join(f"{in_percent(methods[n]['within_2_sigma'])} of the errors of {called(n)}" for n in far)
        lines.append(f"Do not take sigma for the whole error: two sigma hold {shares}; 95 % is right.")
    return lines


def _use(name: str, methods: Mapping[str, Any]) -> str:
    """How to run the best method; "" for raw depth."""
    first = name.rstrip("0123456789")
    captures, single = name[len(first) :], methods.get(first)
    if captures and single and methods[name]["equal_coverage"]["mae_mm"] > (1.0 - WON) * single["equal_coverage"]["mae_mm"]:
        return f"One capture of each view is enough: {captures} captures remove less than {in_percent(WON)} of the error."
    if captures:
        return f"Take {captures} captures of each view while the camera stands still; toftwin label and the node preproc combine them."
    return {
        "rules": "Use the filters: toftwin label and the node preproc apply them.",
        "corrected": "Pass the same sensor.yaml as --sensor to toftwin label, correct and inspect.",
        "model": "Use the network: toftwin infer corrects a bag, toftwin node infer the running camera.",
    }.get(first, "")


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]
