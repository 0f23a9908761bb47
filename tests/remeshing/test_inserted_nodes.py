"""Nodes inserted in cavities: each facet inside of the mesh stays a face of cells."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from adaptsize import CartesianGrid, SimplexMesh
from adaptsize._kernels.boundary_repair import INSERTION, LIFT
from adaptsize._kernels.complexes import CELLS, FACETS
from adaptsize._kernels.insertion import insert_in_facets
from adaptsize._kernels.local_mesh import new_work
from adaptsize.background.topology import regions_beside
from adaptsize.remeshing import boundary_repair, tuning
from adaptsize.remeshing.boundary_repair import Wanted, angles_of, repaired


def _jittered(rng, n, more):
    """Tetrahedra of a unit cube between jittered nodes of a grid and, last, given ones."""
    at = np.linspace(0.0, 1.0, n)
    points = np.stack(np.meshgrid(at, at, at, indexing="ij"), -1).reshape(-1, 3)
    inside = ((points > 0.0) & (points < 1.0)).all(axis=1)
    points[inside] += rng.uniform(-0.35, 0.35, (inside.sum(), 3)) / (n - 1)
    if len(more):
        away = np.linalg.norm(points[:, None] - more[None], axis=2).min(axis=1)
        points = np.concatenate([points[~inside | (away > 0.5 / (n - 1))], more])
    cells = Delaunay(points).simplices
    measures = np.linalg.det(points[cells][:, 1:] - points[cells][:, :1])
    cells[measures < 0.0] = cells[measures < 0.0][:, [1, 0, 2, 3]]
    return SimplexMesh(points, cells[np.abs(measures) > 1e-9])


def with_sheet(seed):
    """A cube with a tagged sheet inside, whose border is ragged."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.2, 0.8, (2, 40))
    sheet = np.column_stack([x, y, 0.5 + 0.08 * np.sin(9.0 * x)])
    mesh = _jittered(rng, 8, sheet)
    facets = mesh.facets[(mesh.facets >= mesh.n_points - len(sheet)).all(axis=1)]
    return replace(mesh, tagged_facets=facets, facet_tags=np.full(len(facets), 7))


def with_ragged_interface(seed):
    """A cube of two regions whose interface consists of faces as they are."""
    mesh = _jittered(np.random.default_rng(seed), 8, np.empty((0, 3)))
    away = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1) - 0.5, axis=1)
    mesh = replace(mesh, cell_tags=(away < 0.33).astype(np.int32) + 1)
    facets = _between(mesh)
    return replace(mesh, tagged_facets=facets, facet_tags=np.full(len(facets), 9))


def _between(mesh):
    lowest, highest = regions_beside(mesh.cell_facets, mesh.cell_tags, len(mesh.facets))
    return mesh.facets[(lowest != highest) & (mesh.facet_cell_counts == 2)]


def _sorted(facets):
    return set(map(tuple, np.sort(facets, axis=1).tolist()))


def check_rows(local):
    """Every facet is a face, and faces on the boundary and between regions are facets."""
    nodes, (label, level) = local.cx.nodes, local.cx.about[:, :2].T
    facets = nodes[level == FACETS, :3]
    mesh = SimplexMesh(local.points, nodes[level == CELLS], cell_tags=label[level == CELLS])
    assert len(_sorted(facets)) == len(facets)
    assert _sorted(facets) <= _sorted(mesh.facets)
    assert mesh.facet_cell_counts.max() == 2
    outer = mesh.facets[mesh.facet_cell_counts == 1]
    assert _sorted(np.concatenate([outer, _between(mesh)])) <= _sorted(facets)


@pytest.fixture
def checked(monkeypatch):
    """Check the rows after each repair; the list has the numbers of operations."""
    counted = []

    def checking(local, n_cells, work, limits, counts):
        check_rows(local)  # after the insertion of wanted nodes
        repair(local, n_cells, work, limits, counts)
        check_rows(local)
        counted.append(counts)

    repair = boundary_repair.repair
    monkeypatch.setattr(boundary_repair, "repair", checking)
    return counted


