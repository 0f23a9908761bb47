"""Meshes of flat domains that are not convex, and the exact polygons of these domains.

Every function takes about how many nodes the mesh is to have, and a seed; it returns the
mesh and the rings of the domain as `geodesics` wants them.  Nodes: evenly
spaced ones on the boundary, corners included, and a jittered hexagonal lattice inside.
Their Delaunay triangulation has every piece of the boundary as an edge, because no
other node lies in the circle on that piece: inner nodes keep off by half a
piece, and the pieces at a corner are equally long (then that holds for any angle).
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from geodesics import contains, limited_sizes, polygon, prism_sizes, window_sizes
from scipy.spatial import Delaunay, cKDTree

from adaptsize import SimplexMesh
from adaptsize.typing import FloatArray

HALF_WIDTH = 50.0


def slit_square(n, *, width=1.0, tip=-20.0, seed=1001):
    """The square (-50, 50)^2 with a slit |x| < width/2 from the top down to y = tip.

    Both faces of the slit are rows of nodes; at most meshes they are closer to each
    other than the nodes of a row are.
    """
    rings = (slit_polygon(width, tip),)
    return _triangulated(rings, n, seed), rings


def slit_polygon(width, tip):
    """Return the ring of the slit square, float64[8, 2]."""
    w, h = HALF_WIDTH, 0.5 * width
    return np.array(
        [[-w, -w], [w, -w], [w, w], [h, w], [h, tip], [-h, tip], [-h, w], [-w, w]], float
    )


def star_holes(n, *, seed=1002):
    """The square with three stars of 7, 6 and 9 tips cut out: 22 reflex corners."""
    rings = (
        _box(-HALF_WIDTH, HALF_WIDTH, -HALF_WIDTH, HALF_WIDTH),
        _star((-20.0, 18.0), 17.0, 7.0, 7, 0.3),
        _star((22.0, 14.0), 16.0, 6.0, 6, 0.1),
        _star((2.0, -24.0), 18.0, 8.0, 9, 0.7),
    )
    return _triangulated(rings, n, seed), rings


def maze(n, *, seed=1003):
    """The square with four walls, 2 thick, from top and bottom in turn, and three islands."""
    w = HALF_WIDTH
    outer = [[-w, -w]]
    for x in (-10.0, 30.0):  # from the bottom
        outer += [[x - 1.0, -w], [x - 1.0, 30.0], [x + 1.0, 30.0], [x + 1.0, -w]]
    outer += [[w, -w], [w, w]]
    for x in (10.0, -30.0):  # from the top
        outer += [[x + 1.0, w], [x + 1.0, -30.0], [x - 1.0, -30.0], [x - 1.0, w]]
    outer += [[-w, w]]
    bar = _box(-46.0, -34.0, -1.0, 1.0)[::-1]
    letter_t = [[-6, 9], [-6, 11], [5, 11], [5, 9], [1, 9], [1, -15], [-1, -15], [-1, 9]]
    letter_l = [[35, -1], [35, 14], [37, 14], [37, 1], [46, 1], [46, -1]]
    rings = (np.array(outer), bar, np.array(letter_t, float), np.array(letter_l, float))
    return _triangulated(rings, n, seed), rings


def round_holes(n, *, seed=1004):
    """The square with five holes of 40 corners each, all reflex: shortest paths wind around."""
    holes = [(-25, 20, 12), (20, 25, 10), (0, -5, 11), (-22, -28, 9), (27, -22, 13)]
    rings = (
        _box(-HALF_WIDTH, HALF_WIDTH, -HALF_WIDTH, HALF_WIDTH),
        *(_regular((x, y), radius, 40)[::-1].copy() for x, y, radius in holes),
    )
    return _triangulated(rings, n, seed), rings


def disc(n, *, radius=50.0, seed=1005):
    """A disc; the domain is the convex polygon of its boundary nodes, which are on the circle."""
    # A provisional polygon gives the spacing, and the spacing the number of corners.
    spacing = _spacing((_regular((0.0, 0.0), radius, 1000),), n)
    rings = (_regular((0.0, 0.0), radius, round(2.0 * np.pi * radius / spacing)),)
    return _triangulated(rings, n, seed), rings


def disc_field(radius):
    """Return smooth sizes for all nodes of the disc: rings, of slopes up to 0.59."""
    wave_number = 4.0 * np.pi / HALF_WIDTH
    return 6.0 + 0.59 / wave_number * np.cos(wave_number * radius)


def wall_box(n, *, width=2.0, seed=1007):
    """The box (-50, 50)^3 with a wall |x| < width / 2, y > 0: a slit square times an interval.

    The wall reaches the three sides y = 50, z = -50 and z = 50; its end, two reflex edges
    along z, leaves an opening.  Returns tetrahedra and the rings of the section z = const.
    """
    y, z = (-HALF_WIDTH, 0.0, HALF_WIDTH), (-HALF_WIDTH, HALF_WIDTH)
    return _walled_box(n, width, y, z, lambda y, z: y < 0.0, seed), (slit_polygon(width, 0.0),)


def window_box(n, *, seed=1008):
    """The box with a wall |x| < 1 that has a window, -20 < y < 10, -8 < z < 16.

    Eight reflex edges, which meet in eight corners.  Returns tetrahedra, and the arguments
    (width, lower, upper) that `geodesics.window_sizes` takes for the domain.
    """
    width, lower, upper = 2.0, (-20.0, -8.0), (10.0, 16.0)

    def is_open(y, z):
        return (y > lower[0]) & (y < upper[0]) & (z > lower[1]) & (z < upper[1])

    y, z = ((-HALF_WIDTH, lower[a], upper[a], HALF_WIDTH) for a in range(2))
    return _walled_box(n, width, y, z, is_open, seed), (width, lower, upper)


def blocks(n, *, seed=1009):
    """The square with seven rectangular blocks cut out: 28 reflex corners."""
    boxes = [(-42, -30, 5, 40), (-22, 4, 26, 34), (14, 20, 8, 44), (30, 42, 20, 26),
             (-38, -6, -14, -8), (6, 36, -22, -10), (-26, -16, -44, -24)]  # fmt: skip
    square = _box(-HALF_WIDTH, HALF_WIDTH, -HALF_WIDTH, HALF_WIDTH)
    rings = (square, *(_box(*box)[::-1].copy() for box in boxes))
    return _triangulated(rings, n, seed), rings


def spiral(n, *, turns=3, seed=1010):
    """The square with a wall that winds inwards and leaves one corridor, for n >= 1000."""
    w, pitch = HALF_WIDTH, HALF_WIDTH / (turns + 0.5)
    centre = [(-w, w - pitch)]
    for turn in range(1, turns + 1):
        far, near = w - turn * pitch, w - (turn + 1) * pitch
        centre += [(far, far), (far, -far), (-far, -far), (-far, near)]
    # Both sides of the wall: every part moved across, corners where moved parts meet.
    centre = np.array(centre[:-1])  # the last part has no length
    along = np.diff(centre, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    left = along[:, ::-1] * [-1.0, 1.0]
    ends = np.concatenate([left[:1], left[:-1] + left[1:], left[-1:]])
    wall = np.concatenate([centre + ends, (centre - ends)[::-1]])
    rings = (np.concatenate([[[-w, -w], [w, -w], [w, w], [-w, w]], wall]),)
    return _triangulated(rings, n, seed), rings


def holes(n, n_holes, n_corners, *, seed=1011):
    """The square with regular polygons cut out, which stand on a jittered lattice.

    Such as 6 holes of 40, 200 or 400 corners, 100 of 24, or 1000 of 6.
    """
    rng = np.random.default_rng(seed)
    n_columns = int(np.ceil(np.sqrt(n_holes)))
    n_rows = -(-n_holes // n_columns)
    side = 2.0 * HALF_WIDTH / np.array([n_columns, n_rows])
    rings = [_box(-HALF_WIDTH, HALF_WIDTH, -HALF_WIDTH, HALF_WIDTH)]
    for place in range(n_holes):
        middle = np.array([place % n_columns, place // n_columns]) + 0.5
        # Two holes are farther apart than half an edge of a hexagon is long.
        centre = (middle + rng.uniform(-0.08, 0.08, 2)) * side - HALF_WIDTH
        radius, turn = rng.uniform(0.22, 0.30) * side.min(), rng.uniform(0.0, 2.0 * np.pi)
        rings.append(_regular(centre, radius, n_corners, turn)[::-1].copy())
    rings = tuple(rings)
    return _triangulated(rings, n, seed), rings


def l_shape(n, *, seed=1012):
    """The square without its upper right quarter: one reflex corner, at the origin."""
    w = HALF_WIDTH
    ring = np.array([[-w, -w], [w, -w], [w, 0.0], [0.0, 0.0], [0.0, w], [-w, w]])
    return _triangulated((ring,), n, seed), (ring,)


def with_removed_cells(mesh, seed, count, *, pinched=True):
    """Return a mesh of triangles without ``count`` of them, and its boundary.

    The triangles are taken at random.  None has an edge on the boundary or in common with
    another one, so that each is a hole of its own.  They may share nodes, which
    are pinched then, unless ``pinched`` is False.  Fewer are removed if there is no room.
    The boundary is float64[m, 2, 2], segments with the domain on their left.
    """
    number, _ = _triangle_edges(mesh.cells)
    edges_of_cell = number.reshape(3, -1).T
    touches = (np.bincount(number)[edges_of_cell] == 1).any(axis=1)
    parts_of_cell = edges_of_cell
    if not pinched:
        nodes = np.zeros(mesh.n_points, bool)
        nodes[mesh.cells[touches]] = True
        touches |= nodes[mesh.cells].any(axis=1)
        parts_of_cell = mesh.cells
    taken, removed = set(), []
    for cell in np.random.default_rng(seed).permutation(np.flatnonzero(~touches)):
        if len(removed) == count:
            break
        parts = parts_of_cell[cell].tolist()
        if taken.isdisjoint(parts):
            taken.update(parts)
            removed.append(cell)
    rest = SimplexMesh(mesh.points, np.delete(mesh.cells, removed, axis=0))
    return rest, boundary_segments(rest)


def boundary_segments(mesh):
    """Return the edges of a single triangle, the domain on their left, float64[m, 2, 2]."""
    corners = mesh.points[mesh.cells]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turned = u[:, 0] * v[:, 1] < u[:, 1] * v[:, 0]
    cells = np.where(turned[:, None], mesh.cells[:, [0, 2, 1]], mesh.cells)
    number, ends = _triangle_edges(cells)
    return mesh.points[ends[np.bincount(number)[number] == 1]]


def _triangle_edges(cells):
    """Return the numbers and the ends of edges, first edges of all triangles first, int[3 m]."""
    ends = np.concatenate([cells[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.int64)
    keys = ends.min(axis=1) * (ends.max() + 1) + ends.max(axis=1)
    return np.unique(keys, return_inverse=True)[1], ends


class Case(NamedTuple):
    """A domain with point sources, and what gives the exact sizes."""

    make: Callable[..., tuple[SimplexMesh, Any]]
    """``make(n, seed=...)`` gives the mesh, of about n nodes, and the domain."""
    places: list[tuple[float, ...]]
    """Where the sources are to be; the nearest nodes take their part."""
    sizes: tuple[float, ...]
    exact: Callable[..., FloatArray]
    """``exact(domain, points, g, sources, sizes)``."""


#: Sources so placed that paths bend, and that the regions of the sources meet.
CASES = {
    "slit": Case(slit_square, [(-20, 30), (30, -10)], (1.0, 5.0), limited_sizes),
    "star holes": Case(star_holes, [(-45, 40), (30, -10)], (1.0, 5.0), limited_sizes),
    "maze": Case(maze, [(-40, 40), (40, -30)], (1.0, 5.0), limited_sizes),
    "round holes": Case(round_holes, [(-45, 10), (10, -35)], (1.0, 5.0), limited_sizes),
    "wall": Case(wall_box, [(-20, 30, 10), (30, -10, -20)], (1.0, 5.0), prism_sizes),
    "window": Case(window_box, [(-20, 30, 30), (30, -30, -20)], (1.0, 5.0), window_sizes),
}


def point_sources(mesh, places, sizes):
    """Return h0 (inf but at the nodes nearest to the places) and these nodes, int[k]."""
    nodes = cKDTree(mesh.points).query(np.asarray(places, float))[1]
    h0 = np.full(mesh.n_points, np.inf)
    h0[nodes] = sizes
    return h0, nodes


def _box(x0, x1, y0, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)


def _regular(centre, radius, n, turn=0.0):
    angle = turn + 2.0 * np.pi * np.arange(n) / n
    return np.asarray(centre) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _star(centre, outer, inner, n_tips, turn):
    """Return a star as a hole, clockwise; all its edges are equally long."""
    angle = turn - np.pi * np.arange(2 * n_tips) / n_tips
    radius = np.where(np.arange(2 * n_tips) % 2 == 0, outer, inner)
    return np.asarray(centre) + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def _spacing(rings, n):
    """Return the spacing s for n nodes: A / (sqrt(3)/2 s^2) of them inside, P / 2s at the edge.

    Along the boundary s P of the area belongs half to the boundary's own nodes.
    """
    domain = polygon(rings)
    a, b, c = n, -0.5 * domain.length, -domain.area / (0.5 * np.sqrt(3.0))
    return (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)


def _triangulated(rings, n, seed):
    """Return a Delaunay mesh of the domain of about n nodes."""
    spacing = _spacing(rings, n)
    edge_points, middles = _boundary_points(rings, spacing)
    rng = np.random.default_rng(seed)
    inner = _lattice(rings[0], spacing, rng)
    # Nodes and middles half a spacing apart: at 0.56 from each, 0.5 from the line.
    marks = cKDTree(np.concatenate([edge_points, middles]))
    inner = inner[marks.query(inner, distance_upper_bound=0.56 * spacing)[0] == np.inf]
    inner = inner[contains(rings, inner)]
    points = np.concatenate([edge_points, inner])
    cells = Delaunay(points).simplices
    doubtful = cells.max(axis=1) < len(edge_points)  # the others have an inner node
    is_kept = ~doubtful
    is_kept[doubtful] = contains(rings, points[cells[doubtful]].mean(axis=1))
    cells = cells[is_kept]
    # Delaunay may leave flat cells on straight sides of the hull.
    mesh = SimplexMesh(points, cells)
    return SimplexMesh(points, cells[mesh.measures > 1e-9 * spacing**2])


def _boundary_points(rings, spacing):
    """Return evenly spaced points on all edges, corners included, and the middles between them."""
    nodes, middles = [], []
    for ring in rings:
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            n = max(1, round(float(np.linalg.norm(b - a)) / spacing))
            share = np.arange(n)[:, None] / n
            nodes.append(a + share * (b - a))
            middles.append(a + (share + 0.5 / n) * (b - a))
    return np.concatenate(nodes), np.concatenate(middles)


def _lattice(ring, spacing, rng):
    """Return a hexagonal lattice over the ring's box, each point moved by up to a quarter."""
    lower, upper = ring.min(axis=0), ring.max(axis=0)
    row = 0.5 * np.sqrt(3.0) * spacing
    start = lower + rng.uniform(0.0, 1.0, 2) * spacing
    y, x = np.meshgrid(
        np.arange(start[1], upper[1], row), np.arange(start[0], upper[0], spacing), indexing="ij"
    )
    x[1::2] += 0.5 * spacing
    points = np.column_stack([x.ravel(), y.ravel()])
    return points + rng.uniform(-0.25, 0.25, points.shape) * spacing


