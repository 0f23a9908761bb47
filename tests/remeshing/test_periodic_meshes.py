"""Opposite sides of periodic cells match after `remesh` and `adapt`."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from periodic_units import UNITS, hexagon, plane_inclusions, sector
from scipy.spatial import cKDTree

from adaptsize import (
    CartesianGrid,
    Metric,
    SimplexMesh,
    adapt,
    limit_gradient,
    remesh,
    size_conformity,
)
from adaptsize.background.topology import unique_rows
from adaptsize.errors import BackendError, BackendTimeoutError
from adaptsize.remeshing import tuning
from adaptsize.remeshing.periodic import PeriodicCell, remesh_periodic
from adaptsize.remeshing.preparation import facet_numbers

pytest.importorskip("mmgpy")


def side_facets(mesh, motions):
    """Return the corners of the facets on sides, float64[n, k, dim]."""
    return mesh.points[mesh.facets[PeriodicCell(mesh, motions).on_sides]]


def assert_sides_match(mesh, motions):
    """Each facet moved by a motion to a side is a facet there, to 1e-12."""
    corners = side_facets(mesh, motions)
    middles, nodes = corners.mean(axis=1), np.unique(corners.reshape(-1, mesh.dim), axis=0)
    motions = np.asarray(motions, float)
    facets_of_side = 0
    for one in motions:
        turn, shift = (one[:, :-1], one[:, -1]) if one.ndim == 2 else (np.eye(mesh.dim), one)
        for found in (middles, nodes):
            away = cKDTree(found).query(found @ turn.T + shift)[0]
            assert ((away < 1e-12) | (away > 1e-6)).all()
        facets_of_side += int((away < 1e-12).sum())
    assert facets_of_side > 0


def measure_on_sides(mesh, motions):
    facets = mesh.facets[PeriodicCell(mesh, motions).on_sides]
    return SimplexMesh(mesh.points, facets).measures.sum()


def median_edge(mesh):
    return float(np.median(mesh.edge_lengths))


# The gyroid takes as long as all others together: it is for runs by hand.
QUICK = [name for name in UNITS if name != "gyroid"]


@cache
def remade(name):
    """Return a unit, its motions, the median of its edges, the factor to it, and the new mesh."""
    mesh, motions = UNITS[name]()
    factor = 0.6 if mesh.dim == 2 else 1.4
    kind = {"target": "triangles"} if mesh.cell_dim < mesh.dim else {}
    size = factor * median_edge(mesh)
    return mesh, motions, size, remesh(mesh, size, periodic=motions, **kind)


@pytest.mark.parametrize("name", QUICK)
def test_sides_are_remeshed_and_match(name):
    mesh, motions, size, new = remade(name)
    assert_sides_match(new, motions)
    assert_allclose(measure_on_sides(new, motions), measure_on_sides(mesh, motions), rtol=1e-5)
    if mesh.cell_dim == mesh.dim:
        assert_allclose(new.measures.sum(), mesh.measures.sum(), rtol=0.01)
    if mesh.dim == 2:  # the sides have the requested sizes, too
        corners = side_facets(new, motions)
        lengths = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
        assert 0.75 < np.median(lengths) / size < 1.25
    if name == "column":  # without small features or curved sides
        assert len(side_facets(new, motions)) < 0.95 * len(side_facets(mesh, motions))


@pytest.mark.parametrize("name", ["plane_inclusions", "box_with_inclusions", "column"])
def test_regions_tags_and_names_are_kept(name):
    mesh, _, _, new = remade(name)
    assert new.tag_names == mesh.tag_names
    for tag in np.unique(mesh.cell_tags) if mesh.cell_tags is not None else ():
        got, before = (one.measures[one.cell_tags == tag].sum() for one in (new, mesh))
        assert_allclose(got, before, rtol=1e-9)
    for tag in np.unique(mesh.facet_tags):
        got, before = (tagged_part(one, tag) for one in (new, mesh))
        assert_allclose(got.measures.sum(), before.measures.sum(), rtol=1e-9)
        assert_allclose(middle(got), middle(before), atol=1e-9)


def tagged_part(mesh, tag):
    return SimplexMesh(mesh.points, mesh.tagged_facets[mesh.facet_tags == tag])


def middle(part):
    return part.measures @ part.points[part.cells].mean(axis=1) / part.measures.sum()


def test_a_source_at_one_side_is_resolved_at_both():
    mesh = CartesianGrid([0.0, 0.0], 0.1, (11, 11)).mesh

    def size(points):
        return 0.02 + 0.3 * np.linalg.norm(points - [0.0, 0.35], axis=1)

    new = remesh(mesh, size, periodic=[[1.0, 0.0]])
    assert_sides_match(new, [[1.0, 0.0]])
    middles = side_facets(new, [[1.0, 0.0]])
    lengths = np.linalg.norm(middles[:, 0] - middles[:, 1], axis=1)
    place = middles.mean(axis=1)
    for x in (0.0, 1.0):
        near = (np.abs(place[:, 0] - x) < 1e-9) & (np.abs(place[:, 1] - 0.35) < 0.05)
        assert 2 <= near.sum() <= 8
        assert lengths[near].max() < 0.06


def test_a_cell_of_two_triangles_is_refined_on_all_sides():
    square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    new = remesh(square, 0.1, periodic=np.eye(2))
    assert_sides_match(new, np.eye(2))
    assert size_conformity(new, np.full(new.n_points, 0.1)).share_in_band > 0.95


@pytest.mark.parametrize(
    ("angle", "n"), [(np.pi / 3.0, 1), (np.pi / 3.0, 2), (2.0 * np.pi / 3.0, 8)]
)
def test_sides_that_one_cell_has_both_of_are_remeshed(angle, n):
    mesh, motions = sector(angle, n)
    tags = np.arange(mesh.n_cells) % 2
    mesh = SimplexMesh(mesh.points, mesh.cells, cell_tags=tags)
    new = remesh(mesh, 0.05, periodic=motions)
    corners = side_facets(new, motions)
    assert np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1).max() < 0.075
    for tag in np.unique(tags):
        assert_allclose(
            new.measures[new.cell_tags == tag].sum(), mesh.measures[tags == tag].sum(), rtol=0.03
        )


def test_translations_as_maps_are_the_same_motions():
    mesh, vectors = hexagon()
    maps = np.concatenate([np.broadcast_to(np.eye(2), (2, 2, 2)), vectors[:, :, None]], axis=2)
    # Above 10 000 facets, they are numbered by a kernel, which does not check indices.
    made, same = (remesh(mesh, 0.025, periodic=motions) for motions in (vectors, maps))
    assert len(made.facets) > 10_000
    assert_array_equal(made.points, same.points)
    assert_array_equal(made.cells, same.cells)
    h0 = np.where(np.arange(mesh.n_points) == 40, 0.01, 1.0)
    sizes = (
        limit_gradient(mesh, h0, 0.3, periodic=motions, method="fast-marching")
        for motions in (vectors, maps)
    )
    assert_allclose(*sizes, rtol=1e-12)


def test_rows_of_nodes_that_do_not_exist_have_no_number():
    mesh = CartesianGrid([0.0, 0.0], 1.0, (80, 80)).mesh
    rows = np.concatenate([mesh.facets[:3], [[-1, 5], [5, mesh.n_points]]]).astype(np.int32)
    assert_array_equal(facet_numbers(mesh, rows), [0, 1, 2, -1, -1])
    for few in (rows, np.tile(rows, (3000, 1))):
        with pytest.raises(IndexError, match="indices from 0 to 6399, got -1 to 6400"):
            unique_rows(few, mesh.n_points)


def test_boxes_one_cell_across_are_remeshed():
    """The cuts of moved cells would be all of their boundary: cells are divided first."""
    box = CartesianGrid([0.0, 0.0, 0.0], 1.0, (2, 2, 3)).mesh
    outer = box.facets[box.facet_cell_counts == 1]
    box = replace(
        box, cell_tags=np.arange(box.n_cells) % 2, tagged_facets=outer,
        facet_tags=np.arange(len(outer)) % 3,
    )  # fmt: skip
    for motions in ([[1.0, 0.0, 0.0]], np.diag([1.0, 1.0, 2.0])):
        new = remesh(box, 0.3, periodic=motions)
        assert_sides_match(new, motions)
        lengths = np.linalg.norm(np.diff(side_facets(new, motions)[:, :2], axis=1), axis=2)
        assert 0.1 < np.median(lengths) < 0.45
        for tag in (0, 1):
            before, after = (m.measures[m.cell_tags == tag].sum() for m in (box, new))
            assert_allclose(after, before, rtol=0.01)
        for tag in range(3):
            areas = [
                SimplexMesh(m.points, m.tagged_facets[m.facet_tags == tag]).measures.sum()
                for m in (box, new)
            ]
            assert_allclose(areas[1], areas[0], rtol=1e-9)


def test_a_wide_layer_one_cell_thick_is_refused_at_once(monkeypatch):
    monkeypatch.setattr(tuning, "MOST_PERIODIC_CELLS", 300)
    layer = CartesianGrid([0.0, 0.0, 0.0], 1.0, (5, 5, 2)).mesh

    def no_mesh(mesh, size, kept):
        raise AssertionError("meshed before the check")

    text = "three cells or more between opposite sides.* dividing all 96 would make more than 300"
    with pytest.raises(ValueError, match=text):
        remesh_periodic(layer, [[0.0, 0.0, 1.0]], lambda x: np.full(len(x), 0.5), no_mesh)


def test_edges_on_sides_that_stay_too_long_are_an_error():
    with pytest.raises(BackendError, match=r"length 0.5 at \[.*\], 10 times its size"):
        remesh_periodic(
            SQUARE, np.eye(2), lambda x: np.full(len(x), 0.05), lambda mesh, size, kept: mesh
        )


def test_nodes_of_sides_that_the_generator_moves_are_an_error():
    def moves_a_node(mesh, size, kept):
        points = mesh.points.copy()
        if mesh.points.max() == 1.0 and mesh.points.min() == 0.0:  # the last mesh
            points[np.argmin(np.abs(points - [1.0, 0.5]).sum(axis=1))] += [0.01, 0.0]
        return replace(mesh, points=points)

    text = r"no longer match after a run of mmg.* 0.01 away .*, at \[1.01, 0.5\]"
    with pytest.raises(BackendError, match=text):
        remesh_periodic(SQUARE, np.eye(2), lambda x: np.full(len(x), 0.5), moves_a_node)


def test_the_error_of_a_time_limit_names_the_given_one():
    # A generator is asked every tenth of a second whether it has ended.
    with pytest.raises(BackendTimeoutError, match=r"no periodic mesh .* limit of 0.001 s"):
        remesh(SQUARE, 0.005, periodic=np.eye(2), timeout=1e-3)


def test_nodes_of_a_crack_across_a_cut_are_refused():
    square = CartesianGrid([0.0, 0.0], 0.1, (11, 11)).mesh
    x, y = square.points.T
    lips = np.flatnonzero((np.abs(y - 0.5) < 1e-9) & (x > 0.35) & (x < 0.75))
    copy = np.arange(square.n_points)
    copy[lips] = square.n_points + np.arange(len(lips))
    above = square.points[square.cells].mean(axis=1)[:, 1] > 0.5
    cells = np.where(above[:, None], copy[square.cells], square.cells)
    cracked = SimplexMesh(np.concatenate([square.points, square.points[lips]]), cells)
    with pytest.raises(ValueError, match=r"one node at each place.*are both at \[0\.[4567]"):
        remesh(cracked, 0.1, periodic=np.eye(2))


def test_a_turned_and_shifted_cell_gives_matching_sides():
    mesh, motions = plane_inclusions()
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    moved = SimplexMesh(100.0 + 3.0 * mesh.points @ turn.T, mesh.cells, cell_tags=mesh.cell_tags)
    new = remesh(moved, 0.2, periodic=3.0 * motions @ turn.T)
    corners = side_facets(new, 3.0 * motions @ turn.T)
    assert len(corners) > 40
    assert_allclose(new.measures.sum(), 9.0, rtol=1e-12)


def test_adapt_keeps_sides_and_gives_them_equal_sizes():
    mesh = CartesianGrid([0.0, 0.0], 1.0 / 12, (13, 13)).mesh
    motions = np.eye(2)
    for _ in range(2):
        middles = mesh.points[mesh.cells].mean(axis=1)
        step = middles - [0.1, 0.05]
        away = np.linalg.norm(step - np.round(step), axis=1)
        result = adapt(
            mesh, mesh.measures * np.exp(-8.0 * away), elements=600, periodic=motions,
            fields={"x": np.sin(2.0 * np.pi * mesh.points[:, 0])}, enough=2.0,
        )  # fmt: skip
        sizes, cell = result.size.values, PeriodicCell(mesh, motions)
        label = cell.label
        order = np.argsort(label)[np.sum(label < 0) :]
        same = label[order][1:] == label[order][:-1]
        assert same.sum() > 20
        assert_allclose(sizes[order][1:][same], sizes[order][:-1][same], rtol=1e-12)
        mesh = result.mesh
        assert_sides_match(mesh, motions)
        assert 540 <= mesh.n_cells <= 660


def test_sizes_limited_across_the_sides_give_a_mesh_that_fits():
    mesh = CartesianGrid([0.0, 0.0], 1.0 / 16, (17, 17)).mesh
    h0 = np.where(np.linalg.norm(mesh.points - [0.0, 0.5], axis=1) < 0.05, 0.02, 0.2)
    h = limit_gradient(mesh, h0, 0.3, periodic=[[1.0, 0.0]])
    new = remesh(mesh, h, periodic=[[1.0, 0.0]])
    assert_sides_match(new, [[1.0, 0.0]])
    counts = [np.sum(np.abs(new.points[:, 0] - x) < 0.2) for x in (0.0, 1.0)]
    assert 0.8 < counts[0] / counts[1] < 1.25


OTHER_SIDES = [[0, 0], [1, 0], [1, 1], [0, 1], [1, 0.4]]
CELLS = [[0, 1, 4], [0, 4, 2], [0, 2, 3]]
SQUARE = CartesianGrid([0.0, 0.0], 0.5, (3, 3)).mesh
CUBE = CartesianGrid([0.0, 0.0, 0.0], 1.0, (2, 2, 2)).mesh


@pytest.mark.parametrize(
    ("mesh", "options", "text"),
    [
        (SimplexMesh(OTHER_SIDES, CELLS), {"periodic": [[-1, 0]]}, "needs nodes in pairs"),
        (SQUARE, {"periodic": [[1, 0, 0]]}, "translations, of shape (k, 2)"),
        (SQUARE, {"periodic": [[0.5, 0]]}, "overlaps its image"),
        (SQUARE, {"periodic": [[1, 0]], "required_facets": [[0, 1]]}, "cannot be combined"),
        (SQUARE, {"periodic": [[1, 0]], "strict": True}, "cannot be combined"),
        (SQUARE, {"periodic": [[1, 0]], "backend": "tetwild"}, "tetwild"),
        (CUBE.boundary().mesh, {"periodic": [[1, 0, 0]]}, "make tetrahedra first"),
    ],
)
def test_what_cannot_be_periodic_is_refused(mesh, options, text):
    with pytest.raises(ValueError, match=re.escape(text)):
        remesh(mesh, 0.3, **options)


def test_a_metric_is_refused():
    metric = Metric.of(np.full((9, 2), 0.3), np.tile(np.eye(2), (9, 1, 1)))
    with pytest.raises(ValueError, match="cannot be combined with a Metric"):
        remesh(SQUARE, metric, periodic=[[1, 0]])


def test_facets_that_do_not_match_are_named():
    # A cube of five tetrahedra: the diagonals of opposite sides cross each other.
    corners = CUBE.points
    number = {tuple(p): i for i, p in enumerate(corners.astype(int).tolist())}
    cells = [
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(1, 1, 0), (1, 0, 0), (0, 1, 0), (1, 1, 1)],
        [(1, 0, 1), (1, 0, 0), (0, 0, 1), (1, 1, 1)], [(0, 1, 1), (0, 1, 0), (0, 0, 1), (1, 1, 1)],
        [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)],
    ]  # fmt: skip
    mesh = SimplexMesh(corners, [[number[p] for p in cell] for cell in cells])
    with pytest.raises(ValueError, match="needs facets in pairs"):
        remesh(mesh, 0.5, periodic=[[1, 0, 0]])


def test_motions_that_do_not_commute_are_refused():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    shift = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    with pytest.raises(ValueError, match=r"either order|overlaps|in pairs"):
        remesh(SQUARE, 0.3, periodic=np.stack([turn, shift]))
