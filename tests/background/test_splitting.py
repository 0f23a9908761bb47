"""Tetrahedra with new nodes in the middle of all edges."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh
from adaptsize.background.splitting import halve_tetrahedra


def turned_box(rng):
    """Return tetrahedra in general position, and their tagged boundary."""
    mesh = CartesianGrid([0.0, 0.0, 0.0], 0.5, (3, 3, 4)).mesh
    points = mesh.points @ rng.normal(size=(3, 3)) + 0.02 * rng.normal(size=mesh.points.shape)
    outer = mesh.facets[mesh.facet_cell_counts == 1]
    return SimplexMesh(
        points, mesh.cells, cell_tags=np.arange(mesh.n_cells) % 3, tagged_facets=outer,
        facet_tags=np.arange(len(outer)) % 5, tag_names={(3, 1): "inner"},
    )  # fmt: skip


def measure_of(points, simplices):
    return SimplexMesh(points, simplices).measures.sum()


def test_parts_fill_their_tetrahedra_and_conform():
    mesh = turned_box(np.random.default_rng(3))
    fine = halve_tetrahedra(mesh)
    assert fine.n_cells == 8 * mesh.n_cells
    assert_allclose(fine.measures.reshape(8, -1).sum(axis=0), mesh.measures, rtol=1e-10)
    # With hanging nodes there would be more facets of one cell.
    outer = mesh.facet_cell_counts == 1
    assert (fine.facet_cell_counts == 1).sum() == 4 * outer.sum()
    assert fine.tag_names == mesh.tag_names
    for tag in range(3):
        own = mesh.measures[mesh.cell_tags == tag].sum()
        assert_allclose(fine.measures[fine.cell_tags == tag].sum(), own, rtol=1e-12)
    for tag in range(5):
        parts = fine.tagged_facets[fine.facet_tags == tag]
        own = mesh.tagged_facets[mesh.facet_tags == tag]
        assert len(parts) == 4 * len(own)
        assert_allclose(measure_of(fine.points, parts), measure_of(mesh.points, own), rtol=1e-12)


def test_parts_do_not_depend_on_the_order_of_nodes_and_cells():
    rng = np.random.default_rng(4)
    mesh = turned_box(rng)
    order, cells = rng.permutation(mesh.n_points), rng.permutation(mesh.n_cells)
    other = SimplexMesh(mesh.points[order], np.argsort(order)[mesh.cells[cells]])

    def facets(one):
        middles = one.points[one.facets].mean(axis=1).round(9)
        return middles[np.lexsort(middles.T)]

    assert_array_equal(facets(halve_tetrahedra(mesh)), facets(halve_tetrahedra(other)))
