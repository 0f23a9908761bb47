"""Which bounds rose and which fell below the sizes before."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.typing import FloatArray, IntArray


class Changes(NamedTuple):
    """What new bounds mean for the sizes before; flat node numbers."""

    nodes: IntArray
    """Where the bound is another one."""
    raised: IntArray
    """Where it rose and had been the size."""
    lowered: IntArray
    """Where it is now below the size before."""

    @classmethod
    def between(cls, before: FloatArray, now: FloatArray, sizes: FloatArray) -> Changes:
        """Compare bounds; ``sizes`` are those limited to the bounds before."""
        before, now, sizes = before.ravel(), now.ravel(), sizes.ravel()
        nodes = np.flatnonzero(before != now).astype(np.int32)
        then, today, size = before[nodes], now[nodes], sizes[nodes]
        return cls(nodes, nodes[(today > then) & (size >= then)], nodes[today < size])
