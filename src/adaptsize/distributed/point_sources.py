"""Sources between the nodes of a distributed mesh; all ranks have all of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.pieces import Piece, components_of
from adaptsize.limiting.exact.api import OUTSIDE
from adaptsize.limiting.exact.problem import Extra
from adaptsize.limiting.problem import PointBounds
from adaptsize.typing import IntArray


class Located(NamedTuple):
    """Sources between the nodes, and the components that they lie in."""

    given: PointBounds
    pairs: IntArray
    """int32[k, 2]: a component and one of the points in it, in ascending order."""

    def extra(self, component: int, piece: Piece) -> Extra | None:
        """Return the sources in a component; None if there are none."""
        chosen = self.pairs[self.pairs[:, 0] == component, 1]
        if len(chosen) == 0:
            return None
        points = np.ascontiguousarray(self.given.points[chosen])
        return Extra(points, self.given.sizes[chosen], piece.mesh.n_points + chosen)


def locate(part: PartitionedMesh, given: PointBounds | None) -> Located | None:
    """Return the sources that lie in the domain, with their components; collective.

    Each rank sends pairs of numbers for the points in its part (one gather).
    """
    if given is None:
        return None
    pairs = np.empty((0, 2), np.int32)
    number = components_of(part).number
    reach = OUTSIDE * part.diagonal
    if part.mesh is not None:
        which, cells = part.mesh.locator.within(given.points, reach)
        pairs = np.column_stack([number[part.cells[cells, 0]], which]).astype(np.int32)
        pairs = np.unique(pairs[np.isfinite(given.sizes)[which]], axis=0)
    every: IntArray = np.unique(np.concatenate(part.ranks.allgather(pairs)), axis=0)
    return Located(given, every)
