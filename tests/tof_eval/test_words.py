# SPDX-License-Identifier: Apache-2.0
"""The verdict names the best method in words and its price; the advice follows from the figures."""

from __future__ import annotations

from typing import Any

from tof_eval.words import best, called, sentence, todo


def method(error: float | None, complete: float = 1.0, within: float | None = None) -> dict[str, Any]:
    return {"equal_coverage": {"mae_mm": error}, "all": {"completeness": complete}, "within_2_sigma": within}


def test_methods_are_called_by_words_with_their_captures() -> None:
    assert [called(n) for n in ("raw", "rules", "rules4", "corrected", "model")] == [
        "raw depth", "the filters", "the filters over 4 captures", "the filters after sensor.yaml", "the network",
    ]  # fmt: skip


def test_the_sentence_names_the_best_method_and_its_price() -> None:
    three = {"raw": method(6.0), "rules": method(4.0, 0.9), "model": method(2.0, 0.8)}
    assert best(three) == "model"
    assert sentence(three) == (
        "The network has the least error: 2.00 mm in the mean, where raw depth has 6.00 mm. It leaves 20 % of the pixels without a depth."
    )
    assert sentence({"raw": method(1.0), "model": method(2.0)}) == "Nothing improves on raw depth: its mean error is 1.00 mm."
    assert sentence({"raw": method(None)}).startswith("No pixel has a depth by every method")


def test_the_best_method_is_recommended_and_a_network_that_harms_is_not() -> None:
    lines = todo({"raw": method(3.0), "rules": method(2.5, within=0.96), "model": method(4.0, within=0.6)})
    assert lines[0] == "Use the filters: toftwin label and the node preproc apply them."
    assert lines[1].startswith("Do not use this network here: its mean error is 4.00 mm, that of raw depth 3.00 mm.")
    assert "--methods raw,rules,model,corrected" in lines[2]
    assert lines[3] == "Do not take sigma for the whole error: two sigma hold 60 % of the errors of the network; 95 % is right."


def test_captures_are_recommended_only_where_they_win() -> None:
    assert todo({"rules": method(3.0), "rules4": method(2.9)})[0].startswith("One capture of each view is enough")
    assert todo({"rules": method(3.0), "rules4": method(2.0)})[0].startswith("Take 4 captures of each view")


def test_what_was_corrected_already_is_not_advised_again() -> None:
    assert todo({"raw": method(3.0), "corrected": method(1.0)}) == [
        "Pass the same sensor.yaml as --sensor to toftwin label, correct and inspect."
    ]
    assert todo({"raw": method(None)}) == ["Compare fewer methods: --methods raw,rules."]
