"""Repairs of generated surfaces keep what they enclose: closed stays closed, open stays as open."""

import os
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import CORNERS, CUBE_CELLS

from adaptsize import SimplexMesh
from adaptsize.geometry.enclosed import cone_measures
from adaptsize.geometry.solid import Solid
from adaptsize.quality.boundary import n_components
from adaptsize.remeshing.preparation import repair_mesh

#: Generated surfaces of each base; more by hand.
N = int(os.environ.get("ADAPTSIZE_SURFACES", "60")) // 6


def box(lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 1.0)):
    return SimplexMesh(lower + CORNERS * np.subtract(upper, lower), CUBE_CELLS)


def finer(mesh):
    """Each triangle divided into four."""
    n = mesh.n_points
    points = np.concatenate([mesh.points, mesh.points[mesh.edges].mean(axis=1)])
    a, b, c = mesh.cells.T
    i, j, k = (n + mesh.cell_facets).T
    parts = [(a, k, j), (k, b, i), (j, i, c), (i, j, k)]
    return SimplexMesh(points, np.concatenate([np.column_stack(part) for part in parts]))


def voxels(full, shape=(3, 3, 3)):
    """The boundary of unit cubes."""
    cells, points = [], np.array(list(product(*(range(n + 1) for n in shape))), float)
    number = np.arange(len(points)).reshape(*(n + 1 for n in shape))
    for at in full:
        for axis, side in product(range(3), (0, 1)):
            beside = list(at)
            beside[axis] += 2 * side - 1
            if tuple(beside) in full:
                continue
            corner = np.array(at)
            corner[axis] += side
            one, other = np.delete(np.eye(3, dtype=int), axis, axis=0)
            quad = [tuple(corner + d) for d in (0 * one, one, one + other, other)]
            if (side == 0) != (axis == 1):
                quad.reverse()
            a, b, c, d = (number[q] for q in quad)
            cells += [(a, b, c), (a, c, d)]
    nodes, local = np.unique(cells, return_inverse=True)
    return SimplexMesh(points[nodes], local.reshape(-1, 3))


def without(mesh, rows):
    return SimplexMesh(mesh.points, np.delete(mesh.cells, rows, axis=0))


def joined(*bodies):
    first = np.cumsum([0, *(body.n_points for body in bodies)])
    cells = [body.cells + k for body, k in zip(bodies, first[:-1], strict=True)]
    return SimplexMesh(np.concatenate([body.points for body in bodies]), np.concatenate(cells))


PLATE = list(product(range(3), range(3), (0,)))
LONG = list(product(range(3), range(5), (0,)))
BASES = {
    "box": finer(box()),
    "ring": voxels([at for at in PLATE if at != (1, 1, 0)]),
    "two holes": voxels([at for at in LONG if at not in ((1, 1, 0), (1, 3, 0))], (3, 5, 1)),
    "three bodies": joined(finer(box()), box((3, 0, 0), (4, 1, 1)), box((0, 3, 0), (1, 4, 2))),
    "box without a side": without(finer(box()), [0, 12, 24, 36, 1, 13, 25, 37]),
    "hollow": joined(finer(box()), SimplexMesh(0.3 + 0.4 * CORNERS, CUBE_CELLS[:, ::-1])),
}


