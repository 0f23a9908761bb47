"""Predicted numbers of parts with thin walls and narrow faces."""

import numpy as np
import pytest
import solids
from scipy.spatial.transform import Rotation
from shapes import CORNERS, CUBE_CELLS

from adaptsize import SimplexMesh, SizeFunction
from adaptsize.domain_size.budget import nearest_to_budget
from adaptsize.domain_size.on_surface import SurfaceDomain
from adaptsize.domain_size.reports import report_of
from adaptsize.domain_size.request import Request
from adaptsize.options import SizeFunctionOptions, checked
from adaptsize.sizes.prediction import integrated

#: Cells that Mmg made in square sheets with a side of 17 sizes, by the width over the size.  Their
#: sides had different triangles.
IN_SHEETS = {
    0.17: 2082, 0.25: 2170, 0.33: 2927, 0.42: 3731, 0.5: 3870, 0.55: 3937, 0.6: 3887, 0.67: 3934,
    0.8: 3995, 1.0: 4078, 1.33: 4581, 1.67: 5212, 2.0: 5814, 3.0: 8326,
}  # fmt: skip
#: Sides, size, and the cells and facets that Mmg made of a constant size.
MADE = [
    ((1.0, 1.0, 0.01), 0.06, 1903, 1324),
    ((1.0, 1.0, 0.02), 0.06, 2506, 1332),
    ((1.0, 1.0, 0.04), 0.06, 3746, 1340),
    ((1.0, 1.0, 0.06), 0.06, 3956, 1462),
    ((1.0, 1.0, 0.1), 0.06, 5040, 1516),
    ((3.0, 0.01, 0.01), 0.04, 542, 522),
    ((3.0, 0.02, 0.02), 0.04, 793, 538),
    ((3.0, 0.04, 0.04), 0.04, 1244, 844),
]


def box(sides):
    return SimplexMesh(CORNERS * sides, CUBE_CELLS)


def numbers(surface, size):
    """The integrals of a constant size, and the prediction with what thin parts add."""
    domain = SurfaceDomain.of(surface, 40.0)
    at = SizeFunction(surface, np.full(surface.n_points, size), g=0.0)
    plain = integrated(domain.enclosed, at, "mmg")
    return plain, domain.thin_parts.added_to(plain, at)


@pytest.mark.parametrize(("sides", "size", "cells", "facets"), MADE)
def test_sheets_and_bars_have_as_many_cells_as_were_made(sides, size, cells, facets):
    plain, found = numbers(box(sides), size)
    assert found.cells == pytest.approx(cells, rel=0.12)
    assert found.facets == pytest.approx(facets, rel=0.2)
    assert plain.cells < 0.95 * cells


@pytest.mark.parametrize(("width", "cells"), IN_SHEETS.items())
def test_cells_of_sheets_have_nodes_between_the_sides_from_a_third_of_the_size_on(width, cells):
    found = numbers(box((17.0, 17.0, width)), 1.0)[1]
    assert found.cells == pytest.approx(cells, rel=0.1)


def test_a_thick_block_has_no_more_than_the_integrals():
    plain, found = numbers(box((1.0, 1.0, 1.0)), 0.1)
    assert found.cells == pytest.approx(plain.cells, rel=1e-12)
    assert found.facets == pytest.approx(plain.facets, rel=1e-12)


def test_more_facets_are_counted_where_chords_limit_the_edges_of_mmg():
    # Mmg made 2336 facets of the fewest sizes, whose sum over the surface is 1709.
    cylinder = solids.cylinder(96, radius=0.3, height=1.5)
    request = Request.of(checked(SizeFunctionOptions, {"max_elements": 5000.0}))
    report = report_of(nearest_to_budget(SurfaceDomain.of(cylinder, 40.0), request))
    assert report.n_facets == pytest.approx(2336, rel=0.2)


def test_the_numbers_do_not_depend_on_place_direction_unit_and_order():
    surface = box((1.0, 1.0, 0.02))
    turn = Rotation.random(random_state=np.random.default_rng(7)).as_matrix()
    cells = np.random.default_rng(8).permutation(surface.cells)
    moved = SimplexMesh(30.0 * surface.points @ turn.T + 5.0, cells)
    one, other = numbers(surface, 0.06)[1], numbers(moved, 1.8)[1]
    assert other.cells == pytest.approx(one.cells, rel=0.03)
    assert other.facets == pytest.approx(one.facets, rel=1e-6)


def test_ears_of_a_round_face_are_no_narrow_faces():
    turn = 2.0 * np.pi * np.arange(24) / 24
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    points = np.vstack([np.column_stack([circle, np.full(24, z)]) for z in (0.0, 1.0)])
    ends = [[0, i, i + 1] for i in range(1, 23)]
    sides = [[i, (i + 1) % 24, i + 24] for i in range(24)]
    sides += [[(i + 1) % 24, (i + 1) % 24 + 24, i + 24] for i in range(24)]
    cells = np.array([c[::-1] for c in ends] + [[a + 24 for a in c] for c in ends] + sides)
    plain, found = numbers(SimplexMesh(points, cells), 0.1)
    assert found.facets == pytest.approx(plain.facets, rel=0.02)
