"""Results of generators that are refused as meshes of another domain, and those that are not."""

import numpy as np
import pytest
from shapes import block, joined, moved

from adaptsize import SimplexMesh
from adaptsize.errors import BackendError, BoundaryWarning, ResolutionWarning
from adaptsize.remeshing.acceptance import refuse_other_domain, warn_of_deviation
from adaptsize.remeshing.preparation import as_problem

CUBE = block(2)
SURFACE = CUBE.boundary().mesh


def accept(new, old, task="surface to tetrahedra"):
    refuse_other_domain(new, as_problem(task, old, 1e-3), "fake")


def test_a_mesh_within_the_tolerance_of_its_surface_is_accepted():
    accept(moved(CUBE, 1e-3), SURFACE)
    accept(CUBE, CUBE, task="tetrahedra")
    accept(SURFACE, SURFACE, task="surface")


def test_a_lost_body_or_a_hole_that_was_filled_is_refused():
    # Three cubes in a row: the bounding box stays without the one in the middle.
    bodies = [moved(CUBE, [2.0 * i, 0.0, 0.0]) for i in range(3)]
    old = joined(*(body.boundary().mesh for body in bodies))
    accept(joined(*bodies), old)
    solid = block(3)
    inside = (np.abs(solid.points[solid.cells].mean(axis=1) - 0.5) < 1 / 6).all(axis=1)
    hollow = SimplexMesh(solid.points, solid.cells[~inside])
    for new, given in ((joined(bodies[0], bodies[2]), old), (hollow, solid.boundary().mesh)):
        with pytest.raises(BackendError, match="its boundary is off by"):
            accept(new, given)


def test_a_lost_flap_is_warned_of():
    # A flap of .1 on a side of the cube: too small to refuse the mesh, far beyond the tolerance.
    flap = moved(CUBE, [1.0, 0.4, 0.4], scale=0.1)
    old = joined(CUBE, flap)
    with pytest.warns(ResolutionWarning, match="misses part of the domain.* 0.1 from the given"):
        warn_of_deviation(CUBE, old, 1e-3)
    with pytest.warns(ResolutionWarning, match=r"^the boundary of the mesh is 0.1 from the given"):
        warn_of_deviation(old, CUBE, 1e-3)


def test_no_warning_within_four_tolerances_or_for_an_open_surface():
    warn_of_deviation(moved(CUBE, [0.0039, 0.0, 0.0]), CUBE, 1e-3)
    lid = (SURFACE.points[SURFACE.cells][..., 2] == 1.0).all(axis=1)
    warn_of_deviation(CUBE, SimplexMesh(SURFACE.points * 1.5, SURFACE.cells[~lid]), 1e-3)


def test_a_body_inside_another_one_that_vanishes_is_warned_of():
    inner = moved(SURFACE, 0.25, scale=0.5)
    old = joined(SURFACE, inner)
    with pytest.warns(ResolutionWarning, match=r"fills both sides .* 0.25 from the given one"):
        warn_of_deviation(CUBE, old, 1e-3)
    warn_of_deviation(CUBE, old, 1e-3, may_be_joined=True)


def test_a_thin_shell_that_was_filled_is_warned_of_at_any_distance():
    # The wall is .01 thick, twice the tolerance: all distances are within four times that.
    cavity = moved(SURFACE, 0.01, scale=0.98)
    old = joined(SURFACE, SimplexMesh(cavity.points, cavity.cells[:, ::-1]))
    with pytest.warns(BoundaryWarning, match=r"topology .* 1 .* number 2, given: 2 .* number 4"):
        warn_of_deviation(CUBE, old, 5e-3)
    warn_of_deviation(CUBE, old, 5e-3, may_be_joined=True)
    warn_of_deviation(joined(CUBE, moved(CUBE, 2.0)), joined(SURFACE, moved(SURFACE, 2.0)), 5e-3)
