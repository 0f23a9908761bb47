"""Results of generators that are refused as meshes of another domain, and those that are not."""

import numpy as np
import pytest
from shapes import block

from adaptsize import SimplexMesh
from adaptsize.errors import BackendError
from adaptsize.remeshing.acceptance import refuse_other_domain
from adaptsize.remeshing.driver import _Part

CUBE = block(2)
SURFACE = CUBE.boundary().mesh


def joined(*meshes):
    starts = np.cumsum([0, *(mesh.n_points for mesh in meshes)])
    cells = [mesh.cells + start for mesh, start in zip(meshes, starts, strict=False)]
    return SimplexMesh(np.concatenate([mesh.points for mesh in meshes]), np.concatenate(cells))


def moved(mesh, offset, scale=1.0):
    return SimplexMesh(mesh.points * scale + offset, mesh.cells)


def accept(new, old, task="surface to tetrahedra"):
    refuse_other_domain(new, _Part.of(task, old, None, 1e-3).problem, "fake")


def test_a_mesh_within_the_tolerance_of_its_surface_is_accepted():
    accept(moved(CUBE, 1e-3), SURFACE)
    accept(CUBE, CUBE, task="tetrahedra")
    accept(SURFACE, SURFACE, task="surface")


def test_a_lost_body_is_refused():
    # Three cubes in a row: the bounding box stays without the one in the middle.
    bodies = [moved(CUBE, [2.0 * i, 0.0, 0.0]) for i in range(3)]
    old = joined(*(body.boundary().mesh for body in bodies))
    accept(joined(*bodies), old)
    with pytest.raises(BackendError, match="its boundary is off by"):
        accept(joined(bodies[0], bodies[2]), old)


def test_a_hole_that_was_filled_is_refused():
    solid = block(3)
    inside = (np.abs(solid.points[solid.cells].mean(axis=1) - 0.5) < 1 / 6).all(axis=1)
    hollow = SimplexMesh(solid.points, solid.cells[~inside])
    with pytest.raises(BackendError, match="its boundary is off by"):
        accept(hollow, solid.boundary().mesh)


def test_a_surface_inside_a_body_may_vanish_in_its_volume():
    inner = moved(SURFACE, 0.25, scale=0.5)
    accept(CUBE, joined(SURFACE, inner))


def test_an_open_surface_may_be_closed_in_any_way_within_its_box():
    lid = (SURFACE.points[SURFACE.cells][..., 2] == 1.0).all(axis=1)
    accept(CUBE, SimplexMesh(SURFACE.points, SURFACE.cells[~lid]))
