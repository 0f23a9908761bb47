"""The mesh: what it refuses, what it owns, and its topology against slow twins."""

import re
from collections import Counter
from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, random_sphere, random_square
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
HALVES = [[0, 1, 2], [0, 2, 3]]
TETRAHEDRON = [[0.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]

REFUSED = {
    "nan": (
        [[0, 0], [np.nan, 0], [0, 1]],
        [[0, 1, 2]],
        {},
        "points must be finite, got points[1, 0] = nan",
    ),
    "inf": (
        [[0, 0], [1, 0], [0, -np.inf]],
        [[0, 1, 2]],
        {},
        "points must be finite, got points[2, 1] = -inf",
    ),
    "flat points": (
        [0.0, 1.0],
        [[0, 1]],
        {},
        "points must have shape (n, dim) with dim 1, 2 or 3, got (2,)",
    ),
    "four coordinates": (
        np.zeros((3, 4)),
        [[0, 1, 2]],
        {},
        "points must have shape (n, dim) with dim 1, 2 or 3, got (3, 4)",
    ),
    "words": ([["a", "b"]], [[0, 1]], {}, "points must be an array of numbers, got [['a', 'b']]"),
    "index too large": (
        SQUARE,
        [[0, 1, 2], [0, 2, 4]],
        {},
        "cells must be indices from 0 to 3, got cells[1, 2] = 4",
    ),
    "negative index": (
        SQUARE,
        [[0, -1, 2]],
        {},
        "cells must be indices from 0 to 3, got cells[0, 1] = -1",
    ),
    "two bad ones": (SQUARE, [[0, 9, 8]], {}, "got cells[0, 1] = 9 (and 1 more)"),
    "fraction": (SQUARE, [[0, 1, 1.5]], {}, "cells must be integers, got [[0, 1, 1.5]]"),
    "flat cells": (SQUARE, [0, 1, 2], {}, "cells must have shape (m, k), got (3,)"),
    "no cell": (
        SQUARE,
        np.zeros((0, 3), int),
        {},
        "cells must hold at least one cell, got an empty array",
    ),
    "one node": (SQUARE, [[0], [1]], {}, "cells must have 2 to 3 nodes each in 2-D, got 1"),
    "tetrahedra in the plane": (
        SQUARE,
        [[0, 1, 2, 3]],
        {},
        "cells must have 2 to 3 nodes each in 2-D, got 4",
    ),
    "node twice": (
        SQUARE,
        [[0, 1, 2], [3, 0, 3]],
        {},
        "cells must not name a node twice, got cells[1] = [3, 0, 3]",
    ),
    "cell tags": (SQUARE, HALVES, {"cell_tags": [1]}, "cell_tags must have shape (2,), got (1,)"),
    "half a tag": (
        SQUARE,
        HALVES,
        {"cell_tags": [1.0, 2.5]},
        "cell_tags must be integers, got cell_tags[1] = 2.5",
    ),
    "tag in words": (
        SQUARE,
        HALVES,
        {"cell_tags": ["a", "b"]},
        "cell_tags must be integers, got <U1",
    ),
    "facets without tags": (
        SQUARE,
        HALVES,
        {"tagged_facets": [[0, 1]]},
        "tagged_facets and facet_tags must be given together",
    ),
    "tags without facets": (
        SQUARE,
        HALVES,
        {"facet_tags": [1]},
        "tagged_facets and facet_tags must be given together",
    ),
    "facets too wide": (
        SQUARE,
        HALVES,
        {"tagged_facets": [[0, 1, 2]], "facet_tags": [1]},
        "tagged_facets must have shape (m, 2), got (1, 3)",
    ),
    "facet index": (
        SQUARE,
        HALVES,
        {"tagged_facets": [[0, 1], [1, 4]], "facet_tags": [1, 2]},
        "tagged_facets must be indices from 0 to 3, got tagged_facets[1, 1] = 4",
    ),
    "facet tags": (
        SQUARE,
        HALVES,
        {"tagged_facets": [[0, 1]], "facet_tags": [1, 2]},
        "facet_tags must have shape (1,), got (2,)",
    ),
    "tag beyond 32 bits": (
        SQUARE,
        HALVES,
        {"cell_tags": [1, 2**31]},
        "cell_tags must fit into 32 bits, from -2147483648 to 2147483647, "
        "got cell_tags[1] = 2147483648",
    ),
    "tag below 32 bits": (
        SQUARE,
        HALVES,
        {"tagged_facets": [[0, 1]], "facet_tags": [-1e10]},
        "facet_tags must fit into 32 bits",
    ),
    "infinite tag": (
        SQUARE,
        HALVES,
        {"cell_tags": [np.inf, 1]},
        "cell_tags must fit into 32 bits",
    ),
    "name of a tag without dimension": (
        SQUARE,
        HALVES,
        {"tag_names": {7: "wall"}},
        "tag_names must have keys (dimension 0 to 3, tag), got 7",
    ),
    "name of a tag of dimension 4": (
        SQUARE,
        HALVES,
        {"tag_names": {(4, 7): "wall"}},
        "tag_names must have keys (dimension 0 to 3, tag), got (4, 7)",
    ),
    "name that is no text": (
        SQUARE,
        HALVES,
        {"tag_names": {(1, 7): 8}},
        "tag_names[(1, 7)] must be a name on one line, without double quotes, got 8",
    ),
    "nodal field": (
        SQUARE,
        HALVES,
        {"point_data": {"u": [1, 2]}},
        "point_data['u'] must have 4 rows, got shape (2,)",
    ),
    "field of cells": (
        SQUARE,
        HALVES,
        {"cell_data": {"u": 7}},
        "cell_data['u'] must have 2 rows, got shape ()",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refuses_and_says_why(case):
    points, cells, others, expected = REFUSED[case]
    with pytest.raises(ValueError, match=re.escape(expected)):
        SimplexMesh(points, cells, **others)


def test_whole_floats_and_every_integer_type_are_indices():
    for kind in (np.float64, np.uint8, np.int64, np.int16):
        mesh = SimplexMesh(SQUARE, np.array(HALVES, kind), cell_tags=np.array([1, 2], kind))
        assert mesh.cells.dtype == np.int32
        assert mesh.cells.tolist() == HALVES
        assert mesh.cell_tags.tolist() == [1, 2]


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


def test_writes_through_a_view_of_other_memory_do_not_reach_the_mesh():
    block = np.zeros((5, 2))
    block[:4] = SQUARE
    mesh = SimplexMesh(block[:4], HALVES)
    block[:] = 7.0
    assert mesh.points.tolist() == SQUARE


def test_the_arrays_of_the_caller_stay_writable():
    given, fields = _tagged_square()
    SimplexMesh(**given, **fields)
    assert all(array.flags.writeable for array in given.values())
    assert fields["point_data"]["u"].flags.writeable


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


def test_topology_is_worked_out_once():
    mesh = SimplexMesh(SQUARE, HALVES)
    for name in ("edges", "facets", "measures", "facet_cell_counts", "rings", "locator"):
        assert getattr(mesh, name) is getattr(mesh, name)


KINDS = {"segments": (2, 2), "plane": (3, 2), "surface": (3, 3), "volume": (4, 3), "line": (2, 1)}


@st.composite
def any_meshes(draw):
    """Random cells over few nodes: non-manifold, repeated and unused ones included."""
    width, dim = KINDS[draw(st.sampled_from(sorted(KINDS)))]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_points = draw(st.integers(width, 12))
    n_cells = draw(st.integers(1, 30))
    cells = np.array([rng.choice(n_points, width, replace=False) for _ in range(n_cells)])
    return SimplexMesh(rng.normal(size=(n_points, dim)), cells)


def _subsets(mesh, width):
    return [
        tuple(sorted(subset))
        for cell in mesh.cells.tolist()
        for subset in combinations(cell, width)
    ]


@given(any_meshes())
def test_edges_are_the_sorted_set_of_pairs(mesh):
    pairs = sorted(set(_subsets(mesh, 2)))
    assert [tuple(edge) for edge in mesh.edges.tolist()] == pairs
    lengths = [np.linalg.norm(mesh.points[i] - mesh.points[j]) for i, j in pairs]
    assert_allclose(mesh.edge_lengths, lengths, rtol=1e-15)


@given(any_meshes())
def test_facets_are_the_sorted_set_of_sides_and_counted(mesh):
    sides = Counter(_subsets(mesh, mesh.cell_dim))
    assert [tuple(facet) for facet in mesh.facets.tolist()] == sorted(sides)
    assert mesh.facet_cell_counts.tolist() == [sides[side] for side in sorted(sides)]
    assert mesh.is_closed == (1 not in sides.values())


@given(any_meshes())
def test_cell_facets_lie_opposite_to_their_vertices(mesh):
    assert mesh.cell_facets.shape == mesh.cells.shape
    for cell, facets in zip(mesh.cells.tolist(), mesh.cell_facets.tolist(), strict=True):
        for vertex, facet in zip(cell, facets, strict=True):
            assert mesh.facets[facet].tolist() == sorted(set(cell) - {vertex})


@given(any_meshes())
def test_rings_list_the_cells_of_each_node_in_order(mesh):
    ring_ptr, ring = mesh.rings
    assert len(ring_ptr) == mesh.n_points + 1
    for i in range(mesh.n_points):
        around = [c for c, cell in enumerate(mesh.cells.tolist()) if i in cell]
        assert ring[ring_ptr[i] : ring_ptr[i + 1]].tolist() == around


def test_three_triangles_at_one_edge_are_counted():
    points = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]]
    mesh = SimplexMesh(points, [[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    counts = dict(
        zip(map(tuple, mesh.facets.tolist()), mesh.facet_cell_counts.tolist(), strict=True)
    )
    assert counts[0, 1] == 3
    assert sorted(counts.values()) == [1] * 6 + [3]
    assert len(mesh.boundary().mesh.cells) == 6


def test_names_itself_with_its_counts():
    assert repr(SimplexMesh(SQUARE, HALVES)) == "SimplexMesh(4 points in 2-D, 2 triangles)"
    assert (
        repr(SimplexMesh(TETRAHEDRON, [[0, 1, 2, 3]]))
        == "SimplexMesh(4 points in 3-D, 1 tetrahedra)"
    )
    assert repr(SimplexMesh([[0.0], [1.0]], [[0, 1]])) == "SimplexMesh(2 points in 1-D, 1 segments)"


# Measures.


def test_measures_of_a_segment_a_triangle_and_a_tetrahedron_by_hand():
    assert SimplexMesh([[1.0, 2], [4, 6]], [[0, 1]]).measures.tolist() == [5.0]
    tilted = SimplexMesh([[0.0, 0, 0], [3, 0, 4], [0, 2, 0]], [[0, 1, 2]])
    assert_allclose(tilted.measures, [5.0], rtol=1e-15)
    assert_allclose(SimplexMesh(TETRAHEDRON, [[0, 1, 2, 3]]).measures, [1.0 / 6.0], rtol=1e-15)


def test_measures_of_a_meshed_box_add_up_to_it():
    assert_allclose(
        random_square(500, 71).signed_measures.sum(), random_square(500, 71).measures.sum()
    )
    assert_allclose(jittered_cube(6, 72, half_width=2.0).measures.sum(), 64.0, rtol=1e-12)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_signed_measures_change_sign_with_odd_renumbering(dim):
    corners = np.vstack([np.zeros(dim), np.eye(dim)])
    for order in permutations(range(dim + 1)):
        sign = np.linalg.det(np.eye(dim + 1)[list(order)])
        mesh = SimplexMesh(corners, [order])
        assert_allclose(mesh.signed_measures, [sign / np.prod(range(1, dim + 1))], rtol=1e-15)
        assert_allclose(mesh.measures, np.abs(mesh.signed_measures), rtol=1e-14)


def test_signed_measures_need_cells_of_full_dimension():
    with pytest.raises(ValueError, match=re.escape("got SimplexMesh(20 points in 3-D")):
        _ = random_sphere(20, 73).signed_measures


@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(KINDS)))
def test_degenerate_cells_have_measure_zero(seed, kind):
    width, dim = KINDS[kind]
    rng = np.random.default_rng(seed)
    # Small whole numbers: the corners lie exactly in a plane, on a line or in a point.
    points = rng.integers(-4, 5, (width, dim)).astype(float)
    points[-1] = points[0] + rng.integers(-2, 3) * (points[-2] - points[0])
    assert SimplexMesh(points, [range(width)]).measures.tolist() == [0.0]


def test_diagonal_spans_the_nodes_that_belong_to_cells():
    mesh = SimplexMesh([*SQUARE, [50.0, 50.0]], HALVES)
    assert mesh.diagonal == pytest.approx(np.sqrt(2.0), rel=1e-15)


# The boundary.


def _outward(part, owners):
    """Return the signed distance of the centres of the owners behind the boundary facets."""
    corners = part.points[part.cells]
    if part.dim == 2:
        along = corners[:, 1] - corners[:, 0]
        normal = np.column_stack([along[:, 1], -along[:, 0]])  # the domain to the left
    else:
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("ij,ij->i", normal, corners[:, 0] - owners)


@pytest.mark.parametrize("make", [lambda: random_square(80, 74), lambda: jittered_cube(4, 75)])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_boundary_normals_point_outward_whatever_the_orientation(make, seed):
    mesh = make()
    shuffled = np.random.default_rng(seed).permuted(mesh.cells, axis=1)
    mesh = SimplexMesh(mesh.points, shuffled)
    assert (mesh.signed_measures < 0.0).any()
    assert (mesh.signed_measures > 0.0).any()
    part, nodes, cells = mesh.boundary()
    assert (_outward(part, mesh.points[mesh.cells[cells]].mean(axis=1)) > 0.0).all()
    assert (part.points == mesh.points[nodes]).all()
    for facet, cell in zip(nodes[part.cells].tolist(), cells, strict=True):
        assert set(facet) < set(mesh.cells[cell].tolist())
    expected = mesh.facets[mesh.facet_cell_counts == 1]
    assert sorted(sorted(row) for row in nodes[part.cells].tolist()) == expected.tolist()


def test_boundary_of_a_box_encloses_its_volume():
    # Divergence theorem: the volume is a third of the flux of x through the boundary.
    part = jittered_cube(5, 76, half_width=1.0).boundary().mesh
    assert_allclose(np.linalg.det(part.points[part.cells]).sum() / 6.0, 8.0, rtol=1e-12)
    assert part.is_closed


def test_boundary_of_a_surface_runs_as_its_triangles_do():
    points = np.column_stack([SQUARE, np.zeros(4)])
    for cells in (HALVES, [cell[::-1] for cell in HALVES]):
        mesh = SimplexMesh(points, cells)
        part, nodes, owners = mesh.boundary()
        for (i, j), owner in zip(nodes[part.cells].tolist(), owners, strict=True):
            cell = mesh.cells[owner].tolist()
            assert cell[(cell.index(i) + 1) % 3] == j


def test_boundary_carries_tags_and_nodal_fields():
    mesh = SimplexMesh(
        SQUARE,
        HALVES,
        # The diagonal is no boundary; a tag counts whatever the order of its nodes.
        tagged_facets=[[1, 0], [0, 2], [2, 3]],
        facet_tags=[7, 8, 9],
        tag_names={(1, 7): "south", (2, 1): "all"},
        point_data={"u": [10.0, 11.0, 12.0, 13.0]},
    )
    part, nodes, _ = mesh.boundary()
    tags = {
        tuple(sorted(facet)): tag
        for facet, tag in zip(nodes[part.cells].tolist(), part.cell_tags.tolist(), strict=True)
    }
    assert tags == {(0, 1): 7, (1, 2): 0, (2, 3): 9, (0, 3): 0}
    assert part.tag_names == {(1, 7): "south", (2, 1): "all"}
    assert part.point_data["u"].tolist() == (10.0 + nodes).tolist()
    assert SimplexMesh(SQUARE, HALVES).boundary().mesh.cell_tags is None


def test_names_of_tags_are_copied_read_only_and_outlive_new_fields():
    names = {(np.int64(2), np.int8(1)): "all"}
    mesh = SimplexMesh(SQUARE, HALVES, cell_tags=[1, 1], tag_names=names)
    names.clear()
    assert mesh.with_data(point_data={"u": np.zeros(4)}).tag_names == {(2, 1): "all"}
    with pytest.raises(TypeError):
        mesh.tag_names[2, 1] = "none"


def test_tags_of_facets_that_no_cell_has_are_passed_over():
    mesh = SimplexMesh(SQUARE, HALVES, tagged_facets=[[1, 3], [0, 1]], facet_tags=[4, 5])
    part, nodes, _ = mesh.boundary()
    tagged = [sorted(row) for row in nodes[part.cells[part.cell_tags == 5]].tolist()]
    assert tagged == [[0, 1]]
    assert sorted(part.cell_tags.tolist()) == [0, 0, 0, 5]


def test_boundary_leaves_out_nodes_of_no_cell():
    mesh = SimplexMesh([[9.0, 9.0], *SQUARE], np.add(HALVES, 1))
    part, nodes, _ = mesh.boundary()
    assert nodes.tolist() == [1, 2, 3, 4]
    assert part.points.tolist() == SQUARE


def test_closed_meshes_and_segments_have_no_boundary():
    with pytest.raises(ValueError, match="the mesh is closed"):
        random_sphere(20, 77).boundary()
    with pytest.raises(ValueError, match="boundary of segments"):
        SimplexMesh(SQUARE, [[0, 1]]).boundary()


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


def test_delaunay_output_is_taken_as_it_is():
    triangulation = Delaunay(np.random.default_rng(78).random((30, 2)))
    mesh = SimplexMesh(triangulation.points, triangulation.simplices)
    assert mesh.n_cells == len(triangulation.simplices)
    # Euler: a triangulated disc has vertices - edges + triangles = 1.
    assert mesh.n_points - len(mesh.edges) + mesh.n_cells == 1
