"""Numbers in text files."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.errors import MeshFileError

#: No program writes numbers with more characters.
_LONGEST = 400


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
    try:
        return np.fromiter(map(convert, words), kind, len(words))
    except (ValueError, OverflowError) as error:
        raise MeshFileError(f"holds {_first_bad(words, convert)!r} where {kind} is required") from (
            error
        )


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


def _first_bad(words: Sequence[Any], convert: Callable[[Any], float]) -> str:
    for word in words:
        try:
            convert(word)
        except (ValueError, OverflowError):
            text = word.decode("latin-1") if isinstance(word, bytes) else str(word)
            return text if len(text) <= 40 else f"{text[:37]}..."
    return "a number that is too large"
