"""Regions, tags and required facets survive; sizes on surfaces reach into the volume."""

import numpy as np
import pytest
from meshes import structured_square
from numpy.testing import assert_allclose
from shapes import block, facet_areas, two_region_block, two_region_rectangle

from adaptsize import SimplexMesh, remesh


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
    new = remesh(two_region_block(3), 0.25, backend="mmg")
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
    new = remesh(surface, 0.4, backend=backend)
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
