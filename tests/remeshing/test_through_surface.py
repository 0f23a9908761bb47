"""Hexahedra divided into tetrahedra, some of them inside out: made anew from their facets."""

from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from fake_generators import Recording, RecordingRunner, registered

from adaptsize import SimplexMesh
from adaptsize.background.topology import pairs_of_cells
from adaptsize.errors import BackendError
from adaptsize.geometry.enclosed import enclosed_measure
from adaptsize.quality.elements import folded_cells
from adaptsize.remeshing.preparation import as_problem, repair_mesh
from adaptsize.remeshing.through_surface import refilled

SHAPE = (6, 2, 2)


def bent_block(moved=0.0):
    """A bent block of hexahedra in six tetrahedra each, two regions, tagged ends.

    An inner node is moved by so much, which turns cells inside out if it is more than their edges.
    """
    nodes = np.array(list(product(*(range(n + 1) for n in SHAPE))), float) / SHAPE
    number = np.arange(len(nodes)).reshape(*(n + 1 for n in SHAPE))
    cells, regions = [], []
    for corner in product(*map(range, SHAPE)):
        for order in permutations(range(3)):
            path = [number[corner]]
            at = list(corner)
            for axis in order:
                at[axis] += 1
                path.append(number[tuple(at)])
            cells.append(path)
            regions.append(3 if corner[0] < 4 else 5)
    x, y, z = nodes.T
    points = np.column_stack([(1.0 + 0.4 * y) * np.sin(x), (1.0 + 0.4 * y) * np.cos(x), 0.5 * z])
    points[number[1, 1, 1], 0] += moved
    ends = SimplexMesh(points, cells).boundary()
    facets = ends.nodes[ends.mesh.cells]
    tags = np.where(
        (x[facets] == 0.0).all(axis=1), 7, np.where((x[facets] == 1.0).all(axis=1), 8, 9)
    )
    mesh = SimplexMesh(
        points, cells, cell_tags=regions, tagged_facets=facets, facet_tags=tags,
        tag_names={(3, 3): "near"},
    )  # fmt: skip
    return repair_mesh(mesh).mesh


def problem_of(mesh, h=0.4):
    return replace(as_problem("tetrahedra", mesh, 1e-2), size=lambda x: np.full(len(x), h))


@pytest.mark.parametrize("moved", [0.0, 0.25])
def test_cells_fill_more_than_their_boundary_encloses_where_some_are_folded(moved):
    for scale in (1.0, 1e-4, 1e5):
        mesh = bent_block(moved)
        mesh = mesh.moved(scale * (mesh.points + 2.0))
        enclosed = enclosed_measure(mesh.boundary().mesh)
        assert (mesh.measures.sum() > (1.0 + 1e-9) * enclosed) == (moved > 0.0)
        assert folded_cells(mesh).any() == (moved > 0.0)


@pytest.mark.parametrize("moved", [0.0, 0.25])
def test_folded_cells_are_found_where_the_boundary_is_not_manifold(moved):
    block = bent_block(moved)
    edge = block.tagged_facets[block.facet_tags == 7][0, :2]
    points = np.concatenate([block.points, [[0.0, 9.0, 0.0], [0.0, 9.0, 1.0]]])
    cell = np.append(edge, block.n_points + np.arange(2))
    mesh = repair_mesh(SimplexMesh(points, np.concatenate([block.cells, [cell]]))).mesh
    assert mesh.boundary().mesh.facet_cell_counts.max() == 4
    assert folded_cells(mesh).any() == (moved > 0.0)


def check(new, mesh, rel):
    straight = bent_block()
    assert (new.signed_measures > 0.0).all()
    for tag in (3, 5):
        was = straight.measures[straight.cell_tags == tag].sum()
        assert new.measures[new.cell_tags == tag].sum() == pytest.approx(was, rel=rel)
    assert set(new.facet_tags) == {7, 8, 9}
    assert new.tag_names == mesh.tag_names
    for tag in (7, 8):
        old, now = (
            SimplexMesh(one.points, one.tagged_facets[one.facet_tags == tag]).measures.sum()
            for one in (straight, new)
        )
        assert now == pytest.approx(old, rel=rel)


def test_regions_and_tags_are_kept_when_netgen_fills_them():
    pytest.importorskip("mmgpy")
    pytest.importorskip("netgen")
    run, mesh = RecordingRunner.without(), bent_block(0.25)
    check(refilled(problem_of(mesh), run), mesh, 0.01)
    assert [name for name, *_ in run.jobs][:2] == ["netgen:tetrahedralize"] * 2  # for each region
    assert {name for name, *_ in run.jobs[2:]} == {"tetrahedra"}  # the task of Mmg


def test_ftetwild_makes_the_mesh_if_netgen_fails():
    pytest.importorskip("pytetwild")
    mesh = bent_block(0.25)
    check(refilled(problem_of(mesh), RecordingRunner.without("netgen:tetrahedralize")), mesh, 0.03)


def test_ftetwild_is_tried_if_mmg_fails_again():
    pytest.importorskip("netgen")
    mmg, tetwild = Recording("mmg", fails=True), Recording("tetwild", fails=True)
    with registered(mmg, tetwild), pytest.raises(BackendError, match="tetwild failed"):
        refilled(problem_of(bent_block(0.25)), RecordingRunner.without())
    assert (len(mmg.problems), len(tetwild.problems)) == (1, 1)


def test_what_ftetwild_cannot_do_is_refused():
    run = RecordingRunner.without("netgen:tetrahedralize")
    mesh = bent_block(0.25)
    required = as_problem("tetrahedra", mesh, 1e-2, mesh.tagged_facets[:1])
    with pytest.raises(BackendError, match="netgen failed"):
        refilled(replace(required, size=lambda x: np.full(len(x), 0.3)), run)


def test_netgen_is_not_started_where_facets_lie_inside_a_region():
    mesh = bent_block()
    inner = mesh.facets[mesh.facet_cell_counts == 2]
    regions = mesh.cell_tags[pairs_of_cells(mesh, mesh.facet_cell_counts == 2) // 4]
    free = inner[regions[:, 0] == regions[:, 1]][:1]
    tagged = replace(mesh, tagged_facets=free, facet_tags=[4])
    run, tetwild = RecordingRunner.without(), Recording("tetwild", fails=True)
    with registered(tetwild), pytest.raises(BackendError, match="tetwild failed"):
        refilled(problem_of(tagged), run)
    assert not run.jobs
