"""Regions, tags and required facets survive; sizes on surfaces reach into the volume."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import structured_square
from numpy.testing import assert_allclose, assert_array_equal
from shapes import block, facet_areas, two_region_block, two_region_rectangle

from adaptsize import SimplexMesh, SizeFunction, remesh
from adaptsize.remeshing.sizing import as_size


def region_measure(mesh, tag):
    return mesh.measures[mesh.cell_tags == tag].sum()


def sides(mesh):
    """Return for each tagged facet the set of regions of the cells it belongs to."""
    row = {tuple(f): i for i, f in enumerate(mesh.facets)}
    beside = [set() for _ in mesh.facets]
    for cell, numbers in enumerate(mesh.cell_facets):
        for number in numbers:
            beside[number].add(int(mesh.cell_tags[cell]))
    return [beside[row[tuple(sorted(f))]] for f in mesh.tagged_facets.tolist()]


def test_mmg_keeps_regions_interface_and_tags_of_tetrahedra_exactly():
    pytest.importorskip("mmgpy")
    names = {(3, 7): "left", (2, 40): "interface"}
    new = remesh(replace(two_region_block(3), tag_names=names), 0.25, backend="mmg")
    assert new.tag_names == names
    assert set(np.unique(new.cell_tags)) == {7, -3}
    assert_allclose([region_measure(new, 7), region_measure(new, -3)], 1.0, rtol=1e-12)
    assert set(np.unique(new.facet_tags)) == {40, 41, 42}  # the untagged sides stay untagged
    assert_allclose([facet_areas(new, tag) for tag in (40, 41, 42)], 1.0, rtol=1e-12)
    expected = {40: {7, -3}, 41: {7}, 42: {-3}}
    assert sides(new) == [expected[int(tag)] for tag in new.facet_tags]


def test_tetwild_keeps_regions_interface_and_tags_within_the_tolerance():
    given = two_region_block(2)
    new = remesh(given, 0.3, backend="tetwild", tolerance=2e-3)
    # Flat faces move by at most the tolerance, 2e-3 * 2.4; six of them bound a cube.
    slack = 6 * 2e-3 * given.diagonal
    assert set(np.unique(new.cell_tags)) == {7, -3}
    assert_allclose([region_measure(new, 7), region_measure(new, -3)], 1.0, atol=slack)
    assert set(np.unique(new.facet_tags)) == {40, 41, 42}
    assert_allclose([facet_areas(new, tag) for tag in (40, 41, 42)], 1.0, atol=0.05)
    x = new.points[new.tagged_facets][:, :, 0].mean(axis=1)
    place = {40: 1.0, 41: 0.0, 42: 2.0}
    assert_allclose(x, [place[int(tag)] for tag in new.facet_tags], atol=2e-3 * given.diagonal)


def test_mmg_keeps_regions_and_tags_of_triangles_exactly():
    pytest.importorskip("mmgpy")
    new = remesh(two_region_rectangle(4), 0.1)
    assert_allclose([region_measure(new, 5), region_measure(new, 9)], 1.0, rtol=1e-12)
    assert set(np.unique(new.facet_tags)) == {30, 31}
    assert_allclose([facet_areas(new, 30), facet_areas(new, 31)], 1.0, rtol=1e-12)


def test_required_facets_stay_as_they_are():
    pytest.importorskip("mmgpy")
    given = two_region_block(3)
    end = given.tagged_facets[given.facet_tags == 41]
    new = remesh(given, 0.15, required_facets=end)
    old = {tuple(map(tuple, np.sort(given.points[f], axis=0))) for f in end}
    now = new.facets[new.facet_cell_counts == 1]
    kept = {tuple(map(tuple, np.sort(new.points[f], axis=0))) for f in now}
    assert old <= kept
    assert new.n_cells > 2 * given.n_cells  # the rest was refined
    other = given.tagged_facets[given.facet_tags == 42]
    changed = {tuple(map(tuple, np.sort(given.points[f], axis=0))) for f in other}
    assert not changed <= kept


@pytest.mark.parametrize(("backend", "package"), [("tetwild", "pytetwild"), ("mmg", "netgen")])
def test_tags_of_a_surface_become_tags_of_the_boundary(backend, package):
    pytest.importorskip(package)
    cube = block(1).boundary().mesh
    top = (cube.points[cube.cells][:, :, 2] > 0.5).all(axis=1)
    surface = SimplexMesh(cube.points, cube.cells, cell_tags=np.where(top, 5, 8))
    new = remesh(surface, 0.4, backend=backend, tolerance=2e-3)
    slack = 6e-3
    assert facet_areas(new, 5) == pytest.approx(1.0, abs=slack * 3)
    assert facet_areas(new, 8) == pytest.approx(5.0, abs=slack * 15)


def test_an_open_surface_is_adapted_and_keeps_its_rim():
    pytest.importorskip("mmgpy")
    plane = structured_square(8, half_width=0.5)
    height = 0.1 * np.sin(3 * plane.points[:, 0] + 1.5)
    given = SimplexMesh(np.column_stack([plane.points, height]), plane.cells)
    new = remesh(given, 0.06, target="triangles")
    rim, old_rim = new.boundary().mesh.measures.sum(), given.boundary().mesh.measures.sum()
    assert rim == pytest.approx(old_rim, rel=5e-3)
    assert new.measures.sum() == pytest.approx(given.measures.sum(), rel=5e-3)
    assert np.median(new.edge_lengths) == pytest.approx(0.06, rel=0.15)


def test_sides_beside_required_edges_stay_straight():
    pytest.importorskip("mmgpy")
    # The required edge from node 1 to 2 continues the side y = 0 at an angle of 11 degrees.
    points = np.array([[0.0, 0.0], [1, 0], [2, -0.2], [2, 1], [0, 1], [1, 1]])
    given = SimplexMesh(points, [[0, 1, 5], [0, 5, 4], [1, 2, 3], [1, 3, 5]])
    new = remesh(given, 0.15, backend="mmg", required_facets=[[1, 2]], tolerance=0.02)
    boundary = new.points[new.boundary().nodes]
    side = boundary[(boundary[:, 0] <= 1.0) & (boundary[:, 1] < 0.1)]
    assert len(side) > 5
    assert_allclose(side[:, 1], 0.0, atol=1e-12)


def test_a_tagged_sheet_inside_one_region_is_kept():
    pytest.importorskip("mmgpy")
    plain = two_region_block(3)
    sheet = plain.tagged_facets[plain.facet_tags == 40]
    given = SimplexMesh(
        plain.points, plain.cells, tagged_facets=sheet, facet_tags=np.full(len(sheet), 40)
    )
    new = remesh(given, 0.2)
    assert new.cell_tags is None
    assert facet_areas(new, 40) == pytest.approx(1.0, rel=1e-12)


def test_sizes_on_a_surface_are_the_same_wherever_they_are_asked_for():
    surface = block(2).boundary().mesh
    size = SizeFunction(surface, np.full(surface.n_points, 0.2), g=0.5, hmax=0.3)
    nodal = as_size(size.values, surface, g=0.5, hmax=0.3)
    points = np.random.default_rng(905).random((50, 3))
    depth = np.minimum(points, 1.0 - points).min(axis=1)
    assert_allclose(size(points), np.minimum(0.2 + 0.5 * depth, 0.3), rtol=1e-12)
    assert_array_equal(nodal(points), size(points))
    assert_array_equal(as_size(size, surface, g=9.0)(points), size(points))  # its own g counts


def test_sizes_that_required_facets_forbid_draw_no_warning():
    pytest.importorskip("mmgpy")
    given = two_region_rectangle(4)
    skin = given.boundary()
    new = remesh(given, 4.0, required_facets=skin.nodes[skin.mesh.cells])
    assert (new.facet_cell_counts == 1).sum() == skin.mesh.n_cells
