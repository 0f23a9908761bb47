"""Sectors of surfaces: fans of triangles around a node between feature edges (creases)."""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.vectors import between, cross, dot, norm, triple, unit


class Surface(NamedTuple):
    """Triangles in space.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 3]
    cell_facets : int32[m, 3]
    facet_cells : int32[n_facets, 2]
        The cells at each facet of two, else -1.
    normals : float64[m, 3]
        Unit normals in the orientation of each triangle, that of a neighbour where a
        triangle is degenerate.
    areas : float64[m]
        Zero where degenerate.
    """

    points: np.ndarray
    cells: np.ndarray
    cell_facets: np.ndarray
    facet_cells: np.ndarray
    normals: np.ndarray
    areas: np.ndarray


class Sectors(NamedTuple):
    """Fans of triangles around nodes between feature edges.

    Parameters
    ----------
    sector : int32[3 m]
        Number of the sector of corner 3 c + v.
    sign : float64[3 m]
        -1 where the triangle is oriented against the first one of its sector, or 1.
    fan : int32[3 m]
        The corners of sector s are ``fan[fan_ptr[s] : fan_ptr[s + 1]]``.
    fan_ptr : int32[n_sectors + 1]
    ends : int32[n_sectors, 2]
        Far nodes of the two feature edges around the sector; -1: closed.
    """

    sector: np.ndarray
    sign: np.ndarray
    fan: np.ndarray
    fan_ptr: np.ndarray
    ends: np.ndarray


@inner
def normalise(a):
    """Scale float64[3] to length 1 (In/Out); zero stays zero."""
    a[0], a[1], a[2] = unit(a)


@inner
def _local(cells, c, i):
    """Return the place of node i in triangle c."""
    for v in range(2):
        if cells[c, v] == i:
            return v
    return 2


@inner
def _agreement(cells, c, other, i, j):
    """Return 1 if two triangles run along their common edge (i, j) in opposite directions, else -1.

    They do in an oriented surface.
    """
    forward = cells[c, (_local(cells, c, i) + 1) % 3] == j
    forward_other = cells[other, (_local(cells, other, i) + 1) % 3] == j
    return -1.0 if forward == forward_other else 1.0


@kernel
def fill_face_normals(points, cells, flat_share, normals, areas):
    """Fill unit normals and areas of triangles in space, in the orientation of each triangle.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 3]
    flat_share : float
        Triangles with area <= ``flat_share`` times the longest edge squared are degenerate.
    normals : float64[m, 3]
        Out: zero where degenerate.
    areas : float64[m]
        Out: zero where degenerate.
    """
    for c in range(cells.shape[0]):
        longest, shortest = 0, 0
        i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
        edge = (between(points, j, k), between(points, k, i), between(points, i, j))
        for v in range(3):
            if dot(edge[v], edge[v]) > dot(edge[longest], edge[longest]):
                longest = v
            if dot(edge[v], edge[v]) < dot(edge[shortest], edge[shortest]):
                shortest = v
        # The product with the shortest edge loses least to cancellation.
        across = cross(edge[shortest], edge[(shortest + 1) % 3])
        normal, areas[c] = unit(across), 0.5 * norm(across)
        is_flat = areas[c] <= flat_share * dot(edge[longest], edge[longest])
        for d in range(3):
            normals[c, d] = 0.0 if is_flat else normal[d]
        if is_flat:
            areas[c] = 0.0


@kernel
def replace_degenerate_normals(surface):
    """Give each degenerate triangle the normal of its neighbour across its longest edge.

    A degenerate triangle has collapsed onto that edge, so that the surface there is the
    neighbour's.  Its normal stays zero where that neighbour is degenerate, too (In/Out: normals).
    """
    points, cells, normals, areas = surface.points, surface.cells, surface.normals, surface.areas
    for c in range(cells.shape[0]):
        if areas[c] > 0.0:
            continue
        longest, best = 0, -1.0
        for v in range(3):
            edge = between(points, cells[c, (v + 1) % 3], cells[c, (v + 2) % 3])
            if dot(edge, edge) > best:
                longest, best = v, dot(edge, edge)
        f = surface.cell_facets[c, longest]
        if surface.facet_cells[f, 0] < 0:
            continue
        other = surface.facet_cells[f, 0] + surface.facet_cells[f, 1] - c
        if areas[other] > 0.0:
            i, j = cells[c, (longest + 1) % 3], cells[c, (longest + 2) % 3]
            sign = _agreement(cells, c, other, i, j)
            for d in range(3):
                normals[c, d] = sign * normals[other, d]


