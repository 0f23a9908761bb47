"""Sizes of surfaces with defects: those of the surface that is meshed."""

import warnings

import numpy as np
import pytest
from meshes import random_sphere, with_cracks
from numpy.testing import assert_array_equal
from shapes import CORNERS, CUBE_CELLS, joined, moved

from adaptsize import CartesianGrid, SimplexMesh, size_function
from adaptsize.domain_size.elements import Listener, Maker
from adaptsize.domain_size.reports import report_of
from adaptsize.errors import InputWarning, OpenSurfaceWarning
from adaptsize.remeshing.meshed_surface import surface_to_fill
from adaptsize.remeshing.preparation import repair_mesh

SPHERE = random_sphere(400, 616, radius=3.0)
CUBE = SimplexMesh(CORNERS, CUBE_CELLS)
#: Two cubes with a common face, and one inside of the other.
TWINS = repair_mesh(joined(CUBE, moved(CUBE, [1.0, 0.0, 0.0]))).mesh
NESTED = joined(CUBE, moved(CUBE, 0.25, scale=0.5))


def sized(surface, **options):
    """Sizes, and the warnings of defects."""
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        size = size_function(surface, **options)
    return size, [(one.category, str(one.message)) for one in record]


def of_remesh(surface, **request):
    """The sizes for which `remesh_to_elements` and the command make a mesh."""
    return Maker.of(surface, request, Listener(), None, is_exact=False).sized()


def assert_same(one, other):
    assert_array_equal(one.background.points, other.background.points)
    assert_array_equal(one.values, other.values)
    assert report_of(one).n_elements == report_of(other).n_elements


@pytest.mark.parametrize("surface", [SPHERE, CUBE])
def test_a_surface_without_defects_is_sized_and_meshed_as_it_is(surface):
    assert surface_to_fill(surface).sound.mesh is repair_mesh(surface).mesh
    size, said = sized(surface)
    assert said == []
    assert_array_equal(size.background.points[: surface.n_points], surface.points)
    assert_same(size, of_remesh(surface))


def test_cracks_are_no_narrow_gaps_and_are_reported_as_by_remesh():
    cracked = with_cracks(SPHERE, 8387)
    size, said = sized(cracked)
    assert said == [(InputWarning, repair_mesh(cracked).repairs)]
    assert report_of(size).n_elements == pytest.approx(
        report_of(sized(SPHERE)[0]).n_elements, rel=1e-3
    )
    assert_same(size, of_remesh(cracked))


def test_bounds_at_given_nodes_are_the_least_of_those_that_are_joined():
    cracked = with_cracks(SPHERE, 8387)
    nodes = repair_mesh(cracked).node_map
    once, count = np.unique(nodes, return_counts=True)
    twice = once[count == 2][0]
    h0 = np.full(cracked.n_points, 1.0)
    h0[np.flatnonzero(nodes == twice)[-1]] = 0.05
    size = sized(cracked, h0=h0, elements_per_radian=0.0, tolerance=np.inf, g=1.0)[0]
    assert size.values[twice] == 0.05
    # At the other nodes of the surface, sizes grow from there.
    away = np.linalg.norm(SPHERE.points[:, None] - size.background.points[twice], axis=2)
    assert (size.values[once] >= np.minimum(0.05 + 0.5 * away.min(), 0.05)).all()


@pytest.mark.parametrize(("surface", "whole"), [(TWINS, (2.0, 1.0, 1.0)), (NESTED, (1.0,) * 3)])
def test_facets_inside_of_the_solid_bound_no_sizes(surface, whole):
    size, said = sized(surface)
    assert len(said) == 1
    assert said[0][0] is OpenSurfaceWarning
    assert said[0][1].endswith("facets inside of bodies do not bound the sizes")
    alone = report_of(sized(SimplexMesh(CORNERS * whole, CUBE_CELLS))[0])
    assert report_of(size).n_elements == pytest.approx(alone.n_elements, rel=0.05)
    assert_same(size, of_remesh(surface))


def test_facets_inside_bound_the_sizes_of_a_surface_that_stays_one():
    ball = moved(random_sphere(300, 8391, radius=0.2), 0.5)
    surface = joined(CUBE, ball)
    size = of_remesh(surface, target="triangles")
    assert (size(ball.points) < 0.06).all()  # 4 elements per radian
    assert of_remesh(surface)(ball.points).min() > 0.08


def test_features_of_a_union_are_those_of_its_boundary():
    bar = SimplexMesh(CORNERS * [0.1, 0.1, 2.0] + [0.85, 0.45, -0.5], CUBE_CELLS)
    size, said = sized(joined(CUBE, bar))
    assert [category for category, _ in said] == [OpenSurfaceWarning]
    # Where the bar leaves the cube, it is as far from the edge of that as it is inside.
    assert report_of(size).elements_between == 1.0
    assert size([[0.95, 0.5, 1.0]])[0] == pytest.approx(0.05, rel=0.2)


def test_a_background_gets_the_sizes_of_the_sound_surface_too():
    grid = CartesianGrid.around(SPHERE.points, 0.5, 1.0)
    cracked = with_cracks(SPHERE, 8387)
    one, other = (sized(surface, background=grid)[0] for surface in (SPHERE, cracked))
    assert_array_equal(np.isfinite(one.values), np.isfinite(other.values))
    np.testing.assert_allclose(other.values, one.values, rtol=1e-5)
