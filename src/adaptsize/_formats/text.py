"""Numbers in text files: read, and written many at a time."""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.errors import MeshFileError

#: No program writes numbers with more characters.
_LONGEST = 400
#: Their text is limited to a few MB.
_ROWS_AT_ONCE = 20_000


def numbers(words: Sequence[bytes] | Sequence[str], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return the numbers of a text as an array.

    Arrays of words, which numpy can convert too, have rows as long as the longest word.

    Raises
    ------
    MeshFileError
        If a word is not a number, or not an integer where ``dtype`` is an integer type.
    """
    kind = np.dtype(dtype)
    convert: Callable[[Any], float] = int if kind.kind in "iu" else float
    left = iter(words)
    try:
        return np.fromiter(map(convert, left), kind, len(words))
    except (ValueError, OverflowError) as error:
        given = words[len(words) - 1 - sum(1 for _ in left)]
        text = given.decode("latin-1") if isinstance(given, bytes) else given
        text = text if len(text) <= 40 else f"{text[:37]}..."
        raise MeshFileError(f"holds {text!r} where {kind} is required") from error


def numbers_in(text: bytes, where: str) -> npt.NDArray[np.float64]:
    """Return the numbers of a text between spaces and line breaks.

    Raises
    ------
    MeshFileError
        If a word is not a number.  ``where`` is the section of the text.
    """
    words = text.split()
    try:
        return np.fromiter(map(float, words), np.float64, len(words))
    except ValueError:
        raise MeshFileError(f"holds a word in {where} that is no number") from None


def rows_of(wanted: npt.NDArray[Any], names: npt.NDArray[Any], what: str) -> npt.NDArray[np.intp]:
    """Return the rows in which nodes have the given numbers.

    Raises
    ------
    MeshFileError
        If no node has one of them.  ``what`` is the place of the numbers.
    """
    missing = wanted[~np.isin(wanted, names)]
    if len(missing):
        raise MeshFileError(f"has {what} with node {missing[0]:g}, which is not in the file")
    order = np.argsort(names, kind="stable")
    return order[np.searchsorted(names, wanted, sorter=order)]


def check_last_number(content: bytes, n_points: float = math.inf) -> None:
    """Refuse a text that ends inside a line after a number that may lack digits.

    Parameters
    ----------
    content : bytes
    n_points : float
        Number of points, if the last number is an index.  More digits would make many
        indices too large, so they are complete.  By default the number may be any.
    """
    last = re.split(rb"[\s,/]", content[-_LONGEST:])[-1]
    if not last or (last.isdigit() and 10 * int(last) > n_points):
        return
    raise MeshFileError(
        f"ends inside a line, after {last[-40:].decode('latin-1')!r}, so it may be truncated; "
        "if it is complete, add a line break"
    )


def numbered(rows: npt.NDArray[Any], first: int = 1) -> npt.NDArray[Any]:
    """Return rows after a column with their numbers."""
    return np.column_stack([np.arange(first, first + len(rows)), rows])


def write_text(path: Path, *pieces: str | tuple[str, npt.NDArray[Any]]) -> None:
    """Write texts, and tables: the format of a line, and the rows of numbers in it.

    Some rows are formatted together, for speed.
    """
    with path.open("w", encoding="utf-8", newline="\n") as file:
        for piece in pieces:
            if isinstance(piece, str):
                file.write(piece)
                continue
            line, rows = piece
            for start in range(0, len(rows), _ROWS_AT_ONCE):
                part = rows[start : start + _ROWS_AT_ONCE]
                file.write((line * len(part)) % tuple(part.ravel().tolist()))