class Defects:
    """Defects planted in a surface, which do not change what it is."""

    def __init__(self, mesh, rng):
        self.points = mesh.points.tolist()
        self.cells = [tuple(cell) for cell in mesh.cells.tolist()]
        self.rng = rng
        self.planted = []

    @property
    def mesh(self):
        return SimplexMesh(self.points, self.cells)

    def plant(self, kind):
        getattr(self, kind)()
        self.planted.append(kind)

    def _any(self):
        return int(self.rng.integers(len(self.cells)))

    def _new(self, point):
        self.points.append(np.asarray(point).tolist())
        return len(self.points) - 1

    def _on_edge(self, a, b):
        t = self.rng.uniform(0.3, 0.7)
        return self._new(
            np.add(np.multiply(1.0 - t, self.points[a]), np.multiply(t, self.points[b]))
        )

    def _edge(self):
        """A corner and the edge opposite to it, of a triangle that is no defect."""
        for _ in range(1000):
            c = self._any()
            cell = self.cells[c]
            p, q, r = np.array(self.points)[list(cell)]
            if np.linalg.norm(np.cross(q - p, r - p)) > 1e-3:
                v = int(self.rng.integers(3))
                return c, cell[v], cell[(v + 1) % 3], cell[(v + 2) % 3]

    def joint(self):
        """A node on an edge, on one side of it only."""
        c, apex, a, b = self._edge()
        p = self._on_edge(a, b)
        self.cells[c] = (apex, a, p)
        self.cells.append((apex, p, b))

    def cap(self):
        """A triangle with a corner on its opposite edge."""
        c, apex, a, b = self._edge()
        p = self._on_edge(a, b)
        self.cells[c] = (apex, a, p)
        self.cells += [(apex, p, b), (p, a, b)]

    def caps(self):
        """A chain of them on one edge."""
        c, apex, a, b = self._edge()
        p = self._on_edge(a, b)
        q = self._on_edge(a, p)
        r = self._on_edge(p, b)
        self.cells[c] = (apex, a, q)
        self.cells += [(apex, q, p), (apex, p, r), (apex, r, b)]
        more = [[(q, a, p), (p, a, r), (r, a, b)], [(q, a, b), (p, q, b), (r, p, b)]]
        self.cells += more[int(self.rng.integers(2))]

    def needle(self):
        """An edge of length 0, between two triangles: one node becomes two."""
        c, apex, a, b = self._edge()
        beside = [k for k, cell in enumerate(self.cells) if a in cell and b in cell and k != c]
        if len(beside) != 1:
            return
        other = next(k for k in self.cells[beside[0]] if k not in (a, b))
        if other == apex:
            return
        # Between the triangles apex-a-b and b-a-other, two that share the edge of a and its twin.
        p = self._new(self.points[a])
        self.cells[c] = (apex, p, b)
        self.cells += [(apex, a, p), (p, a, b)]

    def double(self):
        """A triangle twice, also with the other orientation."""
        cell = self.cells[self._any()]
        self.cells.append(cell if self.rng.random() < 0.5 else cell[::-1])

    def corner(self):
        """A triangle whose corners are nodes of its own."""
        c = self._any()
        self.cells[c] = tuple(self._new(self.points[k]) for k in self.cells[c])

    def twin(self):
        """A node twice, hardly apart, with some of the triangles around it at each."""
        node = self.cells[self._any()][0]
        shift = self.rng.choice([0.0, 1e-11, 1e-8, 3e-7]) * self.rng.normal(size=3)
        p = self._new(np.add(self.points[node], shift))
        for c in np.flatnonzero(self.rng.random(len(self.cells)) < 0.5).tolist():
            self.cells[c] = tuple(p if k == node else k for k in self.cells[c])

    def fin(self):
        """Two sides of a triangle that hangs on an edge."""
        _, apex, a, b = self._edge()
        p = self._new(np.multiply(2.0, self.points[a]) - self.points[apex] + 0.01)
        self.cells += [(a, b, p), (b, a, p)]

    def flat(self):
        """A triangle without area that hangs on nothing, or on one edge."""
        _, _, a, b = self._edge()
        self.cells.append((a, b, self._on_edge(a, b)))


KINDS = ("twin", "joint", "cap", "caps", "needle", "corner", "flat", "double", "fin")


def volume(mesh):
    return float(cone_measures(mesh, np.zeros(3)).sum())


def open_length(mesh):
    edges = mesh.facets[mesh.facet_cell_counts % 2 == 1]
    return float(np.linalg.norm(mesh.points[edges[:, 0]] - mesh.points[edges[:, 1]], axis=1).sum())


def euler(mesh):
    return len(np.unique(mesh.cells)) - len(mesh.edges) + mesh.n_cells


@pytest.mark.parametrize("base", BASES)
def test_repairs_keep_what_a_surface_is(base):
    rng = np.random.default_rng([417, list(BASES).index(base)])
    old = BASES[base]
    for k in range(N):
        turn = Rotation.random(random_state=1000 + k).as_matrix() if k % 3 else np.eye(3)
        scale, shift = 10.0 ** rng.uniform(-6, 6), rng.normal(size=3) * (k % 2)
        made = Defects(old, rng)
        # Copies come last: those of which one is divided are no copies.
        for kind in sorted(rng.choice(KINDS, int(rng.integers(1, 9))), key=KINDS.index):
            made.plant(kind)
        given = made.mesh
        number, order = rng.permutation(given.n_points), rng.permutation(given.n_cells)
        points = np.empty_like(given.points)
        points[number] = scale * (given.points @ turn.T + shift)
        given = SimplexMesh(points, number[given.cells][order])
        new = repair_mesh(given).mesh
        what = f"{base} {k}: {made.planted}"
        was = SimplexMesh(scale * (old.points @ turn.T + shift), old.cells)
        assert (new.measures > 1e-12 * scale**2).all(), what
        assert (new.facet_cell_counts <= 2).all(), what
        assert new.is_closed == was.is_closed, what
        assert open_length(new) == pytest.approx(open_length(was), rel=1e-6, abs=1e-12 * scale), (
            what
        )
        assert euler(new) == euler(was), what
        assert n_components(new) == n_components(was), what
        assert new.measures.sum() == pytest.approx(was.measures.sum(), rel=1e-6), what
        if was.is_closed:
            assert Solid(new).volume == pytest.approx(volume(was), rel=1e-6), what


