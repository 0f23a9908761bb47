"""The judge of remeshed surfaces, on cases whose distances and volumes are known."""

import numpy as np
import pytest
from _measures import distances, distances_slow, winding_numbers, winding_numbers_slow
from _shapes import ball, box, moved, together, turned
from judge import Mesh, Surface, boundary_of, dihedral_angles, is_true, judge, missed, repaired
from solids_of_cubes import solid_of_cubes

TOLERANCE = 1e-2


def measured(part, mesh, tolerance=TOLERANCE):
    return judge(Surface(*part), mesh, tolerance, count=400, grid=10)


def cubes(keep=lambda middle: np.full(len(middle), True), shape=(2, 2, 2)):
    """Return tetrahedra of unit cubes, positively oriented."""
    made = solid_of_cubes(keep, shape, 1)
    a, b, c, d = made.points[made.cells].transpose(1, 0, 2)
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
    return Mesh(made.points, np.where(turned[:, None], made.cells[:, [1, 0, 2, 3]], made.cells))


def fan_of(surface, factor=1.0):
    """Return tetrahedra from the origin to each facet of a star-shaped surface."""
    points = np.vstack([factor * surface.points, np.zeros(3)])
    apex = np.full((len(surface.cells), 1), len(surface.points))
    return Mesh(points, np.hstack([apex, surface.cells]))


def prism(n, radius=1.0, height=1.0):
    """Return the surface of a prism on a regular polygon, with nodes in the middle of the ends."""
    turn = 2.0 * np.pi * np.arange(n) / n
    circle = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    low, high = (np.column_stack([circle, np.full(n, z)]) for z in (-0.5 * height, 0.5 * height))
    points = np.vstack([low, high, [[0.0, 0.0, -0.5 * height], [0.0, 0.0, 0.5 * height]]])
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    bottom, top = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    sides = [(i, j, j + n), (i, j + n, i + n), (j, i, bottom), (i + n, j + n, top)]
    return Surface(points, np.concatenate([np.column_stack(s) for s in sides]))


def as_shape(surface):
    return type(box())(*surface)


def test_distances_and_winding_numbers_of_a_cube():
    cube = box(n=1)
    places = np.array(
        [[0.0, 0, 0], [0.75, 0, 0], [0.75, 0.75, 0], [1.0, 1.0, 1.0], [0.1, 0.2, 0.4]]
    )
    far = [0.5, 0.25, np.sqrt(2.0) / 4.0, np.sqrt(3.0) / 2.0, 0.1]
    for of in (distances, distances_slow):
        np.testing.assert_allclose(of(*cube, places), far, rtol=1e-12)
    for of in (winding_numbers, winding_numbers_slow):
        np.testing.assert_allclose(of(*cube, places), [1, 0, 0, 0, 1], atol=1e-12)


def test_libigl_agrees_with_the_slow_versions():
    pytest.importorskip("igl")
    surface = ball(60)
    places = np.random.default_rng(3).normal(size=(200, 3))
    np.testing.assert_allclose(
        distances(*surface, places), distances_slow(*surface, places), rtol=1e-9
    )
    slow = winding_numbers_slow(*surface, places)
    np.testing.assert_allclose(winding_numbers(*surface, places), slow, atol=1e-9)
    quick = winding_numbers(*surface, places, exact=False)
    np.testing.assert_allclose(quick, slow, atol=0.02)


def test_the_same_solid_is_met():
    part = moved(box(n=2), 1.0, 2.0)  # from 0 to 2
    found = measured(part, cubes())
    assert found["H"] < 1e-9
    assert abs(found["volume_change"]) < 1e-12
    assert (found["volume"], found["components"]) == (pytest.approx(8.0), 1)
    assert missed(found) == []
    assert found["encloses"]


def test_a_shifted_cube_is_so_far_away():
    mesh = cubes()
    shift = 0.013 * np.sqrt(12.0)  # the diagonal
    part = moved(box(n=2), [1.0 + shift, 1.0, 1.0], 2.0)
    found = measured(part, mesh)
    # The side that moved is as far from the mesh as the opposite one of the mesh from the part.
    assert found["from_part"] == pytest.approx(1.3, rel=1e-9)
    assert found["from_mesh"] == pytest.approx(1.3, rel=1e-9)
    assert missed(found) == ["distance"]


@pytest.mark.parametrize("relaxed", [1.04, 1.06])
def test_a_tolerance_that_is_relaxed_by_5_percent_is_caught_on_a_cylinder(relaxed):
    part, coarse = prism(96), prism(12)
    diagonal = np.linalg.norm(np.ptp(part.points, axis=0))
    sagitta = 1.0 - np.cos(np.pi / 12)  # nodes of the part stand above the middles of the sides
    found = measured(part, fan_of(as_shape(coarse)), sagitta / diagonal / relaxed)
    assert found["H"] == pytest.approx(relaxed, rel=1e-9)
    assert ("distance" in missed(found)) == (relaxed > 1.05)


