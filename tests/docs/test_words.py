# SPDX-License-Identifier: Apache-2.0
"""Code and pages use the field's terms: private words of earlier versions stay out, and terms and effects are explained."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from tof_sensor.registry import VOCABULARY

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

WORDS = {
    r"lost turns?|turns? (?:is|are) lost": "wrapped phase",
    r"scatter|scatters|scattered": "noise (scattering of light is called scattering)",
    r"sky|hollow|hollows": "hemisphere, ambient occlusion, concavity",
    r"crowd|crowds|crowded": "correlated effects",
    r"mend|mends|mended|mending": "fix, correct, repair",
    r"restless": "unstable, noisy",
    r"unowed": "unexplained",
    r"spoil|spoils|spoiled|spoilt": "damage, bias",
    r"told|said": "measured, estimated, stated, reported",
    r"witness|witnesses": "independent sample, observation",
}
"""Private words, as whole words, and what to write instead."""

PERMITTED = {
    "src/tof_virtual/effects/light.py": ["scatter"],  # a value of `kind`
    "src/tof_virtual/effect.py": ["scatter"],  # a value of `kind`, and the prefix `scatter_` of the arrays in truth files
    "src/tof_virtual/effects/output.py": ["scatter"],  # the same
    "src/tof_gap/tell/report/pictures.py": ["scatter"],  # a function of matplotlib
    "src/tof_eval/pictures.py": ["scatter"],  # the same
    "CHANGELOG.md": ["scatter"],  # the former name of a setting
    "docs/figures.md": ["said"],  # generated; goes when its bench is run again
}
"""Places where a word may stand, each with the reason."""

LIMIT_OF_TERMS = 60


def sources(repository: Path) -> Iterator[Path]:
    """Code, templates and pages."""
    yield from (p for folder in ("src", "docs") for p in sorted((repository / folder).rglob("*")) if p.suffix in {".py", ".md", ".j2"})
    yield from (repository / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docker/README.md"))


def found_in(text: str, permitted: list[str]) -> list[str]:
    """Private words of a text, each with its line."""
    hits = ((m.group(0), text.count("\n", 0, m.start()) + 1) for w in WORDS for m in re.finditer(rf"\b(?:{w})\b", text, re.IGNORECASE))
    return [f"line {line}: {word}" for word, line in hits if word.lower() not in permitted]


def test_a_private_word_is_found_as_a_whole_word() -> None:
    assert found_in("the residual\nis said to be Scatter of lens_scatter", []) == ["line 2: Scatter", "line 2: said"]
    assert found_in("`scatter_noise`, scattering, a kind of scatter", ["scatter"]) == []


def test_no_private_word_is_left(repository: Path) -> None:
    left = {}
    for path in sources(repository):
        name = path.relative_to(repository).as_posix()
        if hits := found_in(path.read_text(encoding="utf-8"), PERMITTED.get(name, [])):
            left[name] = hits
    assert not left, "\n".join([*(f"{n}: {', '.join(h)}" for n, h in left.items()), *(f"{w}: {instead}" for w, instead in WORDS.items())])


def test_every_exception_is_needed(repository: Path) -> None:
    for name, words in PERMITTED.items():
        text = (repository / name).read_text(encoding="utf-8")
        assert all(re.search(rf"\b{word}\b", text, re.IGNORECASE) for word in words), name


def test_every_effect_has_a_section_with_all_its_parts(repository: Path) -> None:
    text = (repository / "docs" / "effects.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |^---)", text, re.MULTILINE | re.DOTALL))
    assert set(VOCABULARY) <= set(sections)
    for name in VOCABULARY:
        for part in ("**Mechanism.**", "**Formula.**", "**Source.**", "**Valid**", "**Testable", "**Confused with**", "**Separated by**"):
            assert part in sections[name], f"{name}: {part}"


def test_every_source_that_an_effect_names_is_listed(repository: Path) -> None:
    text, _, references = (repository / "docs" / "effects.md").read_text(encoding="utf-8").partition("## References")
    cited = set(re.findall(r"([A-ZÀ-Ž][\w-]+)(?: (?:et al\.|and [A-ZÀ-Ž][\w-]+))? \((\d{4})", text))
    assert len(cited) > 15
    for author, year in cited:
        assert re.search(rf"^- {author}.*\({year}\)", references, re.MULTILINE), f"{author} {year}"


def test_the_glossary_is_short_and_sorted_and_each_term_has_a_definition(repository: Path) -> None:
    rows = re.findall(
        r"^\| \*\*(.+?)\*\*[^|]*\| ([^|]+) \|", (repository / "docs" / "glossary.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    terms = [term for term, _ in rows]
    assert 0 < len(terms) <= LIMIT_OF_TERMS
    assert terms == sorted(terms, key=str.lower)
    assert all(len(meaning.split()) >= 4 for _, meaning in rows)


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_readme_and_contributing_link_design_effects_and_glossary(repository: Path, page: str) -> None:
    text = (repository / page).read_text(encoding="utf-8")
    assert all(f"(docs/{name}.md)" in text for name in ("design", "effects", "glossary"))


def test_every_page_links_the_glossary(repository: Path) -> None:
    pages = [p for p in (repository / "docs").rglob("*.md") if p.name != "glossary.md"]
    assert [p.name for p in pages if not re.search(r"\((?:\.\./)?glossary\.md\)", p.read_text(encoding="utf-8"))] == []


def test_links_between_pages_lead_somewhere(repository: Path) -> None:
    for page in [repository / "README.md", repository / "CONTRIBUTING.md", *(repository / "docs").rglob("*.md")]:
        for target, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)(#[^)\s]+)?\)", page.read_text(encoding="utf-8")):
            other = (page.parent / target).resolve() if target else page
            assert other.exists(), f"{page.name}: {target}"
            if anchor and other.suffix == ".md":
                titles = re.findall(r"^#+ (.+)$", other.read_text(encoding="utf-8"), re.MULTILINE)
                slugs = {re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in titles}
                assert anchor[1:] in slugs, f"{page.name}: {target}{anchor}"


def test_nothing_in_the_code_points_outside_the_repository(repository: Path) -> None:
    outside = re.compile(r"\b(?:TOF_EFFECTS|ROS_CONTRACT|ROS_FROM_PIP|DESIGN(?:\.md| section)|issue \d+)\b")
    for path in sources(repository):
        name = path.relative_to(repository).as_posix()
        assert not outside.search(path.read_text(encoding="utf-8")), name


def test_a_percentage_has_a_space_before_its_sign(repository: Path) -> None:
    tight = re.compile(r"\d%(?![\d(\"';:}])|:[\d.<>+]*%\}")  # A literal, or a format of Python's that writes one.
    pages = [p for p in sources(repository) if p.suffix != ".j2" and p.name != "figures.md"]
    left = {p.relative_to(repository).as_posix(): tight.findall(p.read_text(encoding="utf-8")) for p in pages}
    assert {name: hits for name, hits in left.items() if hits} == {}
