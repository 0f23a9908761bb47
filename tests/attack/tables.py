"""The outcomes of the corpus as tables in markdown."""

import re
import statistics
from collections import Counter
from collections.abc import Iterable
from typing import Any

#: What may happen to a surface, see `corpus`.
KINDS = ("kept", "warned", "deviates", "refused", "failed")

_COLUMNS = ("file", "triangles", "made", "CPU s", "MB", "in band", "angle", "distance", "kind")


def table(rows: list[dict[str, Any]]) -> str:
    """Return a line per surface, with what was said about it, and a line of counts."""
    columns = (*_COLUMNS, "outcome")
    lines = [[_format(row.get(column, "")) for column in columns] for row in rows]
    return _markdown(columns, lines) + f"\n{_counts(rows)}\n"


def table_of_defects(rows: list[dict[str, Any]]) -> str:
    """Return a line per defect, and a line of counts.

    The defect is in the name of the file, as in ``012-fins.off``.
    """
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        defect = re.sub(r"^\d+-|\.\w+$", "", row["file"]).replace("-", " ")
        groups.setdefault(defect, []).append(row)
    lines = [[defect, *_line(of_one)] for defect, of_one in groups.items()]
    lines.append(["all", *_line(rows)])
    columns = ("defect", "surfaces", *KINDS, "median CPU s", "largest CPU s", "largest MB")
    return _markdown(columns, lines) + f"\n{_counts(rows)}\n"


def _line(rows: list[dict[str, Any]]) -> list[str]:
    kinds = Counter(row["kind"] for row in rows)
    seconds = [row["CPU s"] for row in rows]
    counts = [str(kinds[kind] or "") for kind in KINDS]
    most = max(row["MB"] for row in rows)
    return [
        str(len(rows)), *counts,
        f"{statistics.median(seconds):.3g}", f"{max(seconds):.3g}", str(most),
    ]  # fmt: skip


def _markdown(columns: Iterable[str], lines: Iterable[Iterable[str]]) -> str:
    columns = list(columns)
    heads = ["| " + " | ".join(columns) + " |", "|---|" + "---|" * (len(columns) - 1)]
    body = ["| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines]
    return "\n".join([*heads, *body, ""])


def _counts(rows: list[dict[str, Any]]) -> str:
    kinds = Counter(row["kind"] for row in rows)
    total = ", ".join(f"{kinds[kind]} {kind}" for kind in KINDS if kinds[kind])
    return f"{len(rows)} files: {total}."


def _format(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return value[:160] if isinstance(value, str) else str(value)
