"""Winding numbers by a tree, and which surfaces are cycles."""

import numpy as np
import pytest
from curved_shapes import part_of, smooth_torus
from width_oracle import winding_number

from adaptsize import SimplexMesh
from adaptsize.geometry.distance import orientation
from adaptsize.geometry.distance.orientation import is_cycle, oriented, winding_of
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


def two_tori(second, n=12):
    """A torus with another one beside it, oriented as given or inward."""
    one = torus(n)
    away, factor, is_inward = second
    points = one.points * factor + away
    cells = one.cells[:, ::-1] if is_inward else one.cells
    return SimplexMesh(np.concatenate([one.points, points]), [*one.cells, *(cells + one.n_points)])


CLEAN = {
    "a torus": torus(12),
    "two tori": two_tori(([5.0, 0.0, 0.0], 1.0, False)),
    "a square": SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]]),
    "a soup": SimplexMesh(
        torus(12).points[torus(12).cells].reshape(-1, 3),
        np.arange(3 * torus(12).n_cells).reshape(-1, 3),
    ),
}


@pytest.mark.parametrize("name", CLEAN)
def test_clean_surfaces_are_kept_as_they_are_with_the_same_winding_numbers(name, monkeypatch):
    surface = CLEAN[name]
    x = np.random.default_rng(481).uniform(-1.5, 1.5, (300, surface.dim))
    queries = np.concatenate([x, surface.points[surface.cells].mean(axis=1)])
    winding, rule = winding_of(oriented(surface))
    wanted = winding(queries)
    assert np.ptp(wanted) > 0.9

    def refused(_):
        raise AssertionError("nothing is to be oriented")

    monkeypatch.setattr(orientation, "oriented", refused)
    found, found_rule = winding_of(surface)
    assert found_rule == rule
    assert rule.is_signed
    np.testing.assert_array_equal(found(queries), wanted)


def turned(surface, cells):
    new = surface.cells.copy()
    new[cells] = new[cells][:, ::-1]
    return SimplexMesh(surface.points, new)


@pytest.mark.parametrize(
    "surface",
    [
        turned(torus(12), slice(None)),
        turned(torus(12), [5]),
        turned(CLEAN["a square"], slice(None)),
        two_tori(([5.0, 0.0, 0.0], 0.5, True)),
    ],
    ids=["inward", "one facet", "clockwise", "one of two"],
)
def test_other_surfaces_are_oriented_first(surface):
    x = np.random.default_rng(482).uniform(-1.5, 1.5, (300, surface.dim))
    x = np.concatenate([x, x + np.array([5.0, 0.0, 0.0])[: surface.dim]])
    expected = oriented(surface)
    assert not np.array_equal(expected.cells, surface.cells)
    winding, rule = winding_of(surface)
    np.testing.assert_array_equal(winding(x), WindingNumber(expected)(x))
    assert rule == orientation.rule_of(expected)
