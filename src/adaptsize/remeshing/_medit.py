"""The binary files of Medit that Mmg reads and writes.

After two numbers, 1 and the version, the file consists of blocks: a keyword, the position of the
next block, the number of rows, and the rows.  Version 2 has real numbers of 64 bits and positions
of 32.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.errors import BackendError
from adaptsize.typing import IntArray

_DIMENSION, _END = 3, 54
_KEYWORDS = {
    "vertices": 4, "edges": 5, "triangles": 6, "tetrahedra": 8, "corners": 13, "ridges": 14,
    "required edges": 16, "required triangles": 17, "sizes": 62,
}  # fmt: skip
_CORNERS = {"edges": 2, "triangles": 3, "tetrahedra": 4}


def write_medit(path: Path, dim: int, blocks: Mapping[str, Sequence[npt.NDArray[Any]]]) -> None:
    """Write blocks of rows, each given by its columns, float64 or int32; nodes count from 1.

    Raises
    ------
    BackendError
        If the file would exceed 2 GB.
    """
    with open(path, "wb") as file:
        np.array([1, 2, _DIMENSION, 20, dim], np.int32).tofile(file)
        for name, columns in blocks.items():
            kinds = [(str(i), c.dtype, c.shape[1:]) for i, c in enumerate(columns)]
            rows = np.empty(len(columns[0]), kinds)
            for i, column in enumerate(columns):
                rows[str(i)] = column
            # One field of sizes, of type 1, or of metrics, of type 3.
            types = [1, 1 if columns[0].ndim == 1 else 3] if name == "sizes" else []
            after = file.tell() + 4 * (3 + len(types)) + rows.nbytes
            if after > np.iinfo(np.int32).max:
                raise BackendError("the mesh is too large for a file that Mmg reads (2 GB)")
            np.array([_KEYWORDS[name], after, len(rows), *types], np.int32).tofile(file)
            rows.tofile(file)
        np.array([_END, 0], np.int32).tofile(file)


def read_medit(path: Path, *names: str) -> list[tuple[npt.NDArray[Any], IntArray]]:
    """Return the rows of blocks, with nodes that count from 0, and their references."""
    found: dict[str, npt.NDArray[Any] | None] = dict.fromkeys(names)
    dim = 3
    with open(path, "rb") as file:
        file.seek(8)
        while len(head := np.fromfile(file, np.int32, 3)) == 3:
            keyword, after, n = head.tolist()
            if keyword == _DIMENSION:
                dim = n
            for name in found:
                if keyword == _KEYWORDS[name]:
                    found[name] = np.fromfile(file, _row(name, dim), n)
            file.seek(after)
    blocks = []
    for name in names:
        rows = found[name]
        if rows is None:
            rows = np.empty(0, _row(name, dim))
        values = rows["row"] if name == "vertices" else rows["row"] - np.int32(1)
        blocks.append((values, rows["reference"]))
    return blocks


def _row(name: str, dim: int) -> npt.DTypeLike:
    kind = ("row", np.float64, dim) if name == "vertices" else ("row", np.int32, _CORNERS[name])
    return np.dtype([kind, ("reference", np.int32)])
