"""The meshes of a loop keep to the boundary of the first one, not to that of the one before."""

import numpy as np
import pytest
from shapes import block
from solids import cylinder

import adaptsize as ads
from adaptsize.options import RemeshOptions, checked
from adaptsize.quality.boundary import distances_from
from adaptsize.remeshing import job

pytest.importorskip("mmgpy", reason="the meshes are made by Mmg")


def prepared(mesh):
    return job.prepared(mesh, 0.5, None, checked(RemeshOptions, {}))


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
        assert prepared(moved).requests.first is kept


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