def test_insertion_is_only_called_for_cells_that_nothing_else_improves(monkeypatch):
    """It is compiled for its first cell."""
    asked, insert = [], boundary_repair.insert_best

    def recorded(local, cell, work):
        asked.append(float(local.angle[cell]))
        return insert(local, cell, work)

    monkeypatch.setattr(boundary_repair, "insert_best", recorded)
    grid = CartesianGrid([0.0] * 3, 1.0, (3, 3, 3)).mesh
    points = grid.points.copy()
    points[13, 0] = 0.05  # the node in the middle
    flat = grid.moved(points)
    assert angles_of(repaired(flat, grid, 0.1)).min() > angles_of(flat).min()
    assert asked == []
    mesh = with_sheet(1)
    repaired(mesh, mesh, 0.02 * mesh.diagonal)
    assert asked
    assert max(asked) < tuning.INSERTED_BELOW


MADE = {"sheet": with_sheet, "interface": with_ragged_interface}


@pytest.mark.parametrize("seed", [1, 3, 5])
@pytest.mark.parametrize("name", MADE)
def test_facets_inside_stay_faces_of_cells_after_a_repair(name, seed, checked):
    mesh = MADE[name](seed)
    new = repaired(mesh, mesh, 0.02 * mesh.diagonal)
    assert sum(counts[INSERTION] for counts in checked) > 0
    assert _sorted(new.tagged_facets) <= _sorted(new.facets)
    if name == "interface":
        assert _sorted(new.tagged_facets) == _sorted(_between(new))
    assert new.measures.sum() == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("seed", [1, 3, 5])
@pytest.mark.parametrize("name", MADE)
def test_facets_inside_stay_faces_of_cells_with_nodes_wanted_in_them(name, seed, checked):
    mesh, rng = MADE[name](seed), np.random.default_rng(seed)
    weights = rng.dirichlet([1.0, 1.0, 1.0], len(mesh.tagged_facets))
    places = np.einsum("nk,nkd->nd", weights, mesh.points[mesh.tagged_facets])
    wanted = Wanted(places, mesh.tagged_facets, 1.0)
    sizes = np.full(mesh.n_points, 0.05)
    new = boundary_repair._improved(mesh, mesh, 0.02, sizes, 5.0, keep_sharp=False, wanted=wanted)[
        0
    ]
    assert checked[0][INSERTION] > 0
    assert _sorted(new.tagged_facets) <= _sorted(new.facets)


def test_wanted_nodes_make_no_cell_worse_than_the_worst_one(monkeypatch):
    mesh = with_ragged_interface(1)
    mesh = repaired(mesh, mesh, 0.02 * mesh.diagonal)
    for name in ("GOAL", "LAST_GOAL"):  # no repair afterwards
        monkeypatch.setattr(tuning, name, {"tetrahedra": 0.1})
    places = np.einsum("k,nkd->nd", [0.8, 0.15, 0.05], mesh.points[mesh.tagged_facets])
    wanted = Wanted(places, mesh.tagged_facets, 0.5)
    new = repaired(mesh, mesh, 0.02, lambda x: np.full(len(x), 0.05), wanted)
    assert angles_of(new).min() >= angles_of(mesh).min() - 1e-9


def test_there_is_room_for_the_nodes_that_may_be_added():
    """Beside these, rows are only needed by operations that add cells: others go on without."""
    mesh = with_ragged_interface(1)
    weights = [[0.4, 0.3, 0.3], [0.1, 0.6, 0.3]]
    places = np.einsum("mk,nkd->nmd", weights, mesh.points[mesh.tagged_facets]).reshape(-1, 3)
    facets = np.repeat(mesh.tagged_facets, 2, axis=0).astype(np.int64)
    points = np.array(mesh.points)  # all is compiled once more for arrays that are read-only
    follower = boundary_repair.Follower(points, points, 0.02, np.ones(len(points), np.bool_))
    sizes = np.full(mesh.n_points, 0.05)
    local, _ = boundary_repair.local_mesh(mesh, mesh, follower, sizes, 20.0, keep_sharp=False)
    room, free = len(local.points) - mesh.n_points, int(local.cx.n_free[0])
    work, counts = new_work(len(local.points), len(local.angle)), np.zeros(LIFT + 1, np.int64)
    assert insert_in_facets(local, places, facets, 1.0, work) == room > 70
    assert free - local.cx.n_free[0] > mesh.n_cells // 8
    check_rows(local)
    hidden = int(local.cx.n_free[0])
    local.cx.n_free[0] = 0
    boundary_repair.repair(local, mesh.n_cells, work, (40, 16.0), counts)
    assert hidden > mesh.n_cells // 4
    assert counts[6] > 50
    check_rows(local)
