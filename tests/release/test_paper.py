"""The paper: its length, its references, and that its numbers are those of the pages."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")


def test_every_reference_is_cited_and_every_citation_has_one():
    cited = set(re.findall(r"@(\w+)", TEXT))
    entries = re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text(), re.MULTILINE)
    assert sorted(cited) == sorted(entries)


def test_the_length_is_that_of_the_journal():
    body = TEXT.split("---", 2)[2]
    assert 750 <= len(body.split()) <= 1750


def test_the_sections_are_those_that_the_journal_requires():
    required = ["Summary", "Statement of need", "State of the field", "Software design",
                "Research impact statement", "AI usage disclosure"]  # fmt: skip
    assert [title for title in re.findall(r"^# (.*)$", TEXT, re.M) if title in required] == required


def test_the_numbers_are_those_of_the_documentation():
    pages = {
        name: (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
        for name in ("measurements/comparison", "measurements/exact-limiting")
    }
    row = "| | 10 201 | 0 | 0.20 | 1.35 | 1.35 | (exact) |"
    assert row in pages["measurements/comparison"]
    assert "| 0 | 1.6 % | 10.6 % | 10.6 % | 91 % |" in pages["measurements/comparison"]
    rows = [
        "| two sources, triangles | 640 000 | 157 | 486 |",
        "| maze | 179 278 | 356 | 419 |",
        "| smooth bounds at all nodes, triangles | 159 853 | 870 | 757 |",
        "| 100 holes of 24 corners | 179 000 | 770 | 439 |",
    ]
    assert all(row in pages["measurements/exact-limiting"] for row in rows)
    words = " ".join(TEXT.split())
    for number in ("1.35", "0.20", "10.6 %", "1.6 %", "91 %", "157 ns", "486 ns", "356 ns",
                   "419 ns", "870 ns", "757 ns", "770 ns", "439 ns"):  # fmt: skip
        assert number in words
