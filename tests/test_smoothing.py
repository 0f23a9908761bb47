"""Meshes from distance and size functions: what they keep, how good they are, what is refused."""

import numpy as np
import pytest

import adaptsize as ads


def disc(x):
    return np.linalg.norm(x, axis=1) - 1.0


def test_the_mesh_of_a_disc_has_good_triangles_and_nodes_on_the_circle():
    mesh, report = ads.mesh_from_distance(disc, 0.1, [-1.1, -1.1], [1.1, 1.1], full_output=True)
    assert (mesh.signed_measures > 0.0).all()
    assert np.abs(disc(mesh.boundary().mesh.points)).max() < 1e-7
    assert report.conformity.share_in_band > 0.95
    assert report.conformity.angle_min > 25.0
