"""The mesh: what it refuses, what it owns, and its fields."""

import pickle
import re
from fractions import Fraction

import numpy as np
import pytest

from adaptsize import SimplexMesh
from adaptsize.distributed import PartitionedMesh
from adaptsize.remeshing.preparation import facets_that_stay

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
HALVES = [[0, 1, 2], [0, 2, 3]]
#: Bad nodes or cells.
REFUSED = [
    ([[0, 0], [np.nan, 0], [0, 1]], [[0, 1, 2]], "points must be finite, got points[1, 0] = nan"),
    (
        np.zeros((3, 4)),
        [[0, 1, 2]],
        "points must have shape (n, dim) with dim 1, 2 or 3, got (3, 4)",
    ),
    (SQUARE, [[0, 1, 2], [0, 2, 4]], "cells must be indices from 0 to 3, got cells[1, 2] = 4"),
    (SQUARE, [[0, -1, 2]], "cells must be indices from 0 to 3, got cells[0, 1] = -1"),
    (SQUARE, [[0, 9, 8]], "got cells[0, 1] = 9 (and 1 more)"),
    (SQUARE, [[0, 1, 1.5]], "cells must be integers, got [[0, 1, 1.5]]"),
    (SQUARE, np.zeros((0, 3), int), "cells must hold at least one cell, got an empty array"),
    (SQUARE, [[0], [1]], "cells must have 2 to 3 nodes each in 2-D, got 1"),
    (SQUARE, [[0, 1, 2, 3]], "cells must have 2 to 3 nodes each in 2-D, got 4"),
    (SQUARE, [[0, 1, 2], [3, 0, 3]], "cells must not name a node twice, got cells[1] = [3, 0, 3]"),
]
#: Bad tags or fields of the square.
REFUSED_KEYWORDS = [
    ({"cell_tags": ["a", "b"]}, "cell_tags must be integers, got <U1"),
    ({"tagged_facets": [[0, 1]]}, "tagged_facets and facet_tags must be given together"),
    ({"facet_tags": [1]}, "tagged_facets and facet_tags must be given together"),
    (
        {"tagged_facets": [[0, 1, 2]], "facet_tags": [1]},
        "tagged_facets must have shape (m, 2), got (1, 3)",
    ),
    (
        {"tagged_facets": [[0, 1], [1, 4]], "facet_tags": [1, 2]},
        "tagged_facets must be indices from 0 to 3, got tagged_facets[1, 1] = 4",
    ),
    (
        {"tagged_facets": [[0, 1]], "facet_tags": [1, 2]},
        "facet_tags must have shape (1,), got (2,)",
    ),
    (
        {"cell_tags": [1, 2**31]},
        "cell_tags must fit into 32 bits, from -2147483648 to 2147483647, "
        "got cell_tags[1] = 2147483648",
    ),
    ({"tagged_facets": [[0, 1]], "facet_tags": [-1e10]}, "facet_tags must fit into 32 bits"),
    ({"cell_tags": [np.inf, 1]}, "cell_tags must fit into 32 bits"),
    ({"tag_names": {7: "wall"}}, "tag_names must have keys (dimension 0 to 3, tag), got 7"),
    (
        {"tag_names": {(4, 7): "wall"}},
        "tag_names must have keys (dimension 0 to 3, tag), got (4, 7)",
    ),
    (
        {"tag_names": {(1, 7): 8}},
        "tag_names[(1, 7)] must be a name on one line, without double quotes, got 8",
    ),
    ({"point_data": {"u": [1, 2]}}, "point_data['u'] must have 4 rows, got shape (2,)"),
    ({"cell_data": {"u": 7}}, "cell_data['u'] must have 2 rows, got shape ()"),
]


@pytest.mark.parametrize(("points", "cells", "expected"), REFUSED)
def test_refuses_nodes_and_cells_and_says_why(points, cells, expected):
    with pytest.raises(ValueError, match=re.escape(expected)):
        SimplexMesh(points, cells)


@pytest.mark.parametrize(("keywords", "expected"), REFUSED_KEYWORDS)
def test_refuses_tags_and_fields_and_says_why(keywords, expected):
    with pytest.raises(ValueError, match=re.escape(expected)):
        SimplexMesh(SQUARE, HALVES, **keywords)


def _tagged_square():
    given = {
        "points": np.array(SQUARE),
        "cells": np.array(HALVES, np.int32),
        "cell_tags": np.array([1, 2], np.int32),
        "tagged_facets": np.array([[0, 1], [2, 0]], np.int32),
        "facet_tags": np.array([5, 6], np.int32),
    }
    fields = {"point_data": {"u": np.arange(4.0)}, "cell_data": {"v": np.arange(2.0)}}
    return given, fields


def test_later_writes_of_the_caller_do_not_reach_the_mesh():
    given, fields = _tagged_square()
    mesh = SimplexMesh(**given, **fields)
    for array in given.values():
        array[...] = 100
    fields["point_data"]["u"] += 100
    fields["cell_data"]["v"] += 100
    fields["point_data"]["w"] = np.arange(4.0)
    assert mesh.points.tolist() == SQUARE
    assert mesh.cells.tolist() == HALVES
    assert mesh.cell_tags.tolist() == [1, 2]
    assert mesh.tagged_facets.tolist() == [[0, 1], [2, 0]]
    assert mesh.facet_tags.tolist() == [5, 6]
    assert mesh.point_data["u"].tolist() == [0, 1, 2, 3]
    assert mesh.cell_data["v"].tolist() == [0, 1]
    assert set(mesh.point_data) == {"u"}


