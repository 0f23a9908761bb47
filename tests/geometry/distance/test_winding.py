"""Winding numbers by a tree, and which surfaces are cycles."""

import numpy as np
import pytest
from curved_shapes import part_of, smooth_torus
from width_oracle import winding_number

from adaptsize import SimplexMesh
from adaptsize.geometry.distance.orientation import is_cycle, oriented
from adaptsize.geometry.distance.winding import WindingNumber


def torus(n=24):
    return smooth_torus(n)[0]


@pytest.mark.parametrize("dim", [2, 3])
def test_winding_number_by_a_tree_is_the_sum_over_all_facets(dim):
    rng = np.random.default_rng(27)
    surface = part_of(torus(30), lambda x: np.arange(len(x)) % 7 > 0)[0]
    if dim == 2:
        angle = np.linspace(0.0, 6.0, 800)
        points = (1.0 + 0.2 * np.sin(5.0 * angle))[:, None] * np.column_stack(
            [np.cos(angle), np.sin(angle)]
        )
        surface = SimplexMesh(points, np.stack([np.arange(799), np.arange(1, 800)], axis=1))
    queries = rng.uniform(-1.5, 1.5, (300, dim))
    exact = np.array([winding_number(surface.points[surface.cells], x) for x in queries])
    assert not is_cycle(surface)
    assert np.ptp(exact) > 0.8
    # What `contains` leaves as room for the error of the tree.
    assert np.abs(WindingNumber(surface)(queries) - exact).max() < 0.05


def test_corners_that_differ_by_rounding_are_one_wherever_they_lie():
    # Regression: rounded to a lattice, neighbours on two sides of a border were two.
    clean = torus(12)
    soup = clean.points[clean.cells].reshape(-1, 3)
    soup += np.random.default_rng(337).uniform(-0.1, 0.1, soup.shape) * 1e-9 * clean.diagonal
    loose = SimplexMesh(soup, np.arange(len(soup)).reshape(-1, 3))
    assert is_cycle(loose)
    merged = oriented(loose)
    assert len(np.unique(merged.cells)) == clean.n_points
    assert (merged.facet_cell_counts == 2).all()


def test_cycles_are_distinguished_from_surfaces_with_holes():
    clean = torus(12)
    soup = clean.points[clean.cells].reshape(-1, 3)
    assert is_cycle(clean)
    assert is_cycle(SimplexMesh(soup, np.arange(len(soup)).reshape(-1, 3)))
    assert not is_cycle(SimplexMesh(clean.points, clean.cells[1:]))
    turned = clean.cells.copy()
    turned[5] = turned[5, ::-1]
    assert not is_cycle(SimplexMesh(clean.points, turned))
