"""Regions that a surface with edges of more than two facets encloses."""

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import components_of, pairs_of_cells
from adaptsize.geometry.enclosed import cone_measures
from adaptsize.typing import BoolArray, FloatArray, IndexArray

#: A volume below this times an area and the diagonal is none, and neither is a difference of areas
#: below this times their sum.  It is above the rounding of the single precision of STL files.
_FLAT = 1e-6


class Shells(NamedTuple):
    """What is on both sides of each facet."""

    is_inner: BoolArray
    """bool[n_cells]: facets that no component has to the outside: between two regions, with the
    same region on both sides, and copies of other facets."""
    points_inward: BoolArray
    """bool[n_cells]: facets whose normal points into a region; False for inner facets."""


def pieces_of(mesh: SimplexMesh) -> IndexArray:
    """Return the number of the component of each facet, which edges connect."""
    n = mesh.n_cells
    beside = np.column_stack([np.repeat(np.arange(n), 3), n + mesh.cell_facets.ravel()])
    label = components_of(beside, n + len(mesh.edges))[:n]
    return np.asarray(np.unique(label, return_inverse=True)[1].reshape(-1), np.intp)


def shells_of(mesh: SimplexMesh) -> Shells:
    """Return which facets of a surface bound a region.

    Around each edge, a facet and the next one face the same region.  So the sides of facets form
    shells, each around one region.  The outermost shell of a component has the volume of least
    sign: the region outside of it is not bounded.  The orientation of the facets does not matter.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in space, without open edges.
    """
    n, kept, component = mesh.n_cells, ~_copies(mesh), pieces_of(mesh)
    shell = components_of(_joined_sides(mesh, kept), 2 * n)
    # Side 2 c is that to which the normal of facet c points.
    cones = cone_measures(mesh, mesh.points[mesh.cells].mean(axis=(0, 1)))
    signed = np.where(kept, cones, 0.0)
    volume = np.bincount(shell, np.column_stack([-signed, signed]).ravel(), 2 * n)
    front, back = shell[::2], shell[1::2]
    lowest = np.full(int(component.max()) + 1, np.inf)
    for side in (front, back):
        np.minimum.at(lowest, component[kept], volume[side[kept]])
    area = np.bincount(component, mesh.measures)
    lowest = np.where(lowest < -_FLAT * area * mesh.diagonal, lowest, -np.inf)[component]
    at_front, at_back = volume[front] == lowest, volume[back] == lowest
    return Shells(~kept | (at_front == at_back), kept & at_back & ~at_front)


def _joined_sides(mesh: SimplexMesh, kept: BoolArray) -> IndexArray:
    """Return pairs of sides of facets that face the same region, intp[n, 2]."""
    corner = np.flatnonzero(np.repeat(kept, 3))
    cell, v = np.divmod(corner, 3)
    edge = mesh.cell_facets[cell, v]
    start, end = (mesh.points[mesh.edges[edge, k]] for k in (0, 1))
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    across = mesh.points[mesh.cells[cell, v]] - start
    across -= np.einsum("ij,ij->i", across, along)[:, None] * along
    first = np.zeros(len(mesh.edges), np.intp)
    first[edge[::-1]] = np.arange(len(edge))[::-1]
    u = across[first[edge]]
    turn = np.einsum("ij,ij->i", np.cross(u, across), along)
    angle = np.arctan2(turn, np.einsum("ij,ij->i", u, across))
    angle[first[edge] == np.arange(len(edge))] = 0.0
    # The normal points to larger angles if the nodes of the facet follow those of the edge.
    ahead = mesh.cells[cell, (v + 1) % 3] == mesh.edges[edge, 0]
    after, before = 2 * cell + ~ahead, 2 * cell + ahead
    order = np.lexsort((angle % (2.0 * np.pi), edge))
    counts = np.bincount(edge, minlength=len(mesh.edges))
    counts = counts[counts > 0]
    last = np.cumsum(counts) - 1
    following = np.arange(1, len(order) + 1)
    following[last] = last - counts + 1
    return np.column_stack([after[order], before[order[following]]])


def _copies(mesh: SimplexMesh) -> BoolArray:
    """Return the facets of patches that lie on others, with the same rim of edges in common."""
    copies = np.zeros(mesh.n_cells, np.bool_)
    sides = pairs_of_cells(mesh, mesh.facet_cell_counts == 2)
    patch = components_of(sides // 3, mesh.n_cells)
    cell, v = np.nonzero(mesh.facet_cell_counts[mesh.cell_facets] > 2)
    edges_of_rim = defaultdict(set)
    for number, edge in zip(patch[cell].tolist(), mesh.cell_facets[cell, v].tolist(), strict=True):
        edges_of_rim[number].add(edge)
    order = np.argsort(patch, kind="stable")
    cells_of = np.split(order, np.flatnonzero(np.diff(patch[order])) + 1)
    of_rim = defaultdict(list)
    for number, rim in edges_of_rim.items():
        of_rim[frozenset(rim)].append(cells_of[number])
    for patches in of_rim.values():
        for k, cells in enumerate(patches):
            copies[cells] = any(_coincide(mesh, cells, other) for other in patches[:k])
    return copies


def _coincide(mesh: SimplexMesh, one: IndexArray, other: IndexArray) -> bool:
    """Return whether two flat patches of the same rim lie in one plane."""
    apex: FloatArray = mesh.points[mesh.cells[one[0], 0]]
    cells = np.concatenate([one, other])
    both = float(mesh.measures[cells].sum())
    away = np.abs(cone_measures(mesh, apex)[cells]).sum()
    change = abs(float(mesh.measures[one].sum() - mesh.measures[other].sum()))
    return bool(away <= _FLAT * both * mesh.diagonal and change <= _FLAT * both)
