"""The meshes of a loop keep to the boundary of the first one, not to that of the one before."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from shapes import block
from solids import cylinder

import adaptsize as ads
from adaptsize.options import RemeshOptions, checked
from adaptsize.quality.boundary import distances_from
from adaptsize.remeshing import job

pytest.importorskip("mmgpy", reason="the meshes are made by Mmg")


def prepared(mesh, **options):
    return job.prepared(mesh, 0.5, None, checked(RemeshOptions, options))


def ball(n):
    """Of n nodes on a sphere, and one in the middle."""
    k = np.arange(n) + 0.5
    z, turn = 1.0 - 2.0 * k / n, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - z * z)
    points = np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
    points = np.vstack([points, np.zeros(3)])
    return ads.SimplexMesh(points, Delaunay(points).simplices)


def test_a_mesh_of_a_loop_keeps_to_the_first_one_of_the_same_kind():
    mesh, first = block(3), block(2)
    alone, in_loop, of_surface = (
        prepared(mesh.with_original(original)) for original in (None, first, first.boundary().mesh)
    )
    for request, kept in ((alone, mesh), (in_loop, first), (of_surface, mesh)):
        problem = request.requests.to("mmg", 1.0)
        found = request.requests.kept_by(problem)
        own = request.requests.frame.from_own(found.points)
        assert len(own) >= kept.n_points
        np.testing.assert_allclose(own.min(axis=0), kept.points.min(axis=0), atol=1e-12)
        assert (len(own) == first.n_points) == (kept is first)


def farthest(mesh, first):
    one, other = (m.boundary().mesh for m in (mesh, first))
    return max(distances_from(*pair).largest for pair in ((one, other), (other, one)))


def test_a_mesh_whose_boundary_was_moved_does_not_keep_to_the_first_one():
    first = block(2)
    for factor, kept in ((1.05, first), (1.15, None)):
        shift = factor * 1e-3 * first.diagonal * np.eye(3)[0]
        moved = first.moved(first.points + shift).with_original(first)
        found = prepared(moved).requests.first
        assert (found is None) == (kept is None)
        if kept is not None:
            np.testing.assert_array_equal(found.points, first.points)
            assert prepared(moved, strict=True).requests.first is None  # is compared with ``moved``


def test_facets_are_compared_in_both_directions():
    fine = ball(300)
    points = np.vstack([fine.points[:300:10], np.zeros(3)])  # all on the fine one
    coarse = ads.SimplexMesh(points, Delaunay(points).simplices)
    for mesh, first in ((coarse, fine), (fine, coarse)):
        for tolerance, is_kept in ((1e-3, False), (0.1, True)):
            found = prepared(mesh.with_original(first), tolerance=tolerance).requests.first
            assert (found is not None) == is_kept


def test_a_domain_of_which_this_is_a_part_is_not_kept():
    whole = block(2)
    tags = (whole.points[whole.cells].mean(axis=1)[:, 0] > 0.5).astype(int)
    half = ads.SimplexMesh(whole.points, whole.cells[tags == 0])
    both = ads.SimplexMesh(whole.points, whole.cells, cell_tags=tags)
    assert prepared(half.with_original(both)).requests.first is None
    assert prepared(both.with_original(both)).requests.first is not None


def test_the_first_surface_is_repaired_once():
    skin = ball(40).boundary().mesh
    corners = skin.points[skin.cells].reshape(-1, 3)
    soup = ads.SimplexMesh(corners, np.arange(len(corners)).reshape(-1, 3))  # as in STL files
    assert not soup.is_closed
    one, two = (prepared(skin.with_original(soup), target="triangles").requests for _ in range(2))
    kept = one.kept_by(one.to("mmg", 1.0))
    assert kept.is_closed
    assert kept.n_points == skin.n_points
    assert two.first is one.first


def test_the_boundary_does_not_drift_away_in_a_loop():
    """If each mesh keeps to the one before, the fourth is 1.16 tolerances away."""
    pytest.importorskip("netgen", reason="the first mesh is made by Netgen")
    at = np.random.default_rng(3).uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 1.0], (6, 3))
    sizes = [
        lambda x, p=p: np.minimum(0.05 + 0.35 * np.linalg.norm(x - p, axis=1), 0.25) for p in at
    ]
    mesh = first = ads.remesh(cylinder(24, 0.3), sizes[0], tolerance=4e-3)
    for size in sizes[1:]:
        mesh = ads.adapt(mesh, h0=size, boundary_tolerance=4e-3).mesh
        assert farthest(mesh, first) <= 1.02 * 4e-3 * first.diagonal
