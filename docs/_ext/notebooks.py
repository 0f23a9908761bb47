"""Notebooks of the pages of how-tos and tutorials, for those who work in Jupyter.

A block ``python`` becomes a cell, a block ``sh`` a cell of commands, and a block ``text`` the
output of the cell before it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path

BLOCK = re.compile(r"^```(sh|python|text)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
LEFT_OUT = re.compile(r"<!--.*?-->\n|^!\[.*?\]\(.*?\)\n", re.MULTILINE | re.DOTALL)
#: Links lead to other pages, which are not beside a notebook.
LINK = re.compile(r"\[([^\]]*)\]\((?!https?:)[^)]*\)")
WHERE = "*Run this in a clone of the repository, where the folder `data` is.*\n"


def notebook_of(page: str) -> str:
    """Return a page in Markdown as a notebook of format 4.5."""
    cells: list[dict[str, object]] = []
    kind = ""
    title, _, page = page.partition("\n")
    for number, part in enumerate(BLOCK.split(f"{WHERE}{page}")):
        if number % 3 == 1:
            kind = part
        elif number % 3 == 2 and kind == "text":
            cells[-1]["outputs"] = [{"output_type": "stream", "name": "stdout", "text": part}]
        elif number % 3 == 2:
            code = part if kind == "python" else re.sub(r"^(?=\S)", "!", part, flags=re.MULTILINE)
            cells.append({**_cell("code", code), "execution_count": None, "outputs": []})
        elif text := LINK.sub(r"\1", LEFT_OUT.sub("", part)).strip():
            cells.append(_cell("markdown", text if cells else f"{title}\n\n{text}"))
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    notebook = {"nbformat": 4, "nbformat_minor": 5, "metadata": {"kernelspec": kernel}}
    return json.dumps(notebook | {"cells": cells}, indent=1, ensure_ascii=False) + "\n"


def _cell(kind: str, text: str) -> dict[str, object]:
    return {"cell_type": kind, "metadata": {}, "source": text.rstrip("\n")}


def write_notebooks(docs: Path, pages: Iterable[str]) -> None:
    """Write the notebooks of some pages to ``docs / "notebooks"``."""
    (docs / "notebooks").mkdir(exist_ok=True)
    for name in pages:
        text = notebook_of((docs / f"{name}.md").read_text(encoding="utf-8"))
        (docs / f"notebooks/{Path(name).name}.ipynb").write_text(text, encoding="utf-8")
