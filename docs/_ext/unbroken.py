"""What stays on one line: numbers such as "10 000" and "7 %", and options such as ``--strict``.

And which tables are lists on narrow pages: those of three to six columns with much text.
"""

from __future__ import annotations

import re
from math import inf
from statistics import median
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

#: The space in "10 000" and "7 %".
WITHIN = re.compile(r"(?<=\d) (?=\d{3}(?!\d)|%)")
LETTER = re.compile(r"[^\W\d_]")
#: Browsers break a line after a hyphen.
OPTION = re.compile(r"-\S*(?: \S+)?")
LONGEST_OPTION = 24
#: A cell with more characters gets room for several words in a line.
LONG_TEXT = 25
#: Tables of so many columns are lists on narrow pages if half of the rows have more characters.
STACKED = {3: 40, 4: 40, 5: 85, 6: 85}


def keep_together(app: Sphinx, doctree: nodes.document) -> None:
    """Put no-break spaces into numbers, and classes on options and on the cells of tables."""
    for text in list(doctree.findall(nodes.Text)):
        if isinstance(text.parent, nodes.literal | nodes.literal_block | nodes.math):
            continue
        if WITHIN.search(text):
            text.parent.replace(text, nodes.Text(WITHIN.sub("\N{NO-BREAK SPACE}", text)))
    for literal in doctree.findall(nodes.literal):
        text = literal.astext()
        if OPTION.fullmatch(text) and len(text) <= LONGEST_OPTION:
            literal["classes"].append("option")
    for entry in doctree.findall(nodes.entry):
        text = entry.astext()
        if not text.strip():
            entry["classes"].append("empty")
        if not LETTER.search(text):
            entry["classes"].append("number")
        elif len(text) > LONG_TEXT:
            entry["classes"].append("words")
    for group in doctree.findall(nodes.tgroup):
        rows = [row for body in group.findall(nodes.tbody) for row in body.findall(nodes.row)]
        if median(map(_length, rows)) > STACKED.get(len(rows[0]), inf):
            group.parent["classes"].append("stacked")


def _length(row: nodes.row) -> int:
    """Return the number of characters in a row, not those of numbers."""
    return sum(len(entry.astext()) for entry in row if "number" not in entry["classes"])


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-read", keep_together)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