def test_every_array_of_a_mesh_is_read_only():
    given, fields = _tagged_square()
    mesh = SimplexMesh(**given, **fields)
    names = ("points", "cells", "cell_tags", "tagged_facets", "facet_tags", "edges", "edge_lengths")
    names += ("facets", "cell_facets", "facet_cell_counts", "measures", "signed_measures")
    arrays = [getattr(mesh, name) for name in names]
    arrays += [*mesh.rings, mesh.point_data["u"], mesh.cell_data["v"]]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(TypeError):
        mesh.point_data["u"] = np.zeros(4)
    with pytest.raises(AttributeError):
        mesh.points = np.zeros((4, 2))


def test_meshes_with_moved_nodes_share_topology_and_keep_tags():
    given, fields = _tagged_square()
    mesh = SimplexMesh(**given, **fields)
    moved = mesh.moved(mesh.points + 1.0)
    assert moved.cell_facets is mesh.cell_facets  # computed by either
    assert moved.points.tolist() == (mesh.points + 1.0).tolist()
    assert moved.facet_tags.tolist() == [5, 6]
    assert not moved.point_data
    assert moved.diagonal == mesh.diagonal
    with pytest.raises(ValueError, match=r"points must have shape \(4, 2\), got \(5, 2\)"):
        mesh.moved(np.zeros((5, 2)))


# Fields.


def test_with_data_adds_replaces_and_shares_topology():
    mesh = SimplexMesh(
        SQUARE, HALVES, cell_tags=[3, 4], point_data={"a": np.zeros(4), "b": np.ones(4)}
    )
    edges, measures = mesh.edges, mesh.measures
    new = mesh.with_data(point_data={"b": [5, 6, 7, 8]}, cell_data={"c": [1.5, 2.5]})
    assert new.point_data["b"].tolist() == [5, 6, 7, 8]
    assert new.point_data["a"].tolist() == [0, 0, 0, 0]
    assert new.cell_data["c"].tolist() == [1.5, 2.5]
    assert new.cell_tags.tolist() == [3, 4]
    assert mesh.point_data["b"].tolist() == [1, 1, 1, 1]
    assert "c" not in mesh.cell_data
    assert new.edges is edges
    assert new.measures is measures
    assert np.shares_memory(new.points, mesh.points)
    with pytest.raises(ValueError, match=re.escape("point_data['a'] must have 4 rows")):
        mesh.with_data(point_data={"a": [1.0]})


def test_transposed_cells_are_recognized():
    with pytest.raises(ValueError, match=r"one row for each of the 3 nodes; pass cells\.T$"):
        SimplexMesh(
            np.random.default_rng(0).random((9, 2)), np.arange(9).reshape(3, 3).repeat(2, 1)
        )


def test_the_first_mesh_of_a_loop_goes_with_fields_and_pickles_but_not_with_other_nodes():
    first = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    mesh = SimplexMesh(2.0 * first.points, first.cells, point_data={"u": [1.0, 2.0, 3.0]})
    later = mesh.with_original(first)
    assert mesh.original is None
    assert later.original is first
    np.testing.assert_array_equal(later.point_data["u"], [1.0, 2.0, 3.0])
    assert later.with_data(cell_data={"c": [1]}).original is first
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(later)).original.points, first.points)
    assert later.moved(first.points).original is None
    part = PartitionedMesh.from_serial(mesh)
    assert part.with_original(first).original is first
    assert part.original is None


@pytest.mark.parametrize("unit", [1e-59, 1.0, 1e59])
def test_areas_are_those_of_rational_numbers_and_0_of_flat_triangles(unit):
    rng = np.random.default_rng(61)
    points = rng.normal(size=(60, 2))
    points[30:, 1] = 0.7 * points[30:, 0] + rng.normal(size=30) * 10.0 ** rng.uniform(-9, -1, 30)
    points[50:] = points[50] + np.linspace(0.0, 1.0, 10)[:, None] * [0.5, 0.25]  # exactly flat
    cells = np.array([rng.permutation(60)[:3] for _ in range(300)] + [[50, 53, 56], [52, 58, 51]])
    mesh = SimplexMesh(unit * points, cells)
    exact = []
    for corners in mesh.points[mesh.cells]:
        (ax, ay), (bx, by), (cx, cy) = ((Fraction(x), Fraction(y)) for x, y in corners.tolist())
        twice = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        exact.append(float(abs(twice) / 2))
    assert mesh.measures[-2:].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(mesh.measures, exact, rtol=1e-6, atol=1e-15 * unit**2)


def test_meshes_with_moved_nodes_share_what_does_not_depend_on_places():
    mesh = SimplexMesh(SQUARE, HALVES)
    facets = facets_that_stay(mesh)
    bulk = mesh.in_a_cell
    moved = mesh.moved(2.0 * mesh.points)
    assert facets_that_stay(moved) is facets
    assert moved.in_a_cell is bulk
    assert moved.measures.tolist() == [2.0, 2.0]
