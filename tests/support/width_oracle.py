"""Brute-force twins of `boundary_width` and `boundary_separation`, and random parts to try them on.

No tree and no pruning: all facets are tried for each ray, all features for each point.  Faces,
curves and corners are those of the library, which have tests of their own.  The arithmetic of one
ray against one facet is that of the kernel, in the same order, so that widths agree bit by bit;
everything about separations is other arithmetic.
"""

import itertools
import math

import numpy as np
import trimesh
from manifold3d import Manifold
from shapes import joined
from solids import hull, outline

from adaptsize import SimplexMesh
from adaptsize.background.topology import components_of

SLACK = 1e-9
STEEPEST = math.radians(75.0)
ANGLE_SLACK = 1e-7
ALONG = 1e-3


# --- rays -------------------------------------------------------------------------


def dot(a, b):
    """The sum of products from left to right, as compiled loops add."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def cross(a, b):
    (a, b, c), (u, v, w) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([b * w - c * v, c * u - a * w, a * v - b * u], axis=-1)


class AllFacets:
    """Facets in the frame of their faces, without a tree."""

    def __init__(self, faces):
        self.c, self.n = faces.corners[:, 0], faces.normals
        p = faces.corners[:, 1] - self.c
        with np.errstate(all="ignore"):
            if faces.corners.shape[1] == 2:
                self.a, self.b = p / dot(p, p)[:, None], np.zeros(p.shape)
            else:
                q = faces.corners[:, 2] - self.c
                across = cross(self.n, q)
                self.a = across / dot(across, p)[:, None]
                across = cross(self.n, p)
                self.b = across / dot(across, q)[:, None]
            gradients = (self.a, self.b, self.a + self.b)
            self.beside = [SLACK * np.sqrt(dot(g, g)) for g in gradients]

    def hits(self, start, way):
        """Return the distances of a ray to the facets it crosses, their numbers, and cosines."""
        with np.errstate(all="ignore"):
            cosine = dot(way, self.n)
            r = self.c - start
            along = dot(r, self.n) / cosine
            r = along[:, None] * way - r
            u, v = dot(self.a, r), dot(self.b, r)
            within = [w >= -s for w, s in zip((u, v, 1.0 - u - v), self.beside, strict=True)]
        crossed = np.flatnonzero((np.abs(cosine) > 1e-9) & np.all(within, axis=0))
        return along[crossed], crossed, cosine[crossed]


def pieces(mesh):
    """Return the piece of each facet: they are joined where two share a facet of theirs."""
    pairs = [
        np.flatnonzero((mesh.cell_facets == f).any(axis=1))
        for f in np.flatnonzero(mesh.facet_cell_counts == 2)
    ]
    return components_of(np.array(pairs).reshape(-1, 2), mesh.n_cells)


def open_sheets(mesh):
    """Return which facets are of a piece with a free side."""
    piece, free = pieces(mesh), (mesh.facet_cell_counts[mesh.cell_facets] == 1).any(axis=1)
    return np.isin(piece, piece[free])


def winding_number(corners, x):
    """Return how often outward facets go around a point."""
    ways = corners - x
    if corners.shape[1] == 2:
        a, b = ways[:, 0], ways[:, 1]
        turn = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.einsum("ij,ij->i", a, b))
        return turn.sum() / (2.0 * np.pi)
    length = np.linalg.norm(ways, axis=2)
    a, b, c = np.moveaxis(ways, 1, 0)
    la, lb, lc = length.T
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    return np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2.0 * np.pi)


class Bodies:
    """The pieces of a boundary, and whether points are inside of any."""

    def __init__(self, faces):
        mesh = faces.mesh
        self.piece = pieces(mesh)
        self.corners = faces.frame.of(mesh.points)[mesh.cells]
        self.facets, self.two_sided = AllFacets(faces), open_sheets(mesh)

    def hold(self, place, way, cell):
        """Return whether a body that does not begin there is beyond a place near another piece."""
        for k in set(self.piece.tolist()) - {int(self.piece[cell])}:
            points = self.corners[self.piece == k].reshape(-1, 3)
            if ((points.min(0) - SLACK <= place) & (place <= points.max(0) + SLACK)).all():
                along, which, cosine = self.facets.hits(place, way)
                enters = (cosine < 0.0) & (np.abs(along) <= 2 * SLACK) & ~self.two_sided[which]
                around = abs(winding_number(self.corners, place + 1e-6 * way))
                return around > 0.55 + enters.any()
        return False


def widths(faces, starts, cells, corner_angle=30.0):
    """Return the widths at points in the frame on given facets, in the unit of the frame."""
    facets, two_sided = AllFacets(faces), open_sheets(faces.mesh)
    first, items = faces.meets
    meeting = [set(items[a:b].tolist()) for a, b in itertools.pairwise(first)]
    steep = np.cos(STEEPEST + ANGLE_SLACK)
    parallel = np.cos(max(math.radians(corner_angle) - ANGLE_SLACK, 0.0))
    bodies, found = Bodies(faces), np.full(len(starts), np.inf)
    for r, (start, cell) in enumerate(zip(starts, cells, strict=True)):
        way = -faces.normals[cell]
        if bodies.hold(start, -way, cell):
            continue
        along, which, cosine = facets.hits(start, way)
        leaves = (cosine > 0.0) | two_sided[which]
        meets = np.array([f in meeting[faces.face[cell]] for f in faces.face[which]], bool)
        cosine = np.abs(cosine)
        counts = leaves & (cosine >= steep) & ((cosine > parallel) | ~meets)
        leaving = SLACK
        while leaving < np.inf:
            beyond = along > leaving
            leaving = along[beyond & leaves].min(initial=np.inf)
            found[r] = along[beyond & counts & (along <= leaving + SLACK)].min(initial=np.inf)
            at_sheet = (two_sided[which] & beyond & (along <= leaving + SLACK)).any()
            if leaving == np.inf or at_sheet or not bodies.hold(start + leaving * way, way, cell):
                break
            leaving += SLACK
    return found


# --- separations ------------------------------------------------------------------


def closest_on_segments(a, b, x):
    """Return the points of segments from a to b that are closest to x."""
    way = b - a
    share = np.einsum("ij,ij->i", x - a, way) / np.einsum("ij,ij->i", way, way)
    return a + np.clip(share, 0.0, 1.0)[:, None] * way


def closest_on_triangles(corners, x):
    """Return the points of triangles that are closest to x: its projection, or one on a side."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    foot = x - np.einsum("ij,ij->i", x - a, normal)[:, None] * normal
    sides = ((a, b), (b, c), (c, a))
    inside = [np.einsum("ij,ij->i", np.cross(q - p, foot - p), normal) >= 0.0 for p, q in sides]
    options = np.stack([closest_on_segments(p, q, x) for p, q in sides])
    best = np.linalg.norm(options - x, axis=2).argmin(axis=0)
    on_side = options[best, np.arange(len(a))]
    return np.where(np.all(inside, axis=0)[:, None], foot, on_side)