@pytest.mark.parametrize("relaxed", [1.04, 1.06])
def test_a_tolerance_that_is_relaxed_by_5_percent_is_caught_on_a_sphere(relaxed):
    part = ball(150, radius=1.0)
    diagonal = np.linalg.norm(np.ptp(part.points, axis=0))
    found = measured(part, fan_of(part, 1.0 + relaxed * TOLERANCE * diagonal))
    assert found["H"] == pytest.approx(relaxed, rel=1e-9)
    assert ("distance" in missed(found)) == (relaxed > 1.05)


def test_measures_do_not_depend_on_place_direction_unit_and_numbers():
    rng = np.random.default_rng(7)
    part, mesh = ball(80, radius=1.0), fan_of(ball(50, radius=1.0))
    found = measured(part, mesh)
    rotation = np.roll(np.eye(3), 1, axis=0)  # keeps the diagonal
    order, new = rng.permutation(len(mesh.cells)), rng.permutation(len(mesh.points))
    where = np.argsort(new)
    part, moved_points = (
        1e3 * (p @ rotation) + [3.0, -5.0, 700.0] for p in (part.points, mesh.points)
    )
    other = measured((part, ball(80).cells), Mesh(moved_points[new], where[mesh.cells][order]))
    # The distance from the part is that of a node; samples of the mesh are random.
    for name in ("from_part", "least", "cells", "components", "edges_not_manifold", "inverted"):
        assert other[name] == pytest.approx(found[name], rel=1e-6), name
    assert other["volume_change"] == pytest.approx(found["volume_change"], rel=1e-6)
    assert other["from_mesh"] == pytest.approx(found["from_mesh"], rel=0.1)


def test_a_union_is_judged_by_its_skin():
    part = together(moved(box(n=2), [1.0, 1.0, 1.0], 2.0), moved(box(n=2), [2.0, 1.0, 1.0], 2.0))
    union = cubes(shape=(3, 2, 2))
    found = measured(part, union)
    assert found["H"] < 1e-6
    assert found["hidden"] > 0.1
    assert found["volume_of_part"] == pytest.approx(12.0, rel=0.02)
    assert missed(found) == []
    # A mesh that leaves the overlap empty has the facets of the part as its boundary, and is wrong.
    holed = cubes(lambda middle: (middle[:, 0] < 1.0) | (middle[:, 0] > 2.0), (3, 2, 2))
    found = measured(part, holed)
    assert found["from_mesh"] > 10.0
    assert "distance" in missed(found)
    assert "volume" in missed(found)


def test_facets_that_are_hidden_in_part_count_outside_only():
    small = moved(box(n=1), [3.0, 1.5, 1.5])  # goes through the side x = 3
    part = together(moved(box(n=1), 1.5, 3.0), small)
    full = cubes(lambda m: (m[:, 0] < 3.0) | (np.abs(m[:, 1:] - 1.5).max(axis=1) < 0.1), (4, 3, 3))
    points = full.points.copy()
    points[points[:, 0] > 3.5, 0] = 3.5
    coarse = 5e-2
    found = measured(part, Mesh(points, full.cells), coarse)
    assert found["H"] < 1e-6
    assert missed(found) == []
    # Without the small box, its end is half a unit from the mesh.
    found = measured(part, cubes(shape=(3, 3, 3)), coarse)
    assert found["from_part"] == pytest.approx(0.5 / np.sqrt(3.5**2 + 18.0) / coarse)


def test_a_missing_corner_is_found():
    mesh = cubes(lambda middle: ~(middle < 1.0).all(axis=1))
    part = moved(box(n=2), 1.0, 2.0)
    found = measured(part, mesh)
    diagonal = np.sqrt(12.0)
    assert found["from_part"] == pytest.approx(1.0 / diagonal / TOLERANCE)
    assert found["volume_change"] == pytest.approx(-1.0 / 8.0)
    assert missed(found) == ["distance", "volume"]


def test_a_missing_facet_leaves_the_boundary_free_in_front_of_it():
    part = moved(box(n=2), 1.0, 2.0)
    hole = part._replace(cells=part.cells[1:])
    found = measured(hole, cubes())
    assert found["open_edges_of_part"] == 3
    assert found["encloses"]
    assert found["H"] <= 1.0
    dented = cubes()
    dented = dented._replace(points=dented.points.copy())
    gone = part.points[part.cells[0]].mean(axis=0)
    node = np.linalg.norm(dented.points - np.round(gone), axis=1).argmin()
    dented.points[node] += 0.1 * (1.0 - dented.points[node])
    assert measured(part, dented)["H"] > measured(hole, dented)["from_mesh"]


