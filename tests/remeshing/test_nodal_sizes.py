"""Sizes at the nodes of the mesh that is remeshed."""

import numpy as np
import pytest
from meshes import slit_square

from adaptsize import SizeFunction
from adaptsize.options import RemeshOptions, checked
from adaptsize.remeshing.job import prepared

pytest.importorskip("mmgpy")


def requested(mesh, size, **options):
    """The sizes at the nodes in a request to Mmg, and the nodes, in the given unit."""
    requests = prepared(mesh, size, None, checked(RemeshOptions, options)).requests
    problem, frame = requests.to("mmg", 1.0), requests.frame
    return frame.scale * problem.sizes_at_nodes, frame.from_own(problem.mesh.points)


def test_both_sides_of_a_slit_have_the_sizes_that_are_given_there():
    """Interpolation would give both sides of the slit the sizes of one."""
    mesh = slit_square(6)
    h = np.linspace(0.1, 0.2, mesh.n_points)
    assert len(np.unique(mesh.points, axis=0)) < mesh.n_points
    for hmax in (1.0, 0.15):
        found, points = requested(mesh, SizeFunction(mesh, h), hmax=hmax)
        assert len(points) == mesh.n_points
        np.testing.assert_allclose(found, np.minimum(h, hmax), rtol=1e-15)


def test_sizes_of_another_mesh_are_interpolated():
    mesh = slit_square(6)
    other = mesh.moved(1.5 * mesh.points)
    h = 0.1 + 0.02 * other.points[:, 0]
    found, points = requested(mesh, SizeFunction(other, h))
    np.testing.assert_allclose(found, 0.1 + 0.02 * points[:, 0], rtol=1e-12)
