"""The boundary of a mesh: its normals, tags and fields."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, random_sphere, random_square

from adaptsize import SimplexMesh

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
HALVES = [[0, 1, 2], [0, 2, 3]]


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


def test_closed_meshes_and_segments_have_no_boundary():
    with pytest.raises(ValueError, match="the mesh is closed"):
        random_sphere(20, 77).boundary()
    with pytest.raises(ValueError, match="boundary of segments"):
        SimplexMesh(SQUARE, [[0, 1]]).boundary()
