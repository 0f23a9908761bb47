"""The boundary of a plane domain for lines of sight: straight walls, sectors and corners."""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.flat_boundary import merge_walls
from adaptsize._kernels.sight import ANY, NARROW, WIDE
from adaptsize.background import SimplexMesh
from adaptsize.geometry.boundary import FlatBoundary, turns_in_plane
from adaptsize.typing import BoolArray, FloatArray, IntArray


class PlaneBoundary(NamedTuple):
    """The boundary of a plane domain for lines of sight.

    Parameters
    ----------
    walls : float64[w, 4]
        Start and end of each straight piece, the domain to the left.
    rows : int32[n_points]
        Row of each node of the boundary, -1 inside.
    first : int32[b + 1]
        The sectors of the node in row b are ``first[b]`` to ``first[b + 1] - 1``.
    sectors : float64[k, 5]
        Cones of the sectors (see sight.py).
    corners : int32[c]
        Nodes at which shortest paths may bend.
    free : bool[c]
        Whether a path may go from one sector of the corner into another.
    reach : float64[c]
        Length of the shortest edge of the boundary at the corner.
    slack : float
        Distance from a line below which a point is on the line.
    """

    walls: FloatArray
    rows: IntArray
    first: IntArray
    sectors: FloatArray
    corners: IntArray
    free: BoolArray
    reach: FloatArray
    slack: float


def plane_boundary(mesh: SimplexMesh, boundary: FlatBoundary) -> PlaneBoundary:
    r"""Return walls, sectors and corners of a mesh of triangles in the plane.

    Walls on a straight line are merged.  "On a line" is decided by one distance,
    :math:`\delta = 4 u`, where :math:`u = \epsilon \max |x|` is the rounding of the coordinates:
    the nodes of a merged wall are within :math:`\delta` of its chord.  The domain is that within
    the chords, and all the rest follows from them: the sectors of its nodes, and its corners, which
    are all vertices with an angle above 180 degrees.  So walls that are straight up to coarser
    noise are polygons, with a corner at every node that points inwards, and what they hide, their
    corners see.

    *Error.*  A path within the chords becomes one in the domain if its pieces along a chord follow
    the nodes of the walls instead.  Each of these is at most :math:`\delta` away, so that the
    path grows by at most :math:`2 \delta` per node that it passes, and vice versa: a size changes
    by less than :math:`2 \delta g k` if k nodes were merged.  (To first order; along walls of
    length :math:`\ell` it is :math:`\delta^2 / \ell` per node.)

    At a node where one wall enters and one leaves, there is one sector between them.  At other
    nodes the cells are traversed from wall to wall.
    """
    points, (start, end) = mesh.points, boundary.facets.T
    n, turns = mesh.n_points, turns_in_plane(mesh.points, boundary.facets)
    nodes, regular = turns.nodes, turns.once
    # A node is on a line within this distance, in units of the rounding of the coordinates, which
    # moves a node by at most .71 of these, and so from a straight line by 1.42.
    tolerance = 4.0 * float(np.finfo(float).eps * np.abs(points[nodes]).max())
    leaving, entering = np.zeros(n, np.int32), np.zeros(n, np.int32)
    leaving[start] = entering[end] = np.arange(len(start))
    i = nodes[regular]
    back, ahead = turns.into[regular], turns.out[regular]
    off = np.abs(back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0])
    is_end = np.ones(n, np.bool_)
    # If this node and both neighbours are within the distance of one chord, it is within twice
    # the distance of that between the neighbours.
    near = off <= 2.0 * tolerance * np.hypot(*(back + ahead).T)
    is_end[i[near & (np.einsum("ij,ij->i", back, ahead) > 0.0)]] = False
    piece, ends = np.empty(len(start), np.int32), np.empty((len(start), 2), np.int32)
    count = merge_walls(points, (start, end, leaving[end]), is_end, tolerance, piece, ends)
    walls = points[ends[:count]].reshape(-1, 4)
    along = _unit(walls[:, 2:] - walls[:, :2])[piece]
    owner, cones = i, np.concatenate([along[leaving[i]], -along[entering[i]]], axis=1)
    if not regular.all():
        several, fans = _fans(mesh, boundary, nodes[~regular], along)
        owner, cones = np.concatenate([i, several]), np.concatenate([cones, fans])
    rows, first, sectors, angles = _sectors(n, nodes, owner, cones)
    if boundary.alias is not None:
        rows = rows[boundary.alias]

    turn = np.maximum.reduceat(angles, first[:-1])
    free = (np.diff(first) != 1) | (sectors[first[:-1], 4] == ANY)
    bends = is_end[nodes] & (free | (turn > np.pi))
    reach = np.full(n, np.inf)
    length = np.hypot(*(points[end] - points[start]).T)
    np.minimum.at(reach, start, length)
    np.minimum.at(reach, end, length)
    # For lines of sight, in units of the tolerance: two nodes of a merged wall are each at most one
    # off its line, and a cross product rounds by less than 1.5 of the diagonal times epsilon, which
    # is 4.2 of the units of rounding.
    corners, slack = nodes[bends], 4.0 * tolerance
    return PlaneBoundary(walls, rows, first, sectors, corners, free[bends], reach[corners], slack)


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.hypot(*vectors.T)[:, None]
    out = np.zeros_like(vectors)
    np.divide(vectors, length, out=out, where=length > 0.0)
    return out


