"""Points that coincide, or nearly so, and an order of nodes and cells by their places."""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background import tuning
from adaptsize.background.simplex import SimplexMesh
from adaptsize.background.topology import components_of, unique_rows
from adaptsize.typing import FloatArray, IndexArray

# Larger coordinates, in units of the distance, are clipped, as their squares would overflow.
_FARTHEST = 1e150
# Points along a line that may be as close to each other as near ones, before a tree is used.
_MOST_STEPS = 8


def place_numbers(points: FloatArray, within: float) -> IndexArray:
    """Return for each point the number of its place, starting from 0.

    Two points are in the same place if their distance is at most ``within``, or if a chain of
    such points joins them.  Rounding to a lattice instead would separate neighbours on the two
    sides of a lattice cell boundary.

    Parameters
    ----------
    points : float64[n, dim]
        Finite.
    within : float
        Distance >= 0; with 0, only equal points are in the same place.

    Returns
    -------
    intp[n]

    Examples
    --------
    >>> place_numbers(np.array([[0.0], [0.9], [5.0], [1.8], [3.0]]), 1.0)
    array([0, 0, 1, 0, 2])
    """
    # Merge equal points first: many points at one place would form too many pairs.
    distinct, number = merge_equal_points(points)
    if within > 0.0 and len(distinct) > 1:
        number = _joined(distinct, within)[number]
    return number


def corner_distance(points: FloatArray, cells: npt.NDArray[Any]) -> float:
    """Return up to which distance the corners of triangles are one, from the triangles.

    It is 0 if all edges meet exactly.  Otherwise it is the smallest distance, up to a factor of 2,
    that joins as many open edges as a tenth of the shortest edge does.  If most edges are open, the
    coordinates are noisy, and a quarter must become joined.  Otherwise only seams are open, and the
    distance is at most 1e-6 of the diagonal: two sheets may be meant to lie side by side.

    Parameters
    ----------
    points : float64[n_points, dim]
    cells : int[n_cells, 3]

    Examples
    --------
    Two triangles whose common corners differ by about 1e-6:

    >>> points = np.array([[0, 0], [1, 0], [0, 1], [1, 1e-6], [1, 1], [1e-6, 1]])
    >>> 1e-6 <= corner_distance(points, np.array([[0, 1, 2], [3, 4, 5]])) < 3e-6
    True
    """
    if not np.isfinite(points).all():
        return 0.0
    sides = _sides(cells)
    is_open = _are_alone(sides)
    n_open = int(is_open.sum())
    if n_open == 0:
        return 0.0
    rim = cells[is_open.reshape(3, -1).any(axis=0)]
    ends = points[_sides(rim)]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    longest = tuning.SHARE_OF_EDGE * float(lengths[lengths > 0.0].min(initial=np.inf))
    is_noisy = n_open > 0.5 * (n_open + 0.5 * (len(sides) - n_open))
    if not is_noisy:
        longest = min(longest, tuning.SEAM * float(np.linalg.norm(np.ptp(points, axis=0))))
    nodes, on_rim = np.unique(sides[is_open], return_inverse=True)
    on_rim = on_rim.reshape(-1, 2)

    def joined(within: float) -> int:
        place = place_numbers(points[nodes], within)
        return n_open - int(_are_alone(place[on_rim]).sum())

    if not np.isfinite(longest) or longest == 0.0:
        return 0.0
    most = joined(longest)
    if most < (tuning.LEAST_JOINED * n_open if is_noisy else 1):
        return 0.0
    while joined(0.5 * longest) == most:
        longest *= 0.5
    return longest


def _sides(cells: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]])