def _even(marks, spacing):
    """Return the marks of an axis and evenly spaced values between them."""
    pieces = [
        np.linspace(a, b, 1 + max(1, round((b - a) / spacing)))[:-1] for a, b in pairwise(marks)
    ]
    return np.concatenate([*pieces, marks[-1:]])


def _grid(*axes):
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def _walled_box(n, width, y_marks, z_marks, is_open, seed):
    """Return tetrahedra of the box (-50, 50)^3 without |x| < width/2 where (y, z) is not open.

    The marks split the axes into pieces of evenly spaced nodes.  The faces of the wall are
    grids of nodes; inner nodes keep farther off than the circles around the rectangles of
    these grids reach, so that Delaunay cells respect them.
    """
    spacing = 1.03 * 2.0 * HALF_WIDTH / n ** (1.0 / 3.0)  # nodes of the hull count for less
    rng = np.random.default_rng(seed)
    beyond = _even((0.5 * width, HALF_WIDTH), spacing)
    y = _even(y_marks, spacing)
    z = _even(z_marks, spacing)
    aside = _grid(np.concatenate([-beyond[:0:-1], beyond[1:]]), y, z)
    middle, faces = _grid(np.zeros(1), y, z), _grid(np.array([-0.5, 0.5]) * width, y, z)
    faces = faces[~is_open(*faces.T[1:])]
    free = np.concatenate([aside, middle[is_open(*middle.T[1:])]])
    # Nodes on the hull slide in it: rectangles of nodes that cut off its edges would hold
    # flat cells, which could not be left out without a crack.
    move = rng.uniform(-0.25, 0.25, free.shape) * spacing
    free += np.where(np.abs(free) < HALF_WIDTH, move, 0.0)
    # The same where two sides of a window meet.  Along its rim nodes slide by so little that
    # those of the other face, at a distance of width, stay out of the circles of this one.
    beside = 1e-6 * spacing
    for along, shift in ((2, (beside, 0.0)), (1, (0.0, beside))):
        slides = np.abs(faces[:, along]) < HALF_WIDTH
        slides &= is_open(*(faces[:, 1:] + shift).T) | is_open(*(faces[:, 1:] - shift).T)
        slide = rng.uniform(-0.25, 0.25, len(faces)) * width**2 / spacing
        faces[:, along] += np.where(slides, slide, 0.0)
    points = np.concatenate([free, faces])
    cells = Delaunay(points).simplices
    x, y, z = points[cells].mean(axis=1).T
    cells = cells[(np.abs(x) >= 0.5 * width) | is_open(y, z)]
    # Delaunay leaves flat cells on planes full of nodes; they lie on the boundary.
    mesh = SimplexMesh(points, cells)
    return SimplexMesh(points, cells[mesh.measures > 1e-9 * spacing**3])