def closest_points(corners, x):
    if corners.shape[1] == 1:
        return corners[:, 0]
    if corners.shape[1] == 2:
        return closest_on_segments(corners[:, 0], corners[:, 1], x)
    return closest_on_triangles(corners, x)


class AllFeatures:
    """Corners, curves and faces of a closed boundary, in the frame."""

    def __init__(self, faces, corner_angle=30.0):
        mesh = faces.mesh
        places = faces.frame.of(mesh.points)
        self.faces, self.places = faces, places
        self.outward = places[mesh.cells]  # as in the file: turned outward
        self.facets = AllFacets(faces)
        self.sine = math.sin(math.radians(corner_angle) - ANGLE_SLACK)
        in_plane = mesh.cell_dim == 1
        corners = np.flatnonzero(faces.is_corner)
        edges = np.empty((0, 2), int) if in_plane else faces.features
        self.kinds = [(corners[:, None], corners), (edges, faces.curve), (mesh.cells, faces.face)]
        self.corners_of = [{int(c): set() for c in corners}, {}, {}]
        for nodes, owners, ends in zip(*zip(*self.kinds[1:], strict=True), self.corners_of[1:],
                                       strict=True):  # fmt: skip
            for row, owner in zip(nodes.tolist(), owners.tolist(), strict=False):
                touched = ends.setdefault(owner, set())
                touched.update(node for node in row if faces.is_corner[node])
        self.faces_of_curve = {}
        if not in_plane:
            curve_of = {frozenset(e): c for e, c in zip(edges.tolist(), faces.curve, strict=True)}
            for cell, face in zip(mesh.cells.tolist(), faces.face.tolist(), strict=True):
                for node in cell:
                    curve = curve_of.get(frozenset(cell) - {node})
                    if curve is not None:
                        self.faces_of_curve.setdefault(int(curve), set()).add(face)

    def at_corner(self, node):
        """Return the separation of a corner."""
        skipped = [{node}] + [{o for o, ends in of.items() if node in ends}
                              for of in self.corners_of[1:]]  # fmt: skip
        return self._least(self.places[node], skipped, ())

    def on_curve(self, x, curve):
        """Return the separation of a point on a curve that is no corner."""
        ends = self.corners_of[1][curve]
        return self._least(x, [ends, {curve}, self.faces_of_curve[curve]], ends)

    def _least(self, x, skipped, ends):
        feet = []
        for (nodes, owners), of, skip in zip(self.kinds, self.corners_of, skipped, strict=True):
            if len(nodes) == 0:
                continue
            foot = closest_points(self.places[nodes], x)
            limit = {
                owner: np.inf if owner not in skip else 0.0
                for owner in np.unique(owners[: len(nodes)]).tolist()
            }
            for end in ends:
                reach = self.sine * np.linalg.norm(self.places[end] - x)
                limit |= {o: min(limit[o], reach) for o in limit if end in of.get(o, ())}
            distance = np.linalg.norm(foot - x, axis=1)
            allowed = distance < np.array([limit[o] for o in owners[: len(nodes)].tolist()])
            feet.append(foot[allowed & (distance > SLACK)])
        feet = np.concatenate(feet)
        distance = np.linalg.norm(feet - x, axis=1)
        for k in np.argsort(distance, kind="stable"):
            if self.is_inside(x, feet[k]):
                return distance[k]
        return np.inf

    def is_inside(self, x, y):
        """Return whether a segment is in the domain: no facet crosses it, and it starts inside."""
        length = np.linalg.norm(y - x)
        along, _, cosine = self.facets.hits(x, (y - x) / length)
        between = (along > SLACK) & (along < length - SLACK)
        if (between & (np.abs(cosine) > ALONG)).any():
            return False
        return all(self._holds(x, x + share * (y - x)) for share in (1e-4, 0.5))

    def _holds(self, start, x):
        """Return whether a point is inside, or on the boundary as seen from a start."""
        gap = np.linalg.norm(closest_points(self.outward, x) - x, axis=1).min()
        near = gap <= ALONG * np.linalg.norm(x - start)
        return near or winding_number(self.outward, x) > 0.5


