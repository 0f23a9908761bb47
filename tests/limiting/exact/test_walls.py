"""The walls of a mesh, compared with their definition in plain Python."""

from collections import defaultdict
from itertools import combinations

import numpy as np
import pytest
from meshes import random_cube, random_square
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh
from adaptsize.geometry.boundary import flat_boundary


def walls_by_definition(mesh):
    """Return the walls as sorted tuples of nodes, by the rules in the module `boundary`."""
    at, cells = defaultdict(list), mesh.cells.tolist()
    flat = {}
    for c, cell in enumerate(cells):
        edges = mesh.points[cell[1:]] - mesh.points[cell[0]]
        longest = np.linalg.norm(edges, axis=1).max()
        flat[c] = abs(np.linalg.det(edges)) < 1e-12 * longest**mesh.dim
        for facet in combinations(sorted(cell), mesh.dim):
            at[facet].append(c)
    while True:
        lost = {own[0] for own in at.values() if len(own) == 1 and flat[own[0]]}
        if not lost:
            break
        at = {facet: [c for c in own if c not in lost] for facet, own in at.items()}
    walls = set()
    for facet, own in at.items():
        if not own or any(flat[c] for c in own):
            continue
        sides = set()
        for c in own:
            apex = next(i for i in cells[c] if i not in facet)
            edges = mesh.points[[*facet[1:], apex]] - mesh.points[facet[0]]
            sides.add(bool(np.linalg.det(edges) > 0.0))
        if len(sides) == 1:
            walls.add(facet)
    return walls


def punched(mesh, rng):
    kept = rng.random(mesh.n_cells) < rng.uniform(0.5, 1.0)
    kept[0] = True
    return SimplexMesh(mesh.points, mesh.cells[kept])


def with_repeated_and_turned_cells(mesh, rng):
    more = mesh.cells[rng.random(mesh.n_cells) < 0.3][:, rng.permutation(mesh.dim + 1)]
    return SimplexMesh(mesh.points, np.concatenate([mesh.cells, more]))


def on_a_lattice(mesh, rng):
    """Return Delaunay cells of lattice points, many of them flat."""
    points = np.unique(rng.integers(0, 5, (60, mesh.dim)), axis=0).astype(float)
    noise = points + rng.uniform(-1e-9, 1e-9, points.shape)  # so that flat cells are kept
    return SimplexMesh(points, Delaunay(noise).simplices)


def tangled(mesh, rng):
    n = 20
    cells = np.array([rng.choice(n, mesh.dim + 1, replace=False) for _ in range(3 * n)])
    return SimplexMesh(rng.random((n, mesh.dim)), cells)


@pytest.mark.parametrize("seed", range(2311, 2321))
@pytest.mark.parametrize("change", [punched, with_repeated_and_turned_cells, on_a_lattice, tangled])
@pytest.mark.parametrize("dim", [2, 3])
def test_walls_are_those_of_the_definition(dim, change, seed):
    rng = np.random.default_rng(seed)
    mesh = change(random_square(80, seed) if dim == 2 else random_cube(40, seed), rng)
    found = flat_boundary(mesh)
    assert found.alias is None
    assert {tuple(sorted(facet)) for facet in found.facets.tolist()} == walls_by_definition(mesh)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("seed", range(2321, 2331))
@pytest.mark.parametrize("dim", [2, 3])
def test_coincident_nodes_of_a_cell_are_one_whatever_their_places_in_it(dim, seed, threads):
    """The measure of such a cell is not always 0: products cancel to rounding only."""
    rng = np.random.default_rng(seed)
    mesh = random_square(60, seed) if dim == 2 else random_cube(40, seed)
    expected = {tuple(sorted(facet)) for facet in flat_boundary(mesh).facets.tolist()}
    copies = rng.choice(mesh.n_points, 5, replace=False)
    n = mesh.n_points
    more = []
    for k, node in enumerate(copies.tolist()):
        other = rng.choice(np.setdiff1d(np.arange(n), node), dim - 1, replace=False)
        more.append(rng.permutation([node, n + k, *other]))
    points = np.concatenate([mesh.points, mesh.points[copies]])
    found = flat_boundary(SimplexMesh(points, np.concatenate([mesh.cells, more])), threads)
    assert found.alias is not None
    assert {tuple(sorted(facet)) for facet in found.facets.tolist()} == expected
    assert (found.alias[n:] == copies).all()


@pytest.mark.parametrize("cell", [[0, 1, 3], [1, 0, 3], [3, 0, 1]])
def test_a_node_that_only_a_flat_cell_has_opens_no_wall(cell):
    points = [[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [1.0, 0.0]]
    found = flat_boundary(SimplexMesh(points, [[0, 1, 2], cell]))
    walls = {tuple(sorted(facet)) for facet in found.facets.tolist()}
    assert walls == {(0, 1), (0, 2), (1, 2)}
