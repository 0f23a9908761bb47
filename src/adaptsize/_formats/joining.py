"""Nodes at one place in plane and solid meshes: cells with nodes of their own.

Programs for discontinuous fields write nodes for each cell.  Such cells are not connected.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background.merging import merge_equal_points
from adaptsize.background.topology import facets_of, have_different_nodes
from adaptsize.typing import FloatArray


class Joined(NamedTuple):
    """Nodes at one place as one."""

    points: FloatArray
    number: npt.NDArray[np.intp]
    """The new number of each node."""


def joined_if_most_are_double(
    points: FloatArray, cells: npt.NDArray[Any], parent: npt.NDArray[Any]
) -> Joined | None:
    """Return the nodes with those at one place joined, if most facets between cells are double.

    Otherwise, facets that are double are slits, which are kept, as are copies of cells.

    Parameters
    ----------
    points : float64[n_points, dim]
    cells : int[n_cells, dim + 1]
    parent : int[n_cells]
        Number of the cell of the file of which each is a part: facets inside of it do not count.
    """
    distinct, number = merge_equal_points(points)
    if len(distinct) == len(points):
        return None
    joined = number[cells]
    if not have_different_nodes(joined).all() or len(np.unique(_ordered(joined), axis=0)) < len(
        joined
    ):
        return None  # cells would lie on others
    before, after = (_facets_beside(c, len(points), parent) for c in (cells, joined))
    n_double = after[1] - before[1]
    return Joined(distinct, number) if n_double > before[1] else None


def _ordered(cells: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.sort(cells, axis=1)


def _facets_beside(
    cells: npt.NDArray[Any], n_points: int, parent: npt.NDArray[Any]
) -> tuple[int, int]:
    """Return the numbers of facets, and of those between two cells of the file."""
    facets, of_cells = facets_of(cells.astype(np.int32), n_points)
    first, last = (np.empty(len(facets), np.int64) for _ in range(2))
    order, owner = of_cells.ravel(), np.repeat(parent, of_cells.shape[1])
    last[order] = owner  # the last value that is assigned stays
    first[order[::-1]] = owner[::-1]
    return len(facets), int(np.count_nonzero(first != last))


def means(values: npt.NDArray[Any], number: npt.NDArray[np.intp], n: int) -> npt.NDArray[Any]:
    """Return the mean of a nodal field at joined nodes; of integers the value of one of them."""
    one = np.empty((n, *values.shape[1:]), values.dtype)
    one[number] = values
    if values.dtype.kind != "f":
        return one
    count = np.bincount(number, minlength=n)
    total = np.zeros((n, *values.shape[1:]))
    np.add.at(total, number, values - one[number])  # equal values stay as they are
    return (one + total / count.reshape(-1, *[1] * (values.ndim - 1))).astype(values.dtype)
