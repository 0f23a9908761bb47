"""Limited sizes of the reference, against closed forms and brute force."""

import domains
import numpy as np
import pytest
from geodesics import (
    contains,
    curve_sizes,
    distances,
    limited_sizes,
    radial_sizes,
)
from numpy.testing import assert_allclose

from adaptsize import SimplexMesh, limit_gradient

G = 0.3


def some_points(rings, n, seed):
    points = np.random.default_rng(seed).uniform(-50.0, 50.0, (3 * n, 2))
    return points[contains(rings, points)][:n]


def test_sizes_of_several_sources_are_the_least():
    _, rings = domains.maze(500)
    x, sources = some_points(rings, 300, 58), some_points(rings, 5, 59)
    sizes = np.array([1.0, 3.0, 2.0, 8.0, -1.0])
    cones = [u + G * distances(rings, s, x) for s, u in zip(sources, sizes, strict=True)]
    expected = np.min(cones, axis=0)
    assert_allclose(limited_sizes(rings, x, G, sources=sources, sizes=sizes), expected, rtol=1e-13)


@pytest.mark.parametrize("rise", [0.0, 2.0, -2.0, 20.0])
def test_a_segment_is_the_limit_of_its_points(rise):
    # 20 over a length of 40 is steeper than G: then the lower end alone counts.
    _, rings = domains.star_holes(500)
    x = some_points(rings, 200, 60)
    segment, sizes = np.array([[-45.0, -40.0], [-45.0, 0.0]]), np.array([5.0, 5.0 + rise])
    share = np.linspace(0.0, 1.0, 401)[:, None]
    dense = limited_sizes(
        rings,
        x,
        G,
        sources=segment[0] + share * (segment[1] - segment[0]),
        sizes=sizes[0] + share[:, 0] * rise,
    )
    exact = limited_sizes(rings, x, G, segments=segment[None], segment_sizes=sizes[None])
    assert (exact <= dense + 1e-13).all()
    # Points 0.1 apart: at distance D off by up to G 0.05^2/(2D) and, at no distance, G 0.05.
    # D is that of x, or of the corner at which the path to it bends first: those are 8 off.
    off = np.minimum(np.abs(x[:, 0] + 45.0), 8.0 - 1e-9)
    assert (dense - exact <= G * 0.05 / np.maximum(1.0, 2.0 * off / 0.05) + 1e-13).all()


def test_a_leaking_slit_would_be_seen():
    mesh, rings, h0, faces, sizes = domains.leaking_slit(3000)
    exact = limited_sizes(rings, mesh.points, G, segments=faces, segment_sizes=sizes)
    x, y = mesh.points.T
    left, right = (np.isfinite(h0) & (h0 == size) for size in (1.0, 8.0))
    assert left.sum() == right.sum() > 30
    assert (exact[left] == 1.0).all()
    # Along the right face from the left tip: 1 + G (0.5 + s) until that exceeds 8.
    assert_allclose(exact[right], np.minimum(8.0, 1.0 + G * (0.5 + y[right] + 20.0)), rtol=1e-14)
    beside = (x < -0.25) & (y > -20.0)
    assert_allclose(exact[beside], 1.0 + G * (-0.25 - x[beside]), rtol=1e-14)
    # A rule that ignores the slit gives 1 + G (x + 0.25) to the right of it, 6.85 too little.
    assert (exact - (1.0 + G * (x + 0.25)))[(x > 0.0) & (y > 20.0)].max() > 6.8


def test_linear_boundary_data_are_exact_and_converge_to_smooth_ones():
    errors = []
    for n in (500, 2000):
        mesh, rings = domains.disc(n, radius=30.0)
        ring, k = rings[0], len(rings[0])
        u = domains.disc_data(2.0 * np.pi * np.arange(k) / k)
        segments = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
        ends = np.column_stack([u, np.roll(u, -1)])
        exact = limited_sizes(rings, mesh.points, G, segments=segments, segment_sizes=ends)
        share = np.linspace(0.0, 1.0, 101)
        places = (segments[:, :1] + share[:, None] * (segments[:, 1:] - segments[:, :1])).reshape(
            -1, 2
        )
        values = (ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])).ravel()
        some = mesh.points[::7]
        away = np.linalg.norm(some[:, None] - places, axis=2)
        brute = (values + G * away).min(axis=1)
        gap = 2.0 * np.pi * 30.0 / k / 100.0
        assert (brute - exact[::7] >= -1e-13).all()
        assert (brute - exact[::7] <= G * gap).all()
        smooth = curve_sizes(circle(30.0), domains.disc_data, (0.0, 2.0 * np.pi), mesh.points, G)
        errors.append(np.abs(exact - smooth).max())
    # Chords of smooth data on a smooth curve: second order (the spacing halves).
    assert errors[0] < 0.05
    assert errors[1] < 0.35 * errors[0], errors


