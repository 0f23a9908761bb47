"""Limited sizes of a number of elements: exact at their scale, after few limits."""

import numpy as np
import pytest
from meshes import structured_square

from adaptsize import adapt, limit_gradient, zz_indicator
from adaptsize.background import PartitionedMesh
from adaptsize.sizes.budget import count_elements
from adaptsize.sizes.limited import Limit, Limited, limited, sizes_for_number

G = 0.2


def square(n):
    return structured_square(n, half_width=0.5)


def small_in_a_corner(mesh):
    """Sizes that rise many times as fast as allowed, off a corner of the square."""
    away = np.linalg.norm(mesh.points - mesh.points.min(axis=0), axis=1)
    return np.where(away < 0.35, 0.02, 2.0)


class Counted:
    """Limits sizes, and keeps the scales and the results."""

    def __init__(self, mesh, g=G, *, paths=True):
        self.mesh, self.g, self.paths = mesh, g, paths
        self.found = []

    def limit(self):
        return Limit(lambda h: np.minimum(h, 0.6), self)

    def __call__(self, bound):
        found = limited(self.mesh, bound, self.g)
        self.found.append(found)
        return found if self.paths else found._replace(roots=None)


def number_at(mesh, scale):
    """The number of limited sizes for a scale."""
    return count_elements(
        mesh, limited(mesh, np.minimum(scale * small_in_a_corner(mesh), 0.6), G).h
    )


@pytest.mark.parametrize("scale", [0.9, 0.96, 1.05])
def test_two_limits_are_enough_and_the_last_one_is_the_result(scale):
    mesh = square(30)
    number = number_at(mesh, scale)
    bound, counted, without = small_in_a_corner(mesh), Counted(mesh), Counted(mesh, paths=False)
    h = sizes_for_number(mesh, number, lambda s: s * bound, counted.limit(), 1.0, 3e-3)
    assert len(counted.found) == 2
    assert count_elements(mesh, h) == pytest.approx(number, rel=3e-3)
    last = counted.found[-1]
    assert h is last.h
    assert np.array_equal(h, limit_gradient(mesh, last.bound, G))
    sizes_for_number(mesh, number, lambda s: s * bound, without.limit(), 1.0, 3e-3)
    assert len(without.found) > 2


@pytest.mark.parametrize("start", [0.1, 1.0, 50.0])
def test_a_far_scale_leads_to_the_number_too(start):
    mesh = square(30)
    bound, counted = small_in_a_corner(mesh), Counted(mesh)
    h = sizes_for_number(mesh, 2000.0, lambda s: s * bound, counted.limit(), start, 3e-3)
    assert count_elements(mesh, h) == pytest.approx(2000.0, rel=3e-3)
    assert np.array_equal(h, limit_gradient(mesh, counted.found[-1].bound, G))
    assert len(counted.found) <= 6


@pytest.mark.parametrize("paths", [True, False])
def test_a_corrected_number_counts_and_is_asked_for_once(paths):
    mesh = square(30)
    number = number_at(mesh, 1.03)
    bound, counted, asked = small_in_a_corner(mesh), Counted(mesh, paths=paths), []

    def corrected(h, there):
        asked.append(there)
        assert there == pytest.approx(count_elements(mesh, h), rel=1e-12)
        return 1.05 * there

    h = sizes_for_number(
        mesh, number, lambda s: s * bound, counted.limit(), 1.0, 3e-3, corrected=corrected
    )
    assert asked == [pytest.approx(number, rel=0.03)]
    assert count_elements(mesh, h) == pytest.approx(1.05 * asked[0], rel=3e-3)
    assert (len(counted.found) <= 2) == paths


def test_no_number_is_corrected_that_the_bounds_do_not_allow():
    mesh = square(30)
    bound, counted = small_in_a_corner(mesh), Counted(mesh)

    def corrected(h, number):
        raise AssertionError

    h = sizes_for_number(
        mesh, 1.0, lambda s: s * bound, counted.limit(), 1.0, 3e-3, corrected=corrected
    )
    assert np.allclose(h, 0.6)


def test_sizes_on_the_same_paths_follow_the_bounds():
    mesh = square(30)
    bound = small_in_a_corner(mesh)
    found = limited(mesh, bound, G)
    steep = found.h < bound
    assert steep.sum() > 0.8 * len(bound)
    for scale in (0.97, 1.03):
        near = found.near(scale * bound)
        h = limit_gradient(mesh, scale * bound, G)
        assert np.abs(near / h - 1.0).max() < 2e-3
        assert np.abs(near / h - 1.0).max() < 0.1 * np.abs(found.h / h - 1.0).max()


def test_paths_are_unknown_for_limits_that_depend_on_the_size_and_in_parts():
    mesh = square(8)
    bound = small_in_a_corner(mesh)
    assert limited(mesh, bound, lambda h: 0.1 + 0.0 * h).roots is None
    assert limited(PartitionedMesh.from_serial(mesh), bound, G).near(bound) is None
    free = Limited.free(bound)
    assert np.array_equal(free.near(2.0 * bound), 2.0 * bound)


def test_nodes_without_a_bound_stay_without():
    mesh = square(4)
    bound = np.full(mesh.n_points, np.inf)
    found = Limited(bound, bound.copy(), np.full(mesh.n_points, -1, np.int32))
    assert np.isinf(found.near(bound)).all()


def test_a_cycle_limits_twice(monkeypatch):
    def with_error(mesh, x):
        u = np.exp(-40.0 * ((mesh.points - x) ** 2).sum(axis=1))
        return mesh, zz_indicator(mesh, u)

    options = {"elements": 3000, "order": 2, "backend": "bisection"}
    mesh = adapt(*with_error(square(16), 0.3), **options).mesh
    calls = []

    def spied(*given):
        calls.append(given)
        return limited(*given)

    monkeypatch.setattr("adaptsize.adaptation.next_sizes.limited", spied)
    result = adapt(*with_error(mesh, 0.25), **options)
    assert 1 <= len(calls) <= 2
    assert np.array_equal(result.size.values, limit_gradient(*calls[-1][:3]))
