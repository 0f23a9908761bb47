"""The time step that sizes allow, and the sizes that a mesh has."""

import numpy as np
import pytest
from meshes import jittered_cube, jittered_square, random_sphere, structured_square
from numpy.testing import assert_allclose

from adaptsize import (
    CartesianGrid,
    PointSource,
    SimplexMesh,
    SizeFunction,
    size_conformity,
    size_function,
)


def test_the_step_is_that_of_the_worst_node():
    mesh = jittered_square(6, 9, half_width=1.0)
    h = 0.1 + 0.05 * np.abs(mesh.points[:, 0])
    size = SizeFunction(mesh, h)
    speed = np.linalg.norm(mesh.points, axis=1)
    advective, diffusive = (h / speed).min(), (h**2 / 4.0 / 0.3).min()
    assert size.time_step(velocity=mesh.points) == pytest.approx(advective)
    assert size.time_step(velocity=lambda x: -x) == pytest.approx(advective)
    assert size.time_step(velocity=speed, courant=0.5) == pytest.approx(0.5 * advective)
    assert size.time_step(diffusivity=0.3) == pytest.approx(diffusive)
    both = size.time_step(velocity=mesh.points, diffusivity=lambda x: np.full(len(x), 0.3))
    assert both == pytest.approx(min(advective, diffusive))
    assert size.time_step(velocity=[0.0, 0.0]) == np.inf
    grid = CartesianGrid([0.0, 0.0, 0.0], 0.5, (3, 4, 5))
    size = SizeFunction(grid, np.full(grid.shape, 0.2))
    assert size.time_step(velocity=lambda x: 1.0 + x, diffusivity=1e-9) == pytest.approx(
        0.2 / np.linalg.norm([2.0, 2.5, 3.0])
    )


def test_all_sizes_that_the_function_returns_count():
    """Those at most hmax off a surface, at inner and point sources, and at active nodes only."""
    ball = random_sphere(200, 7)
    n = ball.n_points
    assert SizeFunction(ball, np.full(n, 0.5), g=0.2, hmax=0.3).time_step(velocity=1.0) == 0.3
    steep = SizeFunction(ball, np.where(np.arange(n) == 5, 0.01, 10.0), g=0.2)
    assert steep.time_step(velocity=np.where(np.arange(n) == 5, 0.0, 1.0)) == pytest.approx(
        np.delete(steep(ball.points), 5).min()
    )
    source = PointSource([0.1, 0.2, 0.1], 0.01)
    cube = jittered_cube(4, 3, half_width=1.0)
    for inside in (size_function(domain, sources=source, hmax=0.3) for domain in (ball, cube)):
        assert inside.time_step(velocity=lambda x: 2.0 + 0.0 * x[:, 0]) == pytest.approx(0.005)
        with pytest.raises(ValueError, match="a number, a vector or a function of points"):
            inside.time_step(velocity=inside.background.points)
    active = np.ones((3, 4), np.bool_)
    active[2] = False
    grid = CartesianGrid([0.0, 0.0], 0.5, (3, 4), active=active)
    h = np.where(active, 0.2, np.inf)
    speed = np.where(active, 2.0, 100.0)
    size = SizeFunction(grid, h)
    for velocity in (speed, speed.ravel(), np.stack([speed, 0.0 * speed], axis=2)):
        assert size.time_step(velocity=velocity) == pytest.approx(0.1)
    loose = SimplexMesh([[0, 0], [1, 0], [0, 1], [5, 5]], [[0, 1, 2]])
    assert SizeFunction(loose, [1.0, 1.0, 1.0, np.inf]).time_step(velocity=1.0) == 1.0


def test_a_vector_that_may_be_speeds_is_refused():
    flat = SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    size = SizeFunction(flat, np.ones(3))
    for velocity in ([3.0, 4.0, 0.0], lambda x: [3.0, 4.0, 0.0]):
        with pytest.raises(ValueError, match="may be one vector or the speeds at 3 points"):
            size.time_step(velocity=velocity)
    assert size.time_step(velocity=[[3.0, 4.0, 0.0]] * 3) == pytest.approx(0.2)
    assert size.time_step(diffusivity=[1.0, 2.0, 3.0]) == pytest.approx(1.0 / 18.0)


def test_what_has_no_step_is_refused():
    size = SizeFunction(structured_square(2), np.full(9, 0.2))
    for options, message in (
        ({}, "velocity or diffusivity must be given, got neither"),
        ({"velocity": np.zeros(4)}, r"velocity must have shape \(\), \(9,\), \(2,\) or \(9, 2\)"),
        ({"velocity": -1.0}, "velocity must be >= 0"),
        ({"diffusivity": [1.0, 2.0]}, r"diffusivity must have shape \(\) or \(9,\), got"),
        ({"velocity": 1.0, "courant": 0.0}, "courant must be finite and > 0"),
    ):
        with pytest.raises(ValueError, match=message):
            size.time_step(**options)


@pytest.mark.parametrize("mesh", [jittered_square(9, 3), jittered_cube(4, 3)])
def test_a_mesh_follows_the_sizes_that_it_has(mesh):
    h = mesh.sizes()
    assert size_conformity(mesh, h).share_in_band > 0.85
    turned = mesh.points[:, ::-1] * 3.0 + 1.0
    assert_allclose(SimplexMesh(turned, mesh.cells[::-1]).sizes(), 3.0 * h)
    loose = SimplexMesh([*mesh.points, mesh.points[0] + 1.0], mesh.cells).sizes()
    assert_allclose(loose[:-1], h)
    assert loose[-1] == np.inf