def _sectors(
    n: int, nodes: IntArray, owner: IntArray, cones: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the rows of nodes, their sectors, and the angles of the sectors, 0 to 2 pi."""
    order = np.argsort(owner, kind="stable")
    owner, cones = owner[order], cones[order]
    rows = np.full(n, -1, np.int32)
    rows[nodes] = np.arange(len(nodes))
    first = np.concatenate([[0], np.cumsum(np.bincount(rows[owner], minlength=len(nodes)))])
    cross = cones[:, 0] * cones[:, 3] - cones[:, 1] * cones[:, 2]
    dot = cones[:, 0] * cones[:, 2] + cones[:, 1] * cones[:, 3]
    angles = np.mod(np.arctan2(cross, dot), 2.0 * np.pi)
    # A narrower sector (radians) surrounds the tip of a slit, whose faces may not coincide.
    angles[angles < 1e-9] = 2.0 * np.pi
    kinds = np.where(angles > np.pi, WIDE, NARROW)
    kinds[(cones == 0.0).all(axis=1)] = ANY
    return rows, first.astype(np.int32), np.column_stack([cones, kinds]), angles


def _fans(
    mesh: SimplexMesh, boundary: FlatBoundary, nodes: IntArray, along: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the sectors at nodes with several walls: their nodes and cones.

    ``along``: float64[f, 2], the directions of the walls.

    A fan of cells begins at a wall and continues through edges that are not walls to the next
    wall.  With folded cells this may fail.  Then all directions are allowed; the walls restrict
    them sufficiently.
    """
    marked = np.zeros(mesh.n_points, np.bool_)
    marked[nodes] = True
    around = np.flatnonzero(marked[mesh.cells].any(axis=1))
    at_wall = np.flatnonzero(marked[boundary.facets].any(axis=1)).tolist()
    ends = map(tuple, boundary.facets[at_wall].tolist())
    walls = dict(zip(ends, at_wall, strict=True))
    after: dict[int, dict[int, int]] = {i: {} for i in nodes.tolist()}
    folded = set()
    signed = mesh.signed_measures[around]
    for triangle, measure in zip(mesh.cells[around].tolist(), signed.tolist(), strict=True):
        cell = triangle if measure > 0.0 else triangle[::-1]
        for v, i in enumerate(cell):
            p, q = cell[(v + 1) % 3], cell[(v + 2) % 3]
            if marked[i] and after[i].setdefault(p, q) != q:
                folded.add(i)
    owner, cones = [], []
    for i in nodes.tolist():
        pairs = [] if i in folded else _sectors_at(i, after[i], walls)
        for p, q in pairs:
            owner.append(i)
            cones.append(np.concatenate([along[walls[i, p]], -along[walls[q, i]]]))
        if not pairs:
            owner.append(i)
            cones.append(np.zeros(4))
    return np.array(owner, np.int32), np.array(cones).reshape(-1, 4)


def _sectors_at(
    i: int, after: dict[int, int], walls: dict[tuple[int, int], int]
) -> list[tuple[int, int]]:
    """Return the first and last neighbour of each fan around node i; none if inconsistent."""
    pairs = []
    for p, next_to_p in after.items():
        if (i, p) not in walls:
            continue
        q = next_to_p
        for _ in after:
            if (q, i) in walls or q not in after:
                break
            q = after[q]
        if (q, i) not in walls:
            return []
        pairs.append((p, q))
    return pairs
