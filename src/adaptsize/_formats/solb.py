"""Binary ``.solb``: the numbers of a ``.sol``, as the library libMeshb stores them.

A file begins with the integers 1, whose bytes show their order, and the version.  Keywords follow:
a code, the place of the next one, and data.  Integers have 4 bytes; places have 8 from version 3
on and counts from version 4.  Numbers have 4 bytes in version 1 and 8 in others.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray

_DIMENSION, _END, _SOL_AT_VERTICES = 3, 54, 62


class Solution(NamedTuple):
    """Values at nodes."""

    dim: int
    kinds: list[int]
    """Types of the values of a node: 1 a number, 2 a vector, 3 a symmetric matrix."""
    n: int
    """Number of nodes."""
    values: FloatArray
    """One after another; fewer than there should be if the file ends early."""


class _Content:
    """Bytes, read one after another."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0
        is_little = content[:4] == (1).to_bytes(4, "little")
        self.order: Literal["little", "big"] = "little" if is_little else "big"
        if self.integer() != 1:
            raise MeshFileError("does not begin as a binary .solb")

    def integer(self, n_bytes: int = 4) -> int:
        part = self.content[self.at : self.at + n_bytes]
        if len(part) < n_bytes:
            raise MeshFileError("ends early")
        self.at += n_bytes
        return int.from_bytes(part, self.order, signed=True)


def read(path: Path) -> Solution:
    """Return the values at the nodes in a binary file."""
    content = _Content(path.read_bytes())
    version = content.integer()
    if not 1 <= version <= 4:
        raise MeshFileError(f"has version {version} of the format; 1 to 4 can be read")
    dim = 0
    while True:
        code = content.integer()
        if code == _END:
            raise MeshFileError("has no values at nodes")
        following = content.integer(4 if version < 3 else 8)
        if code == _DIMENSION:
            dim = content.integer()
        elif code == _SOL_AT_VERTICES:
            break
        if following <= content.at - 4 or following >= len(content.content):
            raise MeshFileError("ends early, or is damaged")
        content.at = following
    n = content.integer(4 if version < 4 else 8)
    n_kinds = content.integer()
    if not 0 < n_kinds < 100:
        raise MeshFileError(f"has {n_kinds} values per node")
    kinds = [content.integer() for _ in range(n_kinds)]
    widths = {1: 1, 2: dim, 3: dim * (dim + 1) // 2}
    if dim not in (2, 3) or n < 1 or not set(kinds) <= set(widths):
        raise MeshFileError(f"has {n} nodes in {dim}-D with values of the types {kinds}")
    kind = np.dtype("f4" if version == 1 else "f8").newbyteorder(content.order)
    count = min(
        n * sum(widths[k] for k in kinds), (len(content.content) - content.at) // kind.itemsize
    )
    values = np.frombuffer(content.content, kind, count, content.at)
    return Solution(dim, kinds, n, values.astype(np.float64))
