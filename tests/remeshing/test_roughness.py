"""Surfaces that are rough within the tolerance are made smooth before they are sized and meshed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from meshes import random_sphere
from numpy.testing import assert_array_equal
from solids import cylinder

from adaptsize import SimplexMesh, check_mesh, remesh_to_elements, size_function
from adaptsize.geometry.creases import normals_of, sharp_facets
from adaptsize.geometry.enclosed import is_oriented
from adaptsize.options import RemeshOptions, checked
from adaptsize.quality.boundary import farthest_places
from adaptsize.remeshing.job import prepared
from adaptsize.remeshing.meshed_surface import surface_to_fill
from adaptsize.remeshing.preparation import repair_mesh
from adaptsize.remeshing.tetwild import TetWildBackend

#: Steps of `screw` are a quarter to two thirds of it.
TOLERANCE = 1e-2


@cache  # and with it what was found of the surface
def screw(*, turn=0.147, pitch=0.01, n=64, layers=20, scale=1.0):
    """A cylinder of layers that are turned against each other, so that its side has steps."""
    angles = 2.0 * np.pi * np.arange(n) / n
    rings = [
        [np.cos(angles + turn * k), np.sin(angles + turn * k), np.full(n, pitch * k)]
        for k in range(layers + 1)
    ]
    points = np.concatenate([np.transpose(ring) for ring in rings])
    points = np.concatenate([points, [[0, 0, 0], [0, 0, pitch * layers]]])
    i = np.arange(n)
    j = (i + 1) % n
    cells = [np.column_stack([np.full(n, n * (layers + 1)), j, i])]
    for k in range(layers):
        a, b, c, d = (x + n * (k + up) for x, up in ((i, 0), (j, 0), (j, 1), (i, 1)))
        cells += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    top = n * layers
    cells.append(np.column_stack([np.full(n, n * (layers + 1) + 1), i + top, j + top]))
    return SimplexMesh(scale * points, np.concatenate(cells))


def n_sharp(surface):
    return int(sharp_facets(surface, normals_of(surface), np.radians(30.0)).sum())


def farthest(one, other):
    within = 0.1 * TOLERANCE * other.diagonal
    both = (one, other), (other, one)
    return max(farthest_places(*pair, within).distance.max() for pair in both) / other.diagonal


def test_a_surface_that_is_rough_within_the_tolerance_becomes_smooth():
    rough = screw(scale=1e-3)
    found = surface_to_fill(rough, TOLERANCE)
    smooth = found.sound.mesh
    assert is_oriented(smooth)
    assert found.left < 1.0
    assert n_sharp(smooth) < 0.2 * n_sharp(rough)
    assert farthest(smooth, rough) < TOLERANCE
    # Each given node has one near it.
    away = np.linalg.norm(smooth.points[found.sound.node_map] - rough.points, axis=1)
    assert away.max() < 0.2 * rough.diagonal


def test_facets_that_must_not_change_are_not_made_smooth():
    rough = screw()
    edge = rough.cells[100, :2]
    job = prepared(rough, 0.1, [edge], checked(RemeshOptions, {"tolerance": TOLERANCE}))
    assert job.requests.left == 1.0
    assert_array_equal(job.requests.mesh.points[job.requests.required[0]], rough.points[edge])


def test_features_larger_than_the_tolerance_and_those_of_parts_stay():
    rough, sphere = screw(), random_sphere(400, 8401)
    for surface, tolerance in ((rough, 1e-3), (rough, np.inf), (sphere, 0.05), (cylinder(96), 0.1)):
        found = surface_to_fill(surface, tolerance)
        assert found.sound.mesh is repair_mesh(surface).mesh
        assert found.left == 1.0


def test_sizes_of_a_rough_surface_are_those_of_the_smooth_one():
    rough = screw()
    size = size_function(rough, max_elements=5000, tolerance=TOLERANCE)
    smooth = surface_to_fill(rough, TOLERANCE).sound.mesh
    assert_array_equal(size.background.points[: smooth.n_points], smooth.points)
    assert not size.report.is_rough


def test_a_mesh_of_a_rough_surface_has_few_cells_and_is_within_the_tolerance():
    pytest.importorskip("mmgpy")
    pytest.importorskip("netgen", reason="fills closed surfaces")
    rough = screw()
    mesh, size = remesh_to_elements(rough, 5000, tolerance=TOLERANCE)
    assert mesh.n_cells == pytest.approx(size.report.n_elements, rel=0.2)
    assert check_mesh(mesh, original=rough, tolerance=TOLERANCE).is_met


def test_tags_of_a_rough_surface_stay_on_their_facets():
    rough = screw()
    ends = np.abs(rough.points[rough.cells][:, :, 2] - rough.points[:, 2].mean()).min(axis=1)
    tags = np.where(ends > 0.35, 2, 1)
    found = surface_to_fill(replace(rough, cell_tags=tags), TOLERANCE).sound.mesh
    areas = [replace(mesh, cell_tags=None).measures[mesh.cell_tags == 2].sum()
             for mesh in (found, replace(rough, cell_tags=tags))]  # fmt: skip
    assert areas[0] == pytest.approx(areas[1], rel=0.02)


def test_tetwild_accepts_worse_cells_where_a_surface_was_rough():
    energies = []

    def run(function, stage, arrays, options):
        energies.append(options["stop_energy"])
        return {"points": arrays["points"], "cells": np.empty((0, 4), np.int32)}

    for tolerance in (TOLERANCE, 0.1 * TOLERANCE):
        job = prepared(screw(), 0.1, None, checked(RemeshOptions, {"tolerance": tolerance}))
        TetWildBackend().solve(job.requests.to("tetwild", 1.0), run)
    assert energies == [30.0, 10.0]
