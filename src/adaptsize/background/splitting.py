"""New nodes in the middle of chosen edges."""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from adaptsize.background._mesh_arrays import lengths
from adaptsize.background.simplex import SimplexMesh
from adaptsize.background.topology import are_among, ascending, marked, rows_among
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

# Cases of triangles with two new nodes, by how the trapezium is cut.
_BY_B, _BY_C, _BY_BOTH = 4, 5, 6
# The parts of triangles by the number of new nodes, or by these cases.  Corners are 0 to 2, 3 to 5
# the new nodes on the opposite edges, in the last case 3 the centre of the trapezium.
_PIECES = {
    1: [[0, 1, 3], [0, 3, 2]],
    _BY_B: [[0, 5, 4], [1, 2, 4], [1, 4, 5]],
    _BY_C: [[0, 5, 4], [1, 2, 5], [2, 4, 5]],
    3: [[0, 5, 4], [1, 3, 5], [2, 4, 3], [3, 4, 5]],
    _BY_BOTH: [[0, 5, 4], [5, 1, 3], [1, 2, 3], [2, 4, 3], [4, 5, 3]],
}


class SplitMesh(NamedTuple):
    """A mesh in which some edges were split.

    Parameters
    ----------
    mesh : SimplexMesh
        The old nodes, then one per split edge, then those inside triangles; with tags, no
        data.
    split_edges : IndexArray
        New node k lies in the middle of edge ``split_edges[k]`` of the old mesh.
    inside : IndexArray
        The triangle of the old mesh in which each of the last nodes lies.
    parents : IndexArray
        The triangle of the old mesh of which each triangle is a part.
    """

    mesh: SimplexMesh
    split_edges: IndexArray
    inside: IndexArray
    parents: IndexArray


def split_edges(mesh: SimplexMesh, chosen: BoolArray) -> SplitMesh:
    """Return triangles with a new node in the middle of each chosen edge.

    A triangle is split into 2, 3 or 4 triangles, depending on the number of chosen edges.
    They keep its tag and orientation.  Halves of tagged edges keep the tag.  With two chosen
    edges, the rest is cut along its shorter diagonal, or along both if they are of equal length,
    so that the result does not depend on the order of the nodes.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles.
    chosen : bool[n_edges]
        One entry per edge of ``mesh.edges``.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> split_edges(mesh, np.array([True, False, False])).mesh.cells.tolist()
    [[2, 0, 3], [2, 3, 1]]
    """
    if mesh.cell_dim != 2:
        raise ValueError(f"mesh must consist of triangles, got {mesh!r}")
    where = np.flatnonzero(chosen)
    middle = np.full(len(mesh.edges), -1, np.int32)
    middle[where] = mesh.n_points + np.arange(len(where), dtype=np.int32)
    points = np.concatenate([mesh.points, mesh.points[mesh.edges[where]].mean(axis=1)])
    middles = middle[mesh.cell_facets]  # the facets of triangles are their edges, in this order
    count = (middles >= 0).sum(axis=1)
    # Rotate each triangle so that the edge that differs from the others is opposite to 0.
    odd = np.where((count == 1)[:, None], middles >= 0, middles < 0)
    turn = (np.argmax(odd, axis=1)[:, None] + np.arange(3)) % 3
    nodes = np.take_along_axis(np.hstack([mesh.cells, middles]), np.hstack([turn, turn + 3]), 1)
    # Of a triangle with two middles, the rest is a trapezium.
    case, two = count.copy(), np.flatnonzero(count == 2)
    _, b, c, _, on_ca, on_ab = points[nodes[two]].swapaxes(0, 1)
    from_b, from_c = np.linalg.norm(b - on_ca, axis=1), np.linalg.norm(c - on_ab, axis=1)
    case[two] = np.where(from_b <= from_c, _BY_B, _BY_C)
    lengths = mesh.edge_lengths[mesh.cell_facets[two]][np.arange(len(two))[:, None], turn[two, 1:]]
    # Lengths that differ by a smaller share are equal.
    case[two[lengths.max(axis=1) <= (1.0 + 1e-9) * lengths.min(axis=1)]] = _BY_BOTH
    inside = np.flatnonzero(case == _BY_BOTH)
    nodes[inside, 3] = len(points) + np.arange(len(inside))
    # In the middle between the middles of the parallel sides, whatever their order.
    sides = [points[nodes[inside][:, ends]].mean(axis=1) for ends in ([1, 2], [4, 5])]
    points = np.concatenate([points, 0.5 * (sides[0] + sides[1])])
    parts, owners = [mesh.cells[count == 0]], [np.flatnonzero(count == 0)]
    for cases in ([1], [_BY_B, _BY_C], [3], [_BY_BOTH]):
        rows = np.flatnonzero(np.isin(case, cases))
        pieces = np.array([_PIECES[one] for one in cases])[np.searchsorted(cases, case[rows])]
        parts += [np.take_along_axis(nodes[rows], piece, 1) for piece in pieces.swapaxes(0, 1)]
        owners += [rows] * pieces.shape[1]
    owner = np.concatenate(owners)
    new = _split(mesh, points, np.concatenate(parts), owner, mesh.edges, middle)
    return SplitMesh(new, where, inside, owner)