@kernel
def mark_creases(surface, facets, angle, is_crease):
    """Mark the edges that are boundary, non-manifold or sharper than ``angle``.

    Parameters
    ----------
    surface : Surface
        In any orientation.
    facets : int32[n_facets, 2]
    angle : float
        In radians.
    is_crease : bool[n_facets]
        Out.
    """
    normals = surface.normals
    for f in range(facets.shape[0]):
        is_crease[f] = True
        if surface.facet_cells[f, 0] < 0:
            continue
        c, other = np.int64(surface.facet_cells[f, 0]), np.int64(surface.facet_cells[f, 1])
        sign = _agreement(surface.cells, c, other, facets[f, 0], facets[f, 1])
        one, two = triple(normals, c, 0), triple(normals, other, 0)
        # atan2 keeps small angles exact, where acos loses half the digits.
        turn = math.atan2(norm(cross(one, two)), sign * dot(one, two))
        is_crease[f] = turn > angle


@inner
def _walk(surface, is_crease, sectors, start, count):
    """Walk around a node from corner to corner until a feature edge; return the new count.

    Parameters
    ----------
    surface : Surface
    is_crease : bool[n_facets]
    sectors : Sectors
        In/Out.
    start : tuple of 2 int
        First corner, 3 c + v, which has its sector and sign already, and 1 or 2: the first edge
        to cross is the one opposite to local vertex v plus this number.
    count : int
        Corners in the fan so far.

    Returns
    -------
    count : int
        It grew by the corners met.
    last : int
        Far node of the feature edge where the walk stopped; -1: the fan is closed.
    """
    cells, sector, sign = surface.cells, sectors.sector, sectors.sign
    first, towards = start
    c, v = first // 3, first % 3
    out = (v + towards) % 3
    i = cells[c, v]
    while True:
        f = surface.cell_facets[c, out]
        j = cells[c, 3 - v - out]
        if is_crease[f]:
            return count, j
        other = surface.facet_cells[f, 0] + surface.facet_cells[f, 1] - c
        w = _local(cells, other, i)
        corner = 3 * other + w
        if sector[corner] >= 0:
            return count, -1
        sector[corner] = sector[first]
        sign[corner] = sign[3 * c + v] * _agreement(cells, c, other, i, j)
        sectors.fan[count] = corner
        count += 1
        # Leave through the other edge at i, opposite to the node of the edge just crossed.
        c, v, out = other, w, _local(cells, other, j)


@kernel
def fill_sectors(surface, is_crease, sectors):
    """Group the corners of triangles into sectors: fans around a node between feature edges.

    Parameters
    ----------
    surface : Surface
    is_crease : bool[n_facets]
    sectors : Sectors
        Out: with room for as many sectors as corners, filled up to their number.

    Returns
    -------
    int
        Number of sectors.
    """
    sector, ends = sectors.sector, sectors.ends
    sector[:] = -1
    sectors.fan_ptr[0] = 0
    count, n_sectors = 0, 0
    ahead, back = np.int64(1), np.int64(2)  # _walk would be compiled for each literal
    for corner in range(sector.shape[0]):
        if sector[corner] >= 0:
            continue
        sector[corner] = n_sectors
        sectors.sign[corner] = 1.0
        sectors.fan[count] = corner
        count, ends[n_sectors, 0] = _walk(surface, is_crease, sectors, (corner, ahead), count + 1)
        ends[n_sectors, 1] = -1
        if ends[n_sectors, 0] >= 0:
            count, ends[n_sectors, 1] = _walk(surface, is_crease, sectors, (corner, back), count)
        n_sectors += 1
        sectors.fan_ptr[n_sectors] = count
    return n_sectors
