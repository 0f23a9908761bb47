"""The surface that is meshed: its holes are closed by caps."""

import numpy as np
import pytest
from meshes import random_sphere
from shapes import CORNERS, CUBE_CELLS, joined

from adaptsize import SimplexMesh, check_mesh, remesh_to_elements, size_function
from adaptsize.errors import OpenSurfaceWarning
from adaptsize.geometry.enclosed import is_oriented
from adaptsize.quality.boundary import farthest_places
from adaptsize.remeshing.meshed_surface import surface_to_fill

SPHERE = random_sphere(400, 8401)


def without(surface, facets):
    """The surface without some facets; the others get tags."""
    cells = np.delete(surface.cells, facets, axis=0)
    return SimplexMesh(surface.points, cells, cell_tags=np.full(len(cells), 5))


def farthest(one, other):
    within = 1e-4 * other.diagonal
    both = (one, other), (other, one)
    return max(farthest_places(*pair, within).distance.max() for pair in both) / other.diagonal


def test_holes_are_closed_by_caps_in_their_planes():
    found = surface_to_fill(without(SPHERE, [3, 40, 41, 200]))
    assert found.n_caps == 4
    assert is_oriented(found.sound.mesh)
    assert found.solid.volume == pytest.approx(surface_to_fill(SPHERE).solid.volume, rel=1e-3)
    assert sorted(np.unique(found.sound.mesh.cell_tags)) == [0, 5]


@pytest.mark.parametrize("kept", ["lid missing", "half a sphere", "sheet"])
def test_large_openings_are_left_to_the_user(kept):
    surface = {
        "lid missing": SimplexMesh(CORNERS, CUBE_CELLS[2:]),
        "half a sphere": without(SPHERE, SPHERE.points[SPHERE.cells].mean(axis=1)[:, 2] > 0.0),
        "sheet": SimplexMesh(
            [[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
        ),
    }[kept]
    found = surface_to_fill(surface)
    assert found.n_caps == 0
    assert len(found.sound.mesh.cells) == len(surface.cells)


def test_a_hole_whose_cap_would_cross_its_own_body_is_left_to_the_user():
    # A spike from the other side of the sphere leaves through the hole, beside the centre.
    place = np.array([0.8, 0.1, 0.1]) @ SPHERE.points[SPHERE.cells[3]]
    points = np.array(SPHERE.points)
    points[np.argmin(points @ place)] = 1.02 * place
    opened = SimplexMesh(points, np.delete(SPHERE.cells, 3, axis=0))
    assert surface_to_fill(opened).n_caps == 0


def test_a_hole_inside_of_another_body_is_closed_so_that_there_is_a_union():
    hole = SPHERE.points[SPHERE.cells[3]].mean(axis=0)
    box = SimplexMesh(hole + 0.4 * (CORNERS - 0.5), CUBE_CELLS)
    found = surface_to_fill(joined(without(SPHERE, [3]), box))
    assert found.n_caps == 1
    assert found.sound.mesh.is_closed
    assert not found.is_crossed


def test_a_surface_with_holes_gets_sizes_and_a_mesh_as_if_it_were_closed():
    pytest.importorskip("mmgpy")
    pytest.importorskip("netgen", reason="fills closed surfaces")
    opened = without(SPHERE, [3, 40])
    with pytest.warns(OpenSurfaceWarning, match="flat caps close it"):
        size = size_function(opened, max_elements=3000, tolerance=3e-3)
    closed = size_function(SPHERE, max_elements=3000, tolerance=3e-3)
    assert size.report.n_elements == pytest.approx(closed.report.n_elements, rel=1e-2)
    with pytest.warns(OpenSurfaceWarning, match="flat caps close it"):
        mesh, _ = remesh_to_elements(opened, 3000, tolerance=3e-3)
    assert check_mesh(mesh, original=opened, tolerance=3e-3).is_met
    assert farthest(mesh.boundary().mesh, SPHERE) < 3.3e-3
