"""Enclosed volumes and areas by hand."""

import numpy as np
import pytest

from adaptsize import CartesianGrid, SimplexMesh, size_function
from adaptsize.geometry.enclosed import enclosed_measure
from adaptsize.reporting.outcome import outcome_of_remeshing


def cuboid(dim):
    """A box with the sides 1, 2 and 3, or 1 and 2, away from the origin, and its boundary."""
    mesh = CartesianGrid([10.0] * dim, [1.0, 2.0, 3.0][:dim], (2,) * dim).mesh
    return mesh, mesh.boundary().mesh


def with_a_flipped_cell(skin):
    cells = np.array(skin.cells)
    cells[0, :2] = cells[0, 1::-1]
    return SimplexMesh(skin.points, cells)


@pytest.mark.parametrize(("dim", "measure"), [(2, 2.0), (3, 6.0)])
def test_a_box_encloses_the_product_of_its_sides(dim, measure):
    skin = cuboid(dim)[1]
    assert enclosed_measure(skin) == pytest.approx(measure, rel=1e-14)
    assert enclosed_measure(SimplexMesh(skin.points, skin.cells[:, ::-1])) == pytest.approx(measure)
    assert np.isnan(enclosed_measure(SimplexMesh(skin.points, skin.cells[1:])))
    assert np.isnan(enclosed_measure(with_a_flipped_cell(skin)))


def test_the_change_of_volume_does_not_depend_on_the_orientation_and_needs_a_closed_surface():
    box, skin = cuboid(3)
    size = size_function(box, hmax=1.0)
    opened = SimplexMesh(skin.points, skin.cells[1:])
    outcomes = (
        outcome_of_remeshing(box, surface, size, 1e-3)
        for surface in (skin, with_a_flipped_cell(skin), opened)
    )
    none = pytest.approx(0.0, abs=1e-14)
    assert [outcome.change for outcome in outcomes] == [none, none, None]
