"""Predicted numbers of parts with thin walls and narrow faces."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import CORNERS, CUBE_CELLS

from adaptsize import SimplexMesh, SizeFunction
from adaptsize.domain_size.on_surface import SurfaceDomain
from adaptsize.sizes.prediction import integrated

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


def test_a_thick_block_has_no_more_than_the_integrals():
    plain, found = numbers(box((1.0, 1.0, 1.0)), 0.1)
    assert found.cells == pytest.approx(plain.cells, rel=1e-12)
    assert found.facets == plain.facets


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