# The octahedron between the middles of a tetrahedron: each diagonal, and the ring around it.  Edges
# are in the order of `combinations`: 01, 02, 03, 12, 13, 23.
_DIAGONALS = [[0, 5, 1, 2, 4, 3], [1, 4, 0, 2, 5, 3], [2, 3, 0, 1, 5, 4]]


def halve_tetrahedra(mesh: SimplexMesh) -> SimplexMesh:
    """Return tetrahedra with a new node in the middle of each edge, eight for each; with tags.

    A facet becomes four, the same from both sides.  The octahedron that is left in the middle is
    cut along its shortest diagonal [1]_.  Fields are dropped.

    References
    ----------
    .. [1] S. Zhang, "Successive subdivisions of tetrahedra and multigrid methods on tetrahedral
       meshes", Houston Journal of Mathematics 21 (1995) 541-556.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    >>> halve_tetrahedra(mesh).n_cells
    8
    """
    n, middle = mesh.n_points, _edge_numbers(mesh.edges, mesh.cells) + mesh.n_points
    points = np.concatenate([mesh.points, mesh.points[mesh.edges].mean(axis=1)])
    parts = []
    for corner in range(4):
        part = mesh.cells.copy()
        for k, pair in enumerate(combinations(range(4), 2)):
            if corner in pair:
                part[:, sum(pair) - corner] = middle[:, k]
        parts.append(part)
    rings = middle[:, _DIAGONALS]
    first, last = points[rings[:, :, 0]], points[rings[:, :, 1]]
    shortest = np.argmin(np.linalg.norm(last - first, axis=2), axis=1)
    ring = rings[np.arange(mesh.n_cells), shortest]
    parts += [ring[:, [0, 1, 2 + k, 2 + (k + 1) % 4]] for k in range(4)]
    cells = np.concatenate(parts).astype(np.int32)
    facets, tags = mesh.tagged_facets, mesh.facet_tags
    if facets is not None and tags is not None:
        # Facets that the mesh does not have stay as they are.
        number = _edge_numbers(mesh.edges, facets)[:, [2, 1, 0]]
        known = (number >= 0).all(axis=1)
        six = np.hstack([facets[known], number[known] + n])
        facets = np.concatenate([facets[~known], *(six[:, piece] for piece in _PIECES[3])])
        tags = np.concatenate([tags[~known], *[tags[known]] * len(_PIECES[3])])
    return SimplexMesh(
        points, cells,
        cell_tags=None if mesh.cell_tags is None else np.tile(mesh.cell_tags, 8),
        tagged_facets=facets, facet_tags=tags, tag_names=mesh.tag_names,
    )  # fmt: skip


def _split(
    mesh: SimplexMesh,
    points: FloatArray,
    cells: IntArray,
    owner: IndexArray,
    edges: IntArray,
    middle: IntArray,
) -> SimplexMesh:
    """Return a mesh of new cells with the tags of the old ones.

    ``owner``: the old cell of each new one; ``middle``: the new node of each of ``edges``, -1 where
    it is not split, as all other edges.
    """
    facets, tags = mesh.tagged_facets, mesh.facet_tags
    if facets is not None and tags is not None:
        middles = np.append(middle, np.int32(-1))[_edge_numbers(edges, facets)]
        facets, of_facet = _bisected(facets, middles)
        tags = tags[of_facet]
    return SimplexMesh(
        points,
        cells,
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[owner],
        tagged_facets=facets,
        facet_tags=tags,
        tag_names=mesh.tag_names,
    )


