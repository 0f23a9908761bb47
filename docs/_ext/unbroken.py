"""What stays on one line: numbers such as "10 000" and "7 %", and options such as ``--strict``.

And which tables are lists on narrow pages: those of three to six columns with much text, those of
two columns with long names, and those of functions in the reference.
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
#: Code in tables with more characters is broken, as text is.
LONGEST_CODE = 32
#: Tables of so many columns are lists on narrow pages if half of the rows have more characters.
STACKED = {3: 40, 4: 40, 5: 85, 6: 85}
#: Tables of two columns are lists if a name in the first one is longer, so that it leaves no room.
LONGEST_NAME = 20
#: Tables of so many columns, half of them of text, are set smaller.
MANY_COLUMNS = 6


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
        if len(text) > LONGEST_CODE:
            literal["classes"].append("long")
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
        wordy = median(map(_length, rows)) > STACKED.get(len(rows[0]), inf)
        if wordy or _leaves_no_room(rows) or "autosummary" in group.parent["classes"]:
            group.parent["classes"].append("stacked")
        if len(rows[0]) >= MANY_COLUMNS and _columns_of_text(rows) >= MANY_COLUMNS // 2:
            group.parent["classes"].append("dense")


def _length(row: nodes.row) -> int:
    """Return the number of characters in a row, not those of numbers."""
    return sum(len(entry.astext()) for entry in row if "number" not in entry["classes"])


def _columns_of_text(rows: list[nodes.row]) -> int:
    """Return in how many columns a cell has much text."""
    return len({k for row in rows for k, cell in enumerate(row) if "words" in cell["classes"]})


def _leaves_no_room(rows: list[nodes.row]) -> bool:
    """Return whether there are two columns: long names, and text that finds no room."""
    if len(rows[0]) != 2:
        return False
    names = [len(code.astext()) for row in rows for code in row[0].findall(nodes.literal)]
    texts = [len(row[1].astext()) for row in rows if len(row) == 2]
    return max(names, default=0) > LONGEST_NAME and median(texts) > LONG_TEXT


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-read", keep_together)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
