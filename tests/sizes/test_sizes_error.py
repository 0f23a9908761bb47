"""Sizes from error indicators and from second derivatives."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import random_square
from numpy.testing import assert_allclose, assert_array_equal
from recovery import MESHES

from adaptsize import SimplexMesh
from adaptsize.sizes import (
    predict,
    recovered_gradient,
    recovered_hessian,
    size_from_error,
    size_from_hessian,
    zz_indicator,
)
from adaptsize.sizes.budget import present_sizes


def isolated(mesh):
    """The same cells without common nodes, so that nodal sizes are those of the cells."""
    cells = np.arange(mesh.cells.size).reshape(mesh.cells.shape)
    return SimplexMesh(mesh.points[mesh.cells].reshape(-1, mesh.dim), cells)


def isolated_ratios(mesh, eta, **options):
    alone = isolated(mesh)
    options = {"max_refine": 1e6, "max_coarsen": np.inf, **options}
    h = size_from_error(alone, eta, **options).reshape(mesh.cells.shape)
    assert_allclose(h, h[:, :1] * np.ones(mesh.cells.shape[1]), rtol=1e-12)
    return h[:, 0] / present_sizes(mesh)


def test_predicted_error_is_the_tolerance():
    mesh = MESHES["jittered"](9)
    eta = np.random.default_rng(41).uniform(0.0, 3.0, mesh.n_cells)
    for tolerance in (0.1, 1.0, 10.0):
        ratio = isolated_ratios(mesh, eta, order=2, tolerance=tolerance)
        assert np.linalg.norm(eta * ratio**2) == pytest.approx(tolerance, rel=1e-3)
    # The bounds on the change are taken into account, not put on top.
    ratio = isolated_ratios(mesh, eta, order=2, tolerance=5.0, max_refine=2.2, max_coarsen=1.0)
    assert np.linalg.norm(eta * ratio**2) == pytest.approx(5.0, rel=1e-3)
    assert (ratio.min(), ratio.max()) == pytest.approx((1.0 / 2.2, 1.0))


@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 2.0, 3.5]), st.floats(0.2, 5.0))
def test_number_of_elements_is_kept_by_nodal_sizes(seed, order, share):
    mesh = random_square(40, seed)
    eta = np.random.default_rng(seed).exponential(size=mesh.n_cells)
    wanted = share * mesh.n_cells
    h = size_from_error(mesh, eta, order=order, elements=wanted, max_refine=9, max_coarsen=9)
    assert predict(mesh, h).cells == pytest.approx(wanted, rel=1e-3)


@given(st.integers(0, 2**32 - 1), st.floats(1.0, 5.0), st.floats(1.0, 5.0))
def test_sizes_change_by_no_more_than_the_factors(seed, max_refine, max_coarsen):
    mesh = random_square(30, seed)
    eta = np.random.default_rng(seed).exponential(size=mesh.n_cells) ** 4
    alone, now = isolated(mesh), np.repeat(present_sizes(mesh), 3)
    for goal in ({"tolerance": 0.01}, {"tolerance": 1e3}, {"elements": 50.0}):
        h = size_from_error(
            alone, eta, order=1, max_refine=max_refine, max_coarsen=max_coarsen, **goal
        )
        assert (h >= now / max_refine * (1.0 - 1e-9)).all()
        assert (h <= now * max_coarsen * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("way", ["error", "hessian"])
def test_number_of_elements_is_that_after_limiting_and_clipping(way):
    mesh = MESHES["jittered"](21)
    x = mesh.points
    u = np.exp(-30.0 * ((x - 0.3) ** 2).sum(axis=1))
    eta = zz_indicator(mesh, u)
    away = np.linalg.norm(x[:, None] - x, axis=2)  # the distances in a convex domain
    options = {"hmin": 0.02, "hmax": 0.3, "g": 0.2}
    for wanted in (500, 3000):
        if way == "error":
            h = size_from_error(mesh, eta, order=1, elements=wanted, max_refine=16, **options)
        else:
            h = size_from_hessian(mesh, u, elements=wanted, **options)
        assert predict(mesh, h).cells == pytest.approx(wanted, rel=1e-3)
        assert h.min() >= 0.02
        assert h.max() <= 0.3
        assert_allclose((h + 0.2 * away).min(axis=1), h, rtol=1e-12)


def interpolation_error(corners, hessian, n=24):
    """Largest error of linear interpolation of x.H.x / 2 in each simplex, on a lattice."""
    d = corners.shape[2]
    lattice = [b for b in itertools.product(range(n + 1), repeat=d) if sum(b) <= n]
    weights = np.array([[n - sum(b), *b] for b in lattice]) / n
    u = lambda x: 0.5 * np.einsum("...i,ij,...j->...", x, hessian, x)  # noqa: E731
    at = np.einsum("qi,mid->mqd", weights, corners)
    linear = np.einsum("qi,mi->mq", weights, u(corners))
    return np.abs(u(at) - linear).max(axis=1)


@pytest.mark.parametrize("dim", [2, 3])
def test_interpolation_keeps_the_tolerance_with_edges_of_the_size(dim):
    regular = np.eye(dim + 1) / np.sqrt(2.0)  # edges 1, in a plane of dim + 1 dimensions
    basis = np.linalg.qr(np.eye(dim + 1) - 1.0 / (dim + 1))[0][:, :dim]
    corners = (regular @ basis)[None]
    # Both sides of what the docstring derives: h^2 d / (4 (d + 1)) times the derivative.
    error = interpolation_error(corners, np.eye(dim), n=24)[0]
    assert error == pytest.approx(dim / (4.0 * (dim + 1.0)), rel=1e-9)
    mesh = MESHES["jittered" if dim == 2 else "cube"](7)
    turn = np.linalg.qr(np.random.default_rng(6).normal(size=(dim, dim)))[0]
    hessian = turn @ np.diag([4.0, -9.0, 1.0][:dim]) @ turn.T
    u = 0.5 * np.einsum("ni,ij,nj->n", mesh.points, hessian, mesh.points)
    h = size_from_hessian(mesh, u, tolerance=0.02)
    assert_allclose(h, np.sqrt(2.0 * 0.02 / 9.0), rtol=1e-6)
    shapes = np.random.default_rng(17).normal(size=(300, dim + 1, dim))
    longest = np.linalg.norm(shapes[:, :, None] - shapes[:, None], axis=3).max(axis=(1, 2))
    shapes *= (1.6 * h[0] / longest)[:, None, None]
    assert interpolation_error(shapes, hessian).max() <= 0.02


def test_sizes_for_a_norm_are_those_of_least_error():
    # N = integral of h^-2 * c, and the error to the power q that of (lambda h^2)^q: of all fields
    # lambda^-e with the same N, the one with e = q / (2 q + 2) has the least error.
    mesh = MESHES["regular"](41)
    x = mesh.points
    u = np.exp(1.5 * x[:, 0]) + 0.5 * x[:, 1] ** 2
    q, wanted = 2.0, 4000
    steepest = np.abs(np.linalg.eigvalsh(recovered_hessian(mesh, u))).max(axis=1)
    h = size_from_hessian(mesh, u, elements=wanted, norm=q)

    def error(size):
        return (mesh.measures * ((steepest * size**2) ** q)[mesh.cells].mean(axis=1)).sum()

    assert predict(mesh, h).cells == pytest.approx(wanted, rel=1e-3)
    for exponent in (0.2, 0.3, 0.37, 0.5):
        other = steepest**-exponent
        other *= np.sqrt(predict(mesh, other).cells / wanted)
        assert error(h) < error(other)
    by_tolerance = size_from_hessian(mesh, u, tolerance=0.01, norm=q)
    assert (0.5**q * error(by_tolerance)) ** (1.0 / q) == pytest.approx(0.01, rel=1e-2)
    large = size_from_hessian(mesh, u, tolerance=0.01, norm=1e6)
    assert_allclose(large, size_from_hessian(mesh, u, tolerance=0.01), rtol=1e-3)


def test_bad_arguments_are_named():
    mesh = MESHES["jittered"](5)
    eta, u = np.ones(mesh.n_cells), mesh.points[:, 0] ** 2
    with pytest.raises(ValueError, match=r"indicator must be finite and >= 0, got indicator\[3\]"):
        size_from_error(mesh, np.where(np.arange(len(eta)) == 3, -1.0, eta), order=1, tolerance=1)
    with pytest.raises(ValueError, match="indicator must have shape"):
        size_from_error(mesh, u, order=1, tolerance=1.0)
    with pytest.raises(ValueError, match=r"one of tolerance and elements .* got both"):
        size_from_error(mesh, eta, order=1, tolerance=1.0, elements=10)
    with pytest.raises(ValueError, match=r"one of tolerance and elements .* got none"):
        size_from_hessian(mesh, u)
    with pytest.raises(ValueError, match="values must be finite"):
        recovered_hessian(mesh, np.full(mesh.n_points, np.nan))
    line = SimplexMesh([[0.0], [1.0]], [[0, 1]])
    for function in (recovered_gradient, recovered_hessian, zz_indicator):
        with pytest.raises(ValueError, match="mesh must consist of triangles in 2-D or tetra"):
            function(line, [0.0, 1.0])


def test_sizes_do_not_depend_on_units():
    of_error, of_length = 1e-50, 3e5
    mesh = MESHES["jittered"](5)
    eta = np.random.default_rng(41).uniform(0.5, 3.0, mesh.n_cells)
    h = size_from_error(mesh, eta, order=1, tolerance=2.0)
    scaled = SimplexMesh(of_length * mesh.points, mesh.cells)
    other = size_from_error(scaled, of_error * eta, order=1, tolerance=2.0 * of_error)
    assert_allclose(other, of_length * h, rtol=1e-3)  # the scale is found to 1e-4
    same = size_from_error(mesh, of_error * eta, order=1, elements=77)
    assert_allclose(same, size_from_error(mesh, eta, order=1, elements=77), rtol=1e-3)


def test_linear_fields_ask_for_nothing():
    mesh = MESHES["jittered"](9)
    u = 1e3 + mesh.points @ [3.0, 4.0]
    for goal in ({"tolerance": 1e-3}, {"elements": 100}):
        assert_array_equal(size_from_hessian(mesh, u, **goal), np.inf)
        assert_array_equal(size_from_hessian(mesh, u, hmax=0.2, **goal), 0.2)
    assert_array_equal(size_from_hessian(mesh, 0.0 * u, tolerance=1.0), np.inf)
