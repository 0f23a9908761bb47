"""Sizes on curved interfaces inside a mesh, which generators keep as they keep the boundary."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from adaptive_loops import disc

from adaptsize import SimplexMesh, read, size_function
from adaptsize.background.interfaces import interfaces

DATA = Path(__file__).parents[2] / "data"
RINGS = 16


def two_regions(radius):
    """A disc of radius 1 with another region up to a ring of nodes."""
    mesh = disc(RINGS)
    inner = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1) < radius
    return replace(mesh, cell_tags=inner.astype(np.int32))


def with_tagged_interface(mesh):
    """The same facets between regions as tagged facets of one region."""
    facets, nodes = interfaces(mesh)
    return replace(
        mesh, cell_tags=None, tagged_facets=nodes[facets.cells], facet_tags=[3] * facets.n_cells
    )


@pytest.mark.parametrize("of", [lambda mesh: mesh, with_tagged_interface])
def test_curved_interfaces_are_resolved(of):
    mesh = of(two_regions(0.25))
    options = {"elements_per_radian": 5.0, "elements_across": 0.0, "g": 0.1, "hmax": 1.0}
    options["tolerance"] = np.inf
    size = size_function(mesh, **options)
    r = np.linalg.norm(mesh.points, axis=1)
    at_interface, at_boundary = np.isclose(r, 0.25), np.isclose(r, 1.0)
    assert at_interface.sum() > 10
    np.testing.assert_allclose(size.values[at_interface], 0.25 / 5.0, rtol=1e-12)
    # Exact limiting: from a polygon of the interface, not from the circle.
    np.testing.assert_allclose(size.values[at_boundary], 0.05 + 0.1 * 0.75, rtol=1e-2)
    without = size_function(
        replace(mesh, cell_tags=None, tagged_facets=None, facet_tags=None), **options
    )
    np.testing.assert_allclose(without.values[at_boundary], 0.2, rtol=1e-12)


def test_plane_interfaces_and_tags_of_the_boundary_change_nothing():
    mesh = disc(RINGS)
    plain = size_function(mesh)
    boundary = mesh.facets[mesh.facet_cell_counts == 1]
    tagged = replace(mesh, tagged_facets=boundary, facet_tags=np.ones(len(boundary), np.int32))
    assert interfaces(tagged) is None
    np.testing.assert_array_equal(size_function(tagged).values, plain.values)
    square = SimplexMesh([[0, 0], [2, 0], [2, 2], [0, 2]], [[0, 1, 2], [0, 2, 3]])
    halves = replace(square, cell_tags=[1, 2])
    assert interfaces(halves)[1].tolist() == [0, 2]
    np.testing.assert_array_equal(size_function(halves).values, size_function(square).values)


def test_a_ball_in_a_block_is_resolved():
    mesh = read(DATA / "block.vtu")
    size = size_function(mesh, hmax=8.0, tolerance=np.inf)
    report = size.report
    on_ball, radius = interfaces(mesh)[1], 6.0
    assert np.median(size.values[on_ball]) == pytest.approx(radius / 4.0, rel=0.05)
    assert "curvature" in str(report)