def _are_alone(sides: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Return whether the nodes of a side are those of no other one."""
    number = unique_rows(sides.astype(np.int32), int(sides.max()) + 1)[1]
    return np.asarray(np.bincount(number)[number] == 1)


#: A unit vector along which no two points of a regular grid are at one place.
_DIRECTION = np.sqrt([0.2, 0.3, 0.5])


def merge_equal_points(points: npt.NDArray[Any]) -> tuple[FloatArray, IndexArray]:
    """Return the distinct points in order of first appearance, and the number of each.

    Points are merged if all coordinates are equal (0 equals -0), not if they are only close.
    """
    exact = points.astype(np.float64) + 0.0  # -0 becomes 0
    # Sorting one hash is several times faster than rows.
    _, first, number = np.unique(hashes_of(exact), return_index=True, return_inverse=True)
    if not np.array_equal(exact[first[number]], exact):  # two points share a hash
        _, first, number = np.unique(exact, axis=0, return_index=True, return_inverse=True)
        number = number.reshape(-1)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return exact[first[order]], rank[number]


def hashes_of(points: FloatArray) -> npt.NDArray[np.uint64]:
    """Return a number for each point that depends on its coordinates only; 0 equals -0."""
    bits = (np.ascontiguousarray(points) + 0.0).view(np.uint64)
    mixed = np.zeros(len(points), np.uint64)
    for column in bits.T:
        mixed = (mixed ^ column) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
        mixed *= np.uint64(0xBF58476D1CE4E5B9)
        mixed ^= mixed >> np.uint64(32)
    return mixed


def nodes_there(points: FloatArray, places: FloatArray, within: float) -> IndexArray:
    """Return for each place the nearest of some points within a distance, -1 if there is none.

    Points are sorted along a line on which hardly any two are so close; a tree, which is needed
    otherwise, takes three times as long.  Coordinates have to be known to less than the distance.
    """
    along = _DIRECTION[: points.shape[1]]
    on_line, width = points @ along, 2.0 * within
    order = np.argsort(on_line)
    on_line = on_line[order]
    if (np.diff(on_line) <= 2.0 * width).any():
        from scipy.spatial import cKDTree

        distance, number = cKDTree(points).query(places, distance_upper_bound=within)
        return np.where(np.isfinite(distance), number, -1)
    # At most one point is as close on the line.
    row = np.searchsorted(on_line, places @ along - width).clip(max=len(order) - 1)
    number = order[row]
    near = np.square(points[number] - places).sum(axis=1) <= within * within
    return np.where(near, number, -1)


def first_at_place(points: FloatArray, within: float) -> IndexArray:
    """Return for each point the first point that is in the same place (see `place_numbers`)."""
    number = place_numbers(points, within)
    first = np.unique(number, return_index=True)[1]
    return np.asarray(first[number])


def _joined(points: FloatArray, within: float) -> IndexArray:
    """Return the component number of each of a set of distinct points."""
    with np.errstate(over="ignore"):
        scaled = np.clip(points / within, -_FARTHEST, _FARTHEST)
    pairs = _near_pairs(scaled)
    if pairs is None:
        from scipy.spatial import cKDTree

        pairs = cKDTree(scaled, balanced_tree=False).query_pairs(1.0, output_type="ndarray")
    return components_of(pairs, len(points))


def _near_pairs(points: FloatArray) -> IndexArray | None:
    """Return the pairs of points whose distance is at most 1, or None if that takes too long.

    Points are sorted along a line that is perpendicular to no usual plane.  If the distance is
    small compared with the part, hardly any points are close to each other along the line but near
    ones.
    """
    line = np.array([0.53, 0.67, 0.5196][: points.shape[1]])
    along = points @ line
    order = np.argsort(along, kind="stable")
    along = along[order]
    allowed = 1.0 + 8.0 * np.finfo(float).eps * np.abs(points).max()  # with rounding
    pairs, left = [np.empty((0, 2), np.intp)], np.arange(len(points) - 1)
    for step in range(1, _MOST_STEPS):
        left = left[left + step < len(points)]
        left = left[along[left + step] - along[left] <= allowed]
        if len(left) == 0:
            return np.concatenate(pairs)
        one, other = order[left], order[left + step]
        apart = points[one] - points[other]
        near = np.einsum("ij,ij->i", apart, apart) <= 1.0
        pairs.append(np.column_stack([one, other])[near])
    return None


def ordered_by_place(mesh: SimplexMesh) -> tuple[SimplexMesh, IndexArray]:
    """Return a mesh with its nodes sorted by their coordinates, and its cells by their nodes.

    What is computed from it is the same for any order of nodes and cells, bit for bit, unless nodes
    coincide.  Data are dropped.

    Returns
    -------
    SimplexMesh
    intp[n_points]
        The node of the given mesh at each node.

    Examples
    --------
    >>> mesh = SimplexMesh([[1, 0], [0, 0], [0, 1]], [[0, 2, 1]])
    >>> ordered, nodes = ordered_by_place(mesh)
    >>> ordered.cells.tolist(), nodes.tolist()
    ([[0, 2, 1]], [1, 2, 0])
    """
    nodes = np.lexsort(mesh.points.T[::-1])
    ordered = reordered(mesh, nodes)
    cells = ordered.cells
    if mesh.cell_dim == 2:  # begin with the first node and keep the orientation
        start = cells.argmin(axis=1)[:, None]
        cells = np.take_along_axis(cells, (start + np.arange(3)) % 3, axis=1)
    order = np.lexsort(cells.T[::-1])
    tags = None if mesh.cell_tags is None else mesh.cell_tags[order]
    return replace(ordered, cells=cells[order], cell_tags=tags), nodes


def reordered(
    mesh: SimplexMesh, nodes: IndexArray, cells: IndexArray | slice = slice(None)
) -> SimplexMesh:
    """Return a mesh with its nodes and cells in another order.  Data are dropped."""
    number = np.empty(mesh.n_points, np.int32)
    number[nodes] = np.arange(mesh.n_points, dtype=np.int32)
    return replace(
        mesh,
        points=mesh.points[nodes],
        cells=number[mesh.cells[cells]],
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[cells],
        tagged_facets=None if mesh.tagged_facets is None else number[mesh.tagged_facets],
        point_data={},
        cell_data={},
    )
