"""A mesh that local operations change: its parts, and the quality of its cells.

The *angle* of a cell is its quality in degrees.  That of a triangle is its smallest angle.  That of
a tetrahedron is its smallest dihedral angle, or less if the cell is a needle.  The *penalty* of a
cell grows with the cube of what its angle lacks.  An operation is an improvement if the sum of the
penalties falls and the smallest angle does not.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.complexes import CELLS, Complex, first_corner, next_corner, nodes_of
from adaptsize._kernels.envelope import Given, Samples
from adaptsize._kernels.heap import Heap, new_heap, push_or_decrease
from adaptsize._kernels.smoothing import tetrahedron
from adaptsize._kernels.trees import Stack, new_stack
from adaptsize._kernels.vectors import between, cross, dot

#: Kinds of meshes: tetrahedra, triangles in space, triangles in the plane.
TETRAHEDRA, SURFACE, PLANE = 0, 1, 2

#: Angle, in degrees, that a tetrahedron is given if its volume-length measure is 1; so one of a
#: measure below 0.1 counts as one of less than 20 degrees.
_SHAPE = 200.0
#: Square of an area that is none; coordinates are at most 1.
_NO_AREA2 = 1e-100
#: Cells of an angle below this times the goal have a penalty.
_MARGIN = 1.25
#: Number of nodes of a star, or cells around an edge, up to which operations are examined.
MOST_NODES, MOST_AROUND = 160, 9
#: Number of cells, and of facets, that a new node may replace.
MOST_IN_CAVITY, MOST_FACETS_IN_CAVITY = 64, 24
#: Places in `Cavity.counts` of the numbers of cells, faces, facets and edges of the rim of a
#: cavity, of facets and lines that contain the simplex, and of nodes of the simplex.
N_CELLS, N_FACES, N_FACETS, N_RIM, N_BEGUN, N_LINES, N_NODES = range(7)


class LocalMesh(NamedTuple):
    """A mesh and what its boundary must follow.

    Parameters
    ----------
    kind : int
    goal : float
        Angle below which cells are improved.
    facets : int
        The level of the facets; of a surface, that of its cells.
    points : float64[n, 3]
        With room for more.
    n_points : int64[1]
        Number of nodes.
    size : float64[n]
        Requested length of edges at the nodes.
    is_corner : bool[n]
        Nodes that stay.
    cx : Complex
        Cells, facets unless these are the cells or the mesh is plane, and lines: feature edges, in
        the plane those that bound or separate regions.
    surface : Given
        Triangles that the facets follow.
    curves : Given
        Segments that the lines follow.
    samples : Samples
    angle : float64[room]
        Angle of each cell.
    """

    kind: int
    goal: float
    facets: np.int64
    points: npt.NDArray[np.float64]
    n_points: npt.NDArray[np.int64]
    size: npt.NDArray[np.float64]
    is_corner: npt.NDArray[np.bool_]
    cx: Complex
    surface: Given
    curves: Given
    samples: Samples
    angle: npt.NDArray[np.float64]


class Cavity(NamedTuple):
    """What a new node replaces.

    Parameters
    ----------
    cells : int64[MOST_IN_CAVITY]
    faces : int64[f, 2]
        The cell of each face, and the place of the corner opposite to it.
    angle : float64[f]
        Of the new cells on the faces.
    facets : int64[MOST_FACETS_IN_CAVITY]
    rim : int64[r, 2]
        The facet of each edge of the rim, and the place of the corner opposite to it.
    made : int64[f + r, 5]
        New cells and facets, and their labels.
    counts : int64[7]
        Numbers of these, see `N_CELLS`.
    """

    cells: npt.NDArray[np.int64]
    faces: npt.NDArray[np.int64]
    angle: npt.NDArray[np.float64]
    facets: npt.NDArray[np.int64]
    rim: npt.NDArray[np.int64]
    made: npt.NDArray[np.int64]
    counts: npt.NDArray[np.int64]


def _new_cavity() -> Cavity:
    n, r = 2 * MOST_IN_CAVITY + 2, MOST_FACETS_IN_CAVITY + 2
    return Cavity(
        cells=np.empty(MOST_IN_CAVITY, np.int64), faces=np.empty((n, 2), np.int64),
        angle=np.empty(n), facets=np.empty(MOST_FACETS_IN_CAVITY, np.int64),
        rim=np.empty((r, 2), np.int64), made=np.empty((n + r, 5), np.int64),
        counts=np.zeros(7, np.int64),
    )  # fmt: skip


class Work(NamedTuple):
    """Scratch.

    Parameters
    ----------
    stack : Stack
    waiting : Heap
        Cells to improve, by their angles.
    around : int64[MOST_NODES]
        Nodes of a star.
    stamps : int64[n_points + 1, 2]
        When nodes were seen, and when in simplices with an edge; the present time is last.
    ring : int64[MOST_AROUND + 2, 6]
        Cells around an edge, and two nodes of each off the edge; the nodes around the edge in
        order; a stack of ranges of these.
    best : float64[MOST_AROUND + 2, MOST_AROUND + 2, 2]
        The worst cell of the best filling of a range, and the node of its triangle.
    made : int64[2 * MOST_AROUND, 5]
        New cells and their labels.
    choice : int64[3]
        The best operation.
    place : float64[3]
        New place of its node.
    cavity : Cavity
    """

    stack: Stack
    waiting: Heap
    around: npt.NDArray[np.int64]
    stamps: npt.NDArray[np.int64]
    ring: npt.NDArray[np.int64]
    best: npt.NDArray[np.float64]
    made: npt.NDArray[np.int64]
    choice: npt.NDArray[np.int64]
    place: npt.NDArray[np.float64]
    cavity: Cavity


def new_work(n_points: int, room: int) -> Work:
    """Return scratch for a mesh of so many points and rows of simplices."""
    n = MOST_AROUND + 2
    return Work(
        stack=new_stack(), waiting=new_heap(room), around=np.empty(MOST_NODES, np.int64),
        stamps=np.zeros((n_points + 1, 2), np.int64), ring=np.empty((n, 6), np.int64),
        best=np.empty((n, n, 2)), made=np.empty((2 * n, 5), np.int64),
        choice=np.zeros(3, np.int64), place=np.zeros(3), cavity=_new_cavity(),
    )  # fmt: skip


@lean
def tetrahedron_angle(points, a, b, c, d):
    """Return the angle of a tetrahedron, -1 if it is flat or inverted."""
    e, f, g = between(points, a, b), between(points, a, c), between(points, a, d)
    n_b, n_c, n_d = cross(g, f), cross(e, g), cross(f, e)
    if dot(e, n_b) >= 0.0:
        return -1.0
    n_a = (-n_b[0] - n_c[0] - n_d[0], -n_b[1] - n_c[1] - n_d[1], -n_b[2] - n_c[2] - n_d[2])
    a2, b2, c2, d2 = dot(n_a, n_a), dot(n_b, n_b), dot(n_c, n_c), dot(n_d, n_d)
    if min(a2, b2, c2, d2) < _NO_AREA2:  # a node on an edge, with a volume by rounding
        return -1.0
    cosine = -min(
        dot(n_a, n_b) / math.sqrt(a2 * b2),
        dot(n_a, n_c) / math.sqrt(a2 * c2),
        dot(n_a, n_d) / math.sqrt(a2 * d2),
        dot(n_b, n_c) / math.sqrt(b2 * c2),
        dot(n_b, n_d) / math.sqrt(b2 * d2),
        dot(n_c, n_d) / math.sqrt(c2 * d2),
    )
    if not cosine < 1.0:  # nan, too
        return -1.0
    return min(math.degrees(math.acos(cosine)), _SHAPE * tetrahedron(points, a, b, c, d))


@lean
def triangle_angle(points, kind, a, b, c):
    """Return the angle of a triangle, -1 if it is flat, or inverted in the plane."""
    u, v = between(points, a, b), between(points, a, c)
    w = (v[0] - u[0], v[1] - u[1], v[2] - u[2])
    n = cross(u, v)
    area2 = dot(n, n)
    if area2 <= 0.0 or (kind == PLANE and n[2] <= 0.0):
        return -1.0
    # The smallest angle is opposite to the shortest edge.
    uu, vv, ww = dot(u, u), dot(v, v), dot(w, w)
    shortest = min(uu, vv, ww)
    return math.degrees(math.atan2(math.sqrt(area2), 0.5 * (uu + vv + ww) - shortest))


@lean
def angle_of(mesh, nodes):
    """Return the angle of a cell of the first three or four nodes."""
    a, b, c, d = nodes
    if mesh.kind == TETRAHEDRA:
        return tetrahedron_angle(mesh.points, a, b, c, d)
    return triangle_angle(mesh.points, mesh.kind, a, b, c)


@lean
def penalty(mesh, angle):
    """Return the penalty of a cell, 0 if it is good enough."""
    full = _MARGIN * mesh.goal
    if angle >= full:
        return 0.0
    lack = (full - angle) / full
    return lack * lack * lack


@lean
def limit_of_edge(mesh, i, j):
    """Return the square of the length up to which an edge is not too long."""
    mean = 0.5 * (mesh.size[i] + mesh.size[j])
    return 2.0 * mean * mean


@lean
def squared_length(points, i, j):
    """Return the squared length of an edge."""
    e = between(points, i, j)
    return dot(e, e)


@lean
def put_in_queue(mesh, row, work):
    """Put a cell into the queue if it is to be improved."""
    angle, place = mesh.angle[row], work.waiting.place[row]
    if angle < mesh.goal and (place < 0 or angle < work.waiting.key[place]):
        push_or_decrease(work.waiting, row, angle)


@lean
def requeue(mesh, i, work):
    """Put the cells at a node into the queue if they are to be improved."""
    corner = first_corner(mesh.cx, CELLS, i)
    while corner >= 0:
        put_in_queue(mesh, corner // 4, work)
        corner = next_corner(mesh.cx, corner)


@lean
def update_angle(mesh, row):
    """Compute the angle of a cell again."""
    mesh.angle[row] = angle_of(mesh, nodes_of(mesh.cx, row))


@lean_kernel
def fill_angles(points, cells, kind, angle):
    """Fill the angle of each cell, float64[m], from float64[n, 3] and int32[m, 3 or 4]."""
    for c in range(cells.shape[0]):
        a, b, d = cells[c, 0], cells[c, 1], cells[c, 2]
        if kind == TETRAHEDRA:
            angle[c] = tetrahedron_angle(points, a, b, d, cells[c, 3])
        else:
            angle[c] = triangle_angle(points, kind, a, b, d)
