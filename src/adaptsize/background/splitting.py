"""New nodes in the middle of chosen edges of a triangle mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background.simplex import SimplexMesh
from adaptsize.background.topology import unique_rows
from adaptsize.typing import IntArray


class SplitMesh(NamedTuple):
    """A mesh in which some edges were split."""

    mesh: SimplexMesh
    """The old nodes, then one new node per split edge; with tags, without data."""
    split_edges: npt.NDArray[np.intp]
    """New node k lies in the middle of edge ``split_edges[k]`` of the old mesh."""


def split_edges(mesh: SimplexMesh, chosen: npt.NDArray[np.bool_]) -> SplitMesh:
    """Return triangles with a new node in the middle of each chosen edge.

    A triangle is split into 2, 3 or 4 triangles, depending on the number of chosen edges.
    They keep its tag and orientation.  Halves of tagged edges keep the tag.

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
    parts, owners = [mesh.cells[count == 0]], [np.flatnonzero(count == 0)]
    for n, cut in ((1, _into_two), (2, _into_three), (3, _into_four)):
        rows = np.flatnonzero(count == n)
        # Rotate each triangle so that the edge that differs from the others is opposite to 0.
        odd = (middles[rows] >= 0) if n == 1 else (middles[rows] < 0)
        turn = (np.argmax(odd, axis=1)[:, None] + np.arange(3)) % 3
        corners = np.take_along_axis(mesh.cells[rows], turn, axis=1)
        new = np.take_along_axis(middles[rows], turn, axis=1)
        pieces = cut(corners, new, points)
        parts.extend(pieces)
        owners.extend([rows] * len(pieces))
    owner = np.concatenate(owners)
    tags = None if mesh.cell_tags is None else mesh.cell_tags[owner]
    tagged, facet_tags = _halves_of_tagged(mesh, middle)
    new_mesh = SimplexMesh(
        points,
        np.concatenate(parts),
        cell_tags=tags,
        tagged_facets=tagged,
        facet_tags=facet_tags,
        tag_names=mesh.tag_names,
    )
    return SplitMesh(new_mesh, where)


def _halves_of_tagged(
    mesh: SimplexMesh, middle: IntArray
) -> tuple[IntArray | None, IntArray | None]:
    """Return the tagged edges after splitting and their tags.

    ``middle``: the new node of each edge, -1 where it is not split.
    """
    if mesh.tagged_facets is None or mesh.facet_tags is None:
        return None, None
    tagged = np.sort(mesh.tagged_facets, axis=1)
    _, number = unique_rows(np.concatenate([mesh.edges, tagged]), mesh.n_points)
    middle_of = np.full(int(number.max(initial=-1)) + 1, -1, np.int32)
    middle_of[number[: len(mesh.edges)]] = middle
    new = middle_of[number[len(mesh.edges) :]]
    split = new >= 0
    first = np.column_stack([tagged[:, 0], np.where(split, new, tagged[:, 1])])
    second = np.column_stack([new, tagged[:, 1]])[split]
    tags = mesh.facet_tags
    return np.concatenate([first, second]), np.concatenate([tags, tags[split]])


def _into_two(corners: IntArray, new: IntArray, _: npt.NDArray[np.float64]) -> list[IntArray]:
    a, b, c = corners.T
    return [np.column_stack([a, b, new[:, 0]]), np.column_stack([a, new[:, 0], c])]


def _into_three(
    corners: IntArray, new: IntArray, points: npt.NDArray[np.float64]
) -> list[IntArray]:
    a, b, c = corners.T
    on_ab, on_ca = new[:, 2], new[:, 1]
    # The rest b, c, on_ca, on_ab is a trapezium, cut along its shorter diagonal.
    from_b = np.linalg.norm(points[b] - points[on_ca], axis=1)
    from_c = np.linalg.norm(points[c] - points[on_ab], axis=1)
    by_b = from_b <= from_c
    first = np.column_stack([b, c, np.where(by_b, on_ca, on_ab)])
    second = np.column_stack([np.where(by_b, b, c), on_ca, on_ab])
    return [np.column_stack([a, on_ab, on_ca]), first, second]


def _into_four(corners: IntArray, new: IntArray, _: npt.NDArray[np.float64]) -> list[IntArray]:
    a, b, c = corners.T
    on_bc, on_ca, on_ab = new.T
    outer = [(a, on_ab, on_ca), (b, on_bc, on_ab), (c, on_ca, on_bc)]
    return [np.column_stack(three) for three in [*outer, (on_bc, on_ca, on_ab)]]
