"""Numbers of nodes in Gmsh files.

meshio makes an array as long as the largest number, which takes gigabytes if a file has few nodes
with large numbers.
"""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.errors import MeshFileError

#: Numbers up to this are read whatever the number of nodes: meshio then needs 80 MB.
_ALWAYS_ALLOWED = 10_000_000
#: Larger numbers are read if the nodes use at least this share of them.
_LEAST_SHARE = 0.01
_FORMAT = re.compile(rb"\$MeshFormat\s+(\d+(?:\.\d+)?)\s+([01])\s+(\d+)")
_BEGIN = re.compile(rb"^\$Nodes[ \t\r]*\n", re.MULTILINE)
_END = b"$EndNodes"


def check(content: bytes) -> None:
    """Refuse a file whose node numbers are far larger than the number of nodes.

    What cannot be understood is left to the reader.

    Raises
    ------
    MeshFileError
        The message does not have the path.
    """
    numbers = _numbers(content)
    if numbers is None or not len(numbers):
        return
    largest, count = float(np.max(numbers)), len(numbers)
    if largest > _ALWAYS_ALLOWED and count < _LEAST_SHARE * largest:
        raise MeshFileError(
            f"numbers its {count} nodes up to {largest:.0f}, which takes too much memory; "
            "renumber them from 1"
        )


def _numbers(content: bytes) -> npt.NDArray[Any] | None:
    """Return the numbers of the nodes, or None."""
    form = _FORMAT.search(content)
    begin = None if form is None else _BEGIN.search(content, form.end())
    if form is None or begin is None:
        return None
    section = content[begin.end() : content.find(_END, begin.end())]
    is_text = form[2] == b"0"
    if float(form[1]) < 4.0:
        return _parsed(section)[1::4] if is_text else None  # binary ones are 1 to n
    if form[1] == b"4.0":
        return _of_4_0(_parsed(section)) if is_text else None
    return _of_4_1(_parsed(section)) if is_text else _of_binary_4_1(section)


def _parsed(section: bytes) -> npt.NDArray[np.float64]:
    """Return the numbers at the start of a text."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of what follows the numbers
        return np.fromstring(section, dtype=np.float64, sep=" ")


def _of_4_0(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
    """Return the numbers of blocks of rows, each a number and three coordinates."""
    found, at = [], 2
    while at + 4 <= len(values):
        count = _count(values[at + 3], len(values))
        found.append(values[at + 4 : at + 4 + 4 * count : 4])
        at += 4 + 4 * count
    return np.concatenate(found) if found else None


def _of_4_1(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
    """Return the numbers of blocks of all numbers, then all coordinates."""
    found, at = [], 4
    while at + 4 <= len(values):
        count = _count(values[at + 3], len(values))
        found.append(values[at + 4 : at + 4 + count])
        at += 4 + 4 * count
    return np.concatenate(found) if found else None


def _count(value: float, most: int) -> int:
    return int(value) if 0.0 <= value <= most else most


def _of_binary_4_1(section: bytes) -> npt.NDArray[np.uint64] | None:
    found, at = [], 32
    while at + 20 <= len(section):
        count = int(np.frombuffer(section, "<u8", 1, at + 12)[0])
        at += 20
        count = min(count, (len(section) - at) // 8)
        found.append(np.frombuffer(section, "<u8", count, at))
        at += 32 * count
    return np.concatenate(found) if found else None