def test_what_was_repaired_is_said_in_words_with_places():
    rng = np.random.default_rng(8)
    made = Defects(BASES["ring"], rng)
    for kind in KINDS:
        made.plant(kind)
    assert not made.mesh.is_closed
    text = repair_mesh(made.mesh).repairs
    assert text.startswith("surface repaired: ")
    for what in (
        "duplicate point",
        "with corners in one place collapsed",
        "of area 0 removed without opening the surface",
        "on open edges",
        "duplicate triangle",
    ):
        assert what in text
    assert text.count("at (") >= 5
    assert repair_mesh(BASES["ring"]).repairs == ""


def test_tags_of_triangles_and_edges_stay_where_they_are():
    # A unit square of two triangles, one side of which has a flat triangle, in a box.
    base = BASES["box"]
    side = (base.points[base.cells][..., 2] == 1.0).all(axis=1)
    tags = np.where(side, 5, 2)
    edge = [k for k, (a, b) in enumerate(base.edges.tolist())
            if (base.points[[a, b]][:, 1:] == [0.0, 1.0]).all()]  # fmt: skip
    a, b = base.edges[edge[0]]
    cells = base.cells.tolist()
    c = next(k for k, cell in enumerate(cells) if a in cell and b in cell and side[k])
    apex = next(k for k in cells[c] if k not in (a, b))
    while cells[c][0] != apex:
        cells[c] = [*cells[c][1:], cells[c][0]]
    _, one, other = cells[c]
    n = base.n_points
    middle = 0.3 * base.points[one] + 0.7 * base.points[other]
    cells[c] = [apex, one, n]
    cells += [[apex, n, other], [n, one, other]]
    given = SimplexMesh(
        np.concatenate([base.points, [middle]]),
        cells,
        cell_tags=[*tags, 5, 9],
        tagged_facets=base.edges[edge],
        facet_tags=np.full(len(edge), 3),
    )
    new = repair_mesh(given).mesh
    assert new.is_closed
    for tag in (2, 5):
        was, now = base.measures[tags == tag].sum(), new.measures[new.cell_tags == tag].sum()
        assert now == pytest.approx(was)
    assert set(new.cell_tags) == {2, 5}
    ends = new.points[new.tagged_facets]
    assert len(ends) == len(edge) + 1
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(1.0)


def test_walls_and_doubled_surfaces_stay():
    wall = joined(box(), box((1, 0, 0), (2, 1, 1)))
    new = repair_mesh(wall).mesh
    assert new.n_cells == 22
    assert Solid(new).volume == pytest.approx(2.0)
    twice = joined(BASES["ring"], BASES["ring"])
    assert repair_mesh(twice).mesh.n_cells == BASES["ring"].n_cells
    sheet = without(box(), np.arange(2, 12))
    two_sided = SimplexMesh(sheet.points, np.concatenate([sheet.cells, sheet.cells[:, ::-1]]))
    assert repair_mesh(two_sided).mesh.n_cells == 2
    bag = joined(box(), two_sided.moved(two_sided.points + 3.0))
    assert repair_mesh(bag).mesh.n_cells == 12


def test_small_triangles_are_no_flat_ones():
    tiny = box((0, 0, 0), (1e-7, 1e-7, 1e-7))
    new = repair_mesh(joined(box(), tiny.moved(tiny.points + 1.5))).mesh
    assert new.n_cells == 24


def test_two_sheets_that_touch_in_a_node_on_an_edge_are_not_joined():
    flat = SimplexMesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]])
    other = SimplexMesh([[1, 0, 0], [0, -2, 1], [2, -2, 1]], [[0, 1, 2]])
    both = joined(flat, other)
    new = repair_mesh(both)
    assert (new.mesh.n_points, new.mesh.n_cells, new.repairs) == (6, 2, "")
