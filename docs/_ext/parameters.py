"""The tables of docs/parameters.md, made from the declarations of the options.

    python docs/_ext/parameters.py

puts them into the page; a test compares.
"""

from __future__ import annotations

import re
from pathlib import Path

from adaptsize.options import AdaptOptions, Option, RemeshOptions, SizeFunctionOptions, options_of

PAGE = Path(__file__).parents[1] / "parameters.md"
SECTIONS = {
    "Sizes of a domain": SizeFunctionOptions,
    "Remeshing": RemeshOptions,
    "Adaptive loops": AdaptOptions,
}
HEAD = "| option | default | meaning |\n|---|---|---|\n"


def with_tables(page: str) -> str:
    """Return the text of the page with the tables that the declarations give."""
    for title, record in SECTIONS.items():
        table = HEAD + "".join(_row(option) for option in options_of(record).values())
        old = re.compile(rf"(?<=\n## {title}\n)([^#|]*)(?:\|.*\n)+")
        page, count = old.subn(lambda match, table=table: match[1] + table, page)
        assert count == 1, f"{PAGE} has {count} sections {title!r} with a table"
    return page


def _row(option: Option) -> str:
    names = ", ".join(f"`{name}`" for name in (option.name, option.short) if name)
    default = option.chosen or f"{option.default}".removesuffix(".0")
    meaning = " ".join(part for part in (option.text, option.details) if part)
    cells = (names, default, meaning.replace("``", "`").replace("  ", " "))
    return f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |\n"


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