def halved_edges(edges: IntArray, split: IntArray, n_points: int) -> tuple[IntArray, IndexArray]:
    """Return ``edges`` with those in ``split`` halved, and the row of ``edges`` of each.

    Row k of ``split`` has the midpoint n_points + k.
    """
    row, whole = rows_among(split, edges), np.flatnonzero(~are_among(edges, split))
    cut = np.flatnonzero(row >= 0)
    middle = (n_points + cut).astype(np.int32)
    halves = [np.column_stack([split[cut, end], middle]) for end in (0, 1)]
    return np.concatenate([edges[whole], *halves]), np.concatenate([whole, row[cut], row[cut]])


class BisectedMesh(NamedTuple):
    """A mesh in which no cell was divided into more than two.

    Parameters
    ----------
    mesh : SimplexMesh
        The old nodes, then one per split edge; with tags, no data.
    split : IndexArray
        New node k lies in the middle of row ``split[k]`` of the chosen edges.
    parents : IndexArray
        The cell of the old mesh of which each cell is a part.
    """

    mesh: SimplexMesh
    split: IndexArray
    parents: IndexArray


def bisect_edges(mesh: SimplexMesh, edges: IntArray) -> BisectedMesh:
    """Return cells of any kind, those at some of the chosen edges divided into two.

    Of the chosen edges, those are split that are longest in all of their cells, so that no cell is
    divided twice.  Chosen edges that remain can be split by further calls.  If they are few, this
    takes much less time than finding the edges of the mesh.

    Parameters
    ----------
    mesh : SimplexMesh
    edges : int32[n, 2]
        Edges of the mesh, in any order, each once.

    Returns
    -------
    BisectedMesh
        Tags of cells and facets are kept.  The new nodes are in the order of ``mesh.edges``.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    >>> bisect_edges(mesh, mesh.edges[:3]).mesh.cells.tolist()
    [[4, 1, 2, 3], [0, 4, 2, 3]]
    """
    rows = ascending(edges)
    order = np.lexsort(rows.T[::-1])
    rows, n = rows[order], len(rows)
    rank = np.empty(n, np.intp)
    rank[np.argsort(-lengths(mesh.points, rows), kind="stable")] = np.arange(n)[::-1]
    near = np.flatnonzero(marked(rows, mesh.n_points)[mesh.cells].sum(axis=1) > 1)
    number = _edge_numbers(rows, mesh.cells[near])
    highest = np.full(n + 1, -1)  # the last one is that of the edges that are not chosen
    np.maximum.at(highest, number, np.append(rank, -1)[number].max(axis=1)[:, None])
    where = np.flatnonzero(highest[:-1] == rank)
    middle = np.full(n, -1, np.int32)
    middle[where] = mesh.n_points + np.arange(len(where), dtype=np.int32)
    middles = np.full((mesh.n_cells, number.shape[1]), -1, np.int32)
    middles[near] = np.append(middle, np.int32(-1))[number]
    cells, owner = _bisected(mesh.cells, middles)
    points = np.concatenate([mesh.points, mesh.points[rows[where]].mean(axis=1)])
    return BisectedMesh(_split(mesh, points, cells, owner, rows, middle), order[where], owner)


def _edge_numbers(edges: IntArray, simplices: IntArray) -> IndexArray:
    """Return the row of each edge of each simplex, in order of `combinations`; -1 for none."""
    pairs = np.array(list(combinations(range(simplices.shape[1]), 2)))
    ends = ascending(simplices[:, pairs].reshape(-1, 2))
    return rows_among(ends, edges).reshape(len(simplices), len(pairs))


def _bisected(simplices: IntArray, middle: IntArray) -> tuple[IntArray, IndexArray]:
    """Return simplices with at most one edge each split, and the old number of each.

    ``middle``: the new node on each edge of each simplex, -1 where it is not split.
    """
    is_cut = (middle >= 0).any(axis=1)
    cut, whole = np.flatnonzero(is_cut), np.flatnonzero(~is_cut)
    rows, edge = np.arange(len(cut)), (middle[cut] >= 0).argmax(axis=1)
    pairs = np.array(list(combinations(range(simplices.shape[1]), 2)))
    halves = [simplices[cut], simplices[cut]]
    for half, end in zip(halves, pairs[edge].T, strict=True):
        half[rows, end] = middle[cut, edge]
    return np.concatenate([simplices[whole], *halves]), np.concatenate([whole, cut, cut])
