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
FLAT = 1e-6


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
    lowest = np.where(lowest < -FLAT * area * mesh.diagonal, lowest, -np.inf)[component]
    at_front, at_back = volume[front] == lowest, volume[back] == lowest
    return Shells(~kept | (at_front == at_back), kept & at_back & ~at_front)


def surplus_of(mesh: SimplexMesh) -> BoolArray:
    """Return facets without which the others have no boundary, or none if there are no such ones.

    These are walls between bodies that are given once.  Each edge of a wall is between two other
    facets with consistent orientations.  Without another patch of facets, the others may have no
    boundary either; the patch goes without which the most volume is enclosed.  Unlike
    `shells_of`, this takes consistent orientations, and facets that intersect do no harm.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in space, without open edges.
    """
    n_edges = len(mesh.edges)
    v = np.arange(3)
    ahead = mesh.cells[:, (v + 1) % 3] < mesh.cells[:, (v + 2) % 3]
    sums = np.bincount(mesh.cell_facets.ravel(), np.where(ahead, 1.0, -1.0).ravel(), n_edges)
    if (sums[mesh.facet_cell_counts == 2] != 0.0).any():
        return np.zeros(mesh.n_cells, np.bool_)
    patch = components_of(pairs_of_cells(mesh, mesh.facet_cell_counts == 2) // 3, mesh.n_cells)
    at_rim = mesh.facet_cell_counts[mesh.cell_facets] > 2
    cell, corner = np.nonzero(at_rim)
    rims, row = np.unique(
        np.column_stack([patch[cell], mesh.cell_facets[cell, corner]]), axis=0, return_inverse=True
    )
    own = np.bincount(row.reshape(-1), np.where(ahead[cell, corner], 1.0, -1.0), len(rims))
    of_patch, edge = rims.T
    volume = np.bincount(patch, cone_measures(mesh, mesh.points[mesh.cells].mean(axis=(0, 1))))
    # Of patches of the same volume, as of a facet that is given twice, one goes.
    rank = np.empty(len(volume), np.intp)
    rank[np.argsort(volume, kind="stable")] = np.arange(len(volume))
    is_left = np.ones(len(rims), np.bool_)
    net = np.bincount(edge, own, n_edges)
    while (net != 0.0).any():
        # Patches without which all their edges are balanced.
        fits = np.bincount(of_patch[is_left], net[edge[is_left]] != own[is_left], len(volume)) == 0
        fits &= np.bincount(of_patch[is_left], own[is_left] != 0.0, len(volume)) > 0
        least = np.full(n_edges, len(volume))
        mine = is_left & fits[of_patch]
        np.minimum.at(least, edge[mine], rank[of_patch[mine]])
        loses = mine & (rank[of_patch] > least[edge])
        fits[of_patch[loses]] = False
        gone = is_left & fits[of_patch]
        if not gone.any():
            return np.zeros(mesh.n_cells, np.bool_)
        is_left &= ~gone
        net -= np.bincount(edge[gone], own[gone], n_edges)
    surplus = np.ones(len(volume), np.bool_)
    surplus[of_patch[is_left]] = False
    is_rimless = np.ones(len(volume), np.bool_)
    is_rimless[of_patch] = False
    return np.asarray((surplus & ~is_rimless)[patch])


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
    return bool(away <= FLAT * both * mesh.diagonal and change <= FLAT * both)