def test_a_box_without_a_lid_encloses_no_solid():
    part = box(n=3)
    lidless = part._replace(cells=part.cells[(part.points[part.cells][:, :, 2] < 0.49).any(axis=1)])
    found = judge(Surface(*lidless), None, TOLERANCE, grid=10)
    assert not found["encloses"]
    assert judge(Surface(*part), None, TOLERANCE, grid=10)["encloses"]


def test_facets_are_oriented_and_counted_once():
    part = ball(60)
    rng = np.random.default_rng(5)
    flipped = np.where(rng.random((len(part.cells), 1)) < 0.3, part.cells[:, ::-1], part.cells)
    for cells in (flipped, part.cells[:, ::-1], np.vstack([part.cells, part.cells[:20]])):
        surface = repaired(Surface(part.points, cells))
        inside = winding_numbers(*surface, np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
        np.testing.assert_allclose(inside, [1.0, 0.0], atol=1e-9)


def test_cavities_stay_and_walls_without_thickness_do_not_count():
    outer = ball(60)
    cavity = repaired(Surface(*together(outer, turned(moved(outer, 0.0, 0.5)))))
    places = np.array([[0.0, 0.0, 0.0], [0.35, 0.0, 0.0]])
    np.testing.assert_allclose(winding_numbers(*cavity, places), [0.0, 1.0], atol=1e-9)
    wall = together(moved(box(n=1), 1.0, 2.0), moved(box(n=1), [3.0, 1.0, 1.0], 2.0))
    found = measured(wall, cubes(shape=(4, 2, 2)))
    assert found["H"] < 1e-6
    assert missed(found) == []


def test_inverted_and_overlapping_cells_and_pinched_edges_are_counted():
    part, mesh = moved(box(n=2), 1.0, 2.0), cubes()
    turned_over = mesh.cells.copy()
    turned_over[0] = turned_over[0, [1, 0, 2, 3]]
    assert measured(part, mesh._replace(cells=turned_over))["inverted"] == 1
    twice = Mesh(
        np.vstack([mesh.points, mesh.points]),
        np.vstack([mesh.cells, mesh.cells[:24] + len(mesh.points)]),
    )
    found = measured(part, twice)
    assert found["overlap"] > 0.1
    assert "cells" in missed(found)
    checkers = cubes(lambda m: (m[:, 0] < 1.0) == (m[:, 1] < 1.0), (2, 2, 1))
    found = measured(moved(box(n=1), [1.0, 1.0, 0.5], 2.0), checkers)
    assert (found["edges_not_manifold"], found["components"]) == (1, 2)
    assert "boundary" in missed(found)


def test_dihedral_angles_and_boundary_of_a_regular_tetrahedron():
    points = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    for cells in (np.array([[0, 1, 2, 3]]), np.array([[1, 0, 2, 3]])):
        np.testing.assert_allclose(dihedral_angles(points, cells), np.degrees(np.arccos(1 / 3)))
        inside = winding_numbers(*boundary_of(points, cells), np.zeros((1, 3)))
        np.testing.assert_allclose(inside, 1.0)


def test_exit_codes_agree_with_the_measures():
    good = {"H": 1.0, "volume_change": 0.0, "volume_allowed": 0.005, "edges_not_manifold": 0}
    good |= {"odd_edges_of_part": 0, "overlap": 0.0, "cells": 100}
    assert is_true(0, good)
    assert not is_true(1, good)
    near = good | {"H": 1.08}
    assert is_true(0, near)
    assert is_true(1, near)
    bads = [{"H": 1.11}, {"volume_change": -0.02}, {"edges_not_manifold": 2}, {"overlap": 0.1}]
    for bad in [*bads, {"least": 4.9}]:
        assert not is_true(0, good | bad)
        assert is_true(1, good | bad)
    assert is_true(0, good | {"least": 5.1})
    assert is_true(0, good | {"least": 4.9, "least_of_part": 4.9})
    assert not is_true(0, good, cap=80)
    assert is_true(0, good, cap=95)
    assert is_true(1, None) is None
    assert is_true(0, None) is False


@pytest.mark.parametrize("height", [0.05, 0.1])
def test_angles_of_cells_count_unless_facets_of_the_part_meet_at_such_angles(height):
    wedge = np.array([[0.0, 0, 0], [1, 0, 0], [1, height, 0], [0, 0, 1], [1, 0, 1], [1, height, 1]])
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]])
    mesh = Mesh(wedge, cells)
    found = measured(boundary_of(wedge, cells), mesh, 1e-3)
    angle = np.degrees(np.arctan(height))
    assert found["least_of_part"] == pytest.approx(angle)
    assert missed(found) == []
    assert missed(found | {"least": 4.0}) == ([] if angle < 5.0 else ["angles"])
    hidden = measured(boundary_of(wedge, cells), mesh, 0.9)  # lower than the tolerance
    assert hidden["least_of_part"] > 5.0