# --- random parts -----------------------------------------------------------------


def mesh_of(solid):
    """Return the boundary of a solid of manifold3d."""
    found = solid.to_mesh64()
    return SimplexMesh(np.asarray(found.vert_properties)[:, :3], np.asarray(found.tri_verts))


def random_solids(rng, n):
    """Return boxes, cylinders and cones about the origin, turned at random."""
    found = []
    for _ in range(n):
        if rng.random() < 0.5:
            solid = Manifold.cube(rng.uniform(0.3, 1.6, 3), True)
        else:
            low, high = rng.uniform(0.1, 0.6, 2)
            around = int(rng.integers(5, 14))
            solid = Manifold.cylinder(rng.uniform(0.3, 1.6), low, high, around, True)
        found.append(solid.rotate(rng.uniform(0, 360, 3)).translate(rng.uniform(-0.4, 0.4, 3)))
    return found


def random_union(rng):
    a, b, c, d = random_solids(rng, 4)
    return mesh_of(a + b + c - d)


def random_overlap(rng):
    """Closed bodies that overlap, or lie in each other, as they are."""
    return joined(*(mesh_of(solid) for solid in random_solids(rng, 4)))


def random_hull(rng):
    return hull(rng.normal(size=(25, 3)))


def noisy_ball(rng):
    ball = trimesh.creation.icosphere(2)
    noise = rng.uniform(0.8, 1.2, (len(ball.vertices), 1))
    return SimplexMesh(ball.vertices * noise, ball.faces)


def torn_ball(rng):
    """A noisy ball without some of its facets, and a sheet inside."""
    ball = noisy_ball(rng)
    sheet = SimplexMesh(rng.uniform(-0.4, 0.4, (3, 3)), [[0, 1, 2]])
    return joined(SimplexMesh(ball.points, ball.cells[rng.random(ball.n_cells) < 0.97]), sheet)


def _star(rng, n, low, high, at=(0.0, 0.0)):
    angle = 2.0 * np.pi * (np.arange(n) + rng.uniform(-0.4, 0.4, n)) / n
    radius = rng.uniform(low, high, n)[:, None]
    return np.asarray(at) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def random_polygon(rng):
    """A star with two holes."""
    rim, one, other = (
        _star(rng, 30, 0.7, 1.2),
        _star(rng, 8, 0.02, 0.15, (0.2, 0.1)),
        _star(rng, 12, 0.1, 0.25, (-0.3, 0.2)),
    )
    return outline(rim, one[::-1], other[::-1])


def crossing_polygons(rng):
    """Stars that overlap, as they are."""
    return outline(
        _star(rng, 20, 0.5, 1.2), _star(rng, 20, 0.3, 1.0, (0.5, 0.3)), _star(rng, 9, 0.1, 0.2)
    )


#: Closed, and of bodies that do not overlap.
SOUND_PARTS = {p.__name__: p for p in (random_union, random_hull, noisy_ball, random_polygon)}
#: Others.
OTHER_PARTS = {p.__name__: p for p in (random_overlap, torn_ball, crossing_polygons)}
