"""Opposite sides of periodic cells match after `remesh` and `adapt`."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from periodic_units import UNITS, plane_inclusions
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
from adaptsize.remeshing.periodic import PeriodicCell

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


@pytest.mark.parametrize("name", UNITS)
def test_sides_are_remeshed_and_match(name):
    mesh, motions = UNITS[name]()
    factor = 0.6 if mesh.dim == 2 else 1.4
    kind = {"target": "triangles"} if mesh.cell_dim < mesh.dim else {}
    new = remesh(mesh, factor * median_edge(mesh), periodic=motions, **kind)
    assert_sides_match(new, motions)
    assert_allclose(measure_on_sides(new, motions), measure_on_sides(mesh, motions), rtol=1e-5)
    if mesh.cell_dim == mesh.dim:
        assert_allclose(new.measures.sum(), mesh.measures.sum(), rtol=0.01)
    if mesh.dim == 2:  # the sides have the requested sizes, too
        corners = side_facets(new, motions)
        lengths = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
        assert 0.75 < np.median(lengths) / (factor * median_edge(mesh)) < 1.25
    elif name == "column":  # without small features or curved sides
        assert len(side_facets(new, motions)) < 0.95 * len(side_facets(mesh, motions))


@pytest.mark.parametrize("name", ["plane_inclusions", "box_with_inclusions", "column"])
def test_regions_tags_and_names_are_kept(name):
    mesh, motions = UNITS[name]()
    new = remesh(mesh, 1.4 * median_edge(mesh), periodic=motions)
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