def circle(radius):
    return lambda s: radius * np.column_stack([np.cos(s), np.sin(s)])


def test_a_curve_of_constant_size_gives_the_distance_to_it():
    x = np.random.default_rng(61).uniform(-20.0, 20.0, (300, 2))
    sizes = curve_sizes(circle(30.0), lambda s: np.full(len(s), 2.0), (0.0, 2.0 * np.pi), x, G)
    assert_allclose(sizes, 2.0 + G * (30.0 - np.hypot(*x.T)), rtol=1e-13)


def test_a_function_of_one_variable_is_cut_where_its_slope_is_g():
    # s^2 is steeper than g from s = g/2 on: there the tangent g s - g^2/4 takes over.
    x = np.linspace(-1.0, 1.0, 401)[:, None]
    h = curve_sizes(lambda s: s[:, None], lambda s: s**2, (-1.0, 1.0), x, G)
    size = np.abs(x[:, 0])
    assert_allclose(h, np.where(size < G / 2, size**2, G * size - G**2 / 4), atol=1e-13)


def test_of_many_valleys_the_deepest_is_found():
    # 1 + cos(8 s), valleys at odd multiples of pi/8; at (0, 0) all are equal, beside it one wins.
    x = np.random.default_rng(62).uniform(-10.0, 10.0, (20, 2))
    h = curve_sizes(circle(30.0), lambda s: 1.0 + np.cos(8.0 * s), (0.0, 2.0 * np.pi), x, 0.01)
    s = np.linspace(0.0, 2.0 * np.pi, 100_001)
    places, values = circle(30.0)(s), 1.0 + np.cos(8.0 * s)
    brute = [(values + 0.01 * np.linalg.norm(p - places, axis=1)).min() for p in x]
    assert_allclose(h, brute, atol=4e-8)  # (2 pi/2e5)^2 times a curvature of 64, halved: 3.2e-8


def test_rings_are_limited_by_the_points_of_their_disc():
    mesh, _ = domains.disc(3000)
    x, r = mesh.points, np.linalg.norm(mesh.points, axis=1)
    exact = radial_sizes(domains.disc_field, 50.0, x, G)
    assert 0.5 < (exact < domains.disc_field(r) - 1e-12).mean() < 0.95
    rng = np.random.default_rng(65)
    y = 50.0 * np.sqrt(rng.random(200_000))[:, None] * circle(1.0)(rng.uniform(0, 7, 200_000))
    field = domains.disc_field(np.linalg.norm(y, axis=1))
    for place, size in zip(x[::150], exact[::150], strict=True):
        brute = (field + G * np.linalg.norm(place - y, axis=1)).min()
        # The nearest of 25 random points per unit of area is hardly farther than 0.5.
        assert size <= brute < size + 0.59 * 0.5
    h = limit_gradient(mesh, domains.disc_field(r), G, method="fast-marching")
    assert np.abs(h - exact).max() < 0.25


@pytest.mark.parametrize("name", domains.CASES)
def test_marching_converges_to_the_reference(name):
    # Two independent ways to the same sizes.  Exact ones near the sources, whose tips would
    # cost a logarithm; the corners that paths bend at still do.  Spacing 2.07 (1.8) times finer.
    case, means = domains.CASES[name], []
    for n in (700, 5000) if name in ("wall", "window") else (700, 3000):
        mesh, domain = case.make(n)
        _, nodes = domains.point_sources(mesh, case.places, case.sizes)
        exact = case.exact(domain, mesh.points, G, mesh.points[nodes], case.sizes)
        away = np.linalg.norm(mesh.points[:, None] - mesh.points[nodes], axis=2).min(axis=1)
        h0 = np.where(away < (10.0 if mesh.dim == 2 else 20.0), exact, np.inf)
        error = limit_gradient(mesh, h0, G, method="fast-marching") - exact
        assert error.min() > -0.1  # linear interpolation where two fronts meet
        means.append(error.mean())
    assert means[0] < 1.0
    assert means[1] < (0.6 if mesh.dim == 2 else 0.65) * means[0], means


def test_point_sources_are_the_nearest_nodes():
    mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    h0, nodes = domains.point_sources(mesh, [(0.9, 0.2), (0.1, 0.7)], (2.0, 3.0))
    assert nodes.tolist() == [1, 2]
    assert h0.tolist() == [np.inf, 2.0, 3.0]
