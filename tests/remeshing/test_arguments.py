"""What is refused before any generator starts, and what is repaired."""

import re
from dataclasses import replace

import numpy as np
import pytest
from meshes import random_sphere, with_cracks
from shapes import block, two_region_rectangle

from adaptsize import SimplexMesh, SizeFunction, remesh
from adaptsize.errors import (
    BackendUnavailableError,
    InputWarning,
    TooManyElementsError,
)
from adaptsize.remeshing import available_backends, protocol
from adaptsize.remeshing.filling import number_note
from adaptsize.remeshing.preparation import MERGE_DISTANCE, as_problem, repair_mesh
from adaptsize.sizes import predict

CUBE = block(2)


@pytest.fixture(autouse=True)
def no_generator_may_start(monkeypatch):
    def refuse(self, *arguments):
        raise AssertionError("a generator was started")

    monkeypatch.setattr("adaptsize.remeshing.isolation.IsolatedRunner.__call__", refuse)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (0.0, "size must be finite and > 0, got 0"),
        (np.ones(5), r"size must have shape (27,), got (5,)"),
        (np.r_[1.0, np.inf, np.ones(25)], "size must be finite and positive, got size[1] = inf"),
        (SizeFunction(CUBE, np.r_[1.0, np.inf, np.ones(25)]), "finite and positive"),
        (lambda x: np.ones((len(x), 1)), "size(points) must have shape ("),
    ],
)
def test_bad_sizes_are_refused(size, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        remesh(CUBE, size, backend="tetwild")


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"target": "triangles"}, "target 'triangles' cannot be made from SimplexMesh(27 points"),
        ({"backend": "gmsh"}, "backend must be one of 'auto', 'mmg', 'tetwild', got 'gmsh'"),
        ({"tolerance": 1.5, "strict": True}, "tolerance must be at most 1, got 1.5"),
        ({"backend": "tetwild", "required_facets": [[0, 1, 3]]}, "cannot keep required_facets"),
    ],
)
def test_bad_arguments_are_refused(keywords, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        remesh(CUBE, 0.5, **keywords)


def test_a_required_facet_that_is_none_is_refused():
    pytest.importorskip("mmgpy")
    far_apart = [CUBE.facets[0], [0, 13, 26]]
    with pytest.raises(ValueError, match=re.escape("got required_facets[1]")):
        remesh(CUBE, 0.5, required_facets=far_apart)


def test_too_many_elements_are_refused_with_both_numbers():
    with pytest.raises(
        TooManyElementsError, match=r"about 8500000000 .* max_elements = 5000000"
    ) as one:
        remesh(CUBE, 1e-3, backend="tetwild")
    assert one.value.elements == pytest.approx(8.5e9, rel=0.05)
    with pytest.raises(TooManyElementsError, match=r"max_elements = 1000"):
        remesh(CUBE.boundary().mesh, 0.05, backend="tetwild", max_elements=1000)


@pytest.mark.parametrize(
    ("mesh", "backend", "line"),
    [
        (two_region_rectangle(2), "auto", 'pip install "adaptsize[mmg]"'),
        (CUBE, "mmg", 'pip install "adaptsize[mmg]"'),
    ],
)
def test_a_missing_generator_comes_with_its_pip_line(monkeypatch, mesh, backend, line):
    monkeypatch.setattr(protocol, "find_spec", lambda name: None)
    with pytest.raises(BackendUnavailableError, match=re.escape(line)):
        remesh(mesh, 0.5, backend=backend)
    assert not any(info.installed for info in available_backends().values())


def triangle_soup():
    """The cube as an STL file gives it, with a flat triangle, a point and a double added."""
    cube = CUBE.boundary().mesh
    points = cube.points[cube.cells].reshape(-1, 3)
    n = len(points)
    points = np.concatenate([points, [[0, 0, 0], [0.5, 0, 0], [1, 0, 0]], points[:3]])
    cells = np.arange(len(points)).reshape(-1, 3)
    assert len(cells) == n // 3 + 2
    return SimplexMesh(points, cells, tagged_facets=[[0, 1], [n, n]], facet_tags=[7, 8])


def test_soup_is_repaired_and_the_repairs_are_counted():
    soup = triangle_soup()
    cube = CUBE.boundary().mesh
    message = f"{soup.n_points - cube.n_points} duplicate points merged "
    repaired = repair_mesh(soup)
    assert message in repaired.repairs
    assert "1 duplicate triangle removed (at" in repaired.repairs
    assert (
        "1 triangle of area 0 removed without opening the surface (at (0.5, 0, 0))"
        in repaired.repairs
    )
    with pytest.warns(InputWarning, match=message), pytest.raises(TooManyElementsError):
        remesh(soup, 1e-5)
    assert (repaired.mesh.n_points, repaired.mesh.n_cells) == (cube.n_points, cube.n_cells)
    assert repaired.mesh.is_closed
    assert np.array_equal(soup.points[repaired.nodes], repaired.mesh.points)
    assert np.array_equal(repaired.mesh.points[repaired.node_map], soup.points)
    assert repaired.mesh.facet_tags.tolist() == [7]
    assert np.array_equal(repaired.mesh.points[repaired.mesh.tagged_facets[0]], soup.points[:2])


@pytest.mark.parametrize(("apart", "n_merged"), [(0.2, 1), (5.0, 0)])
def test_points_are_merged_up_to_the_merge_distance_also_across_a_lattice_border(apart, n_merged):
    merge_distance = MERGE_DISTANCE * np.sqrt(5.0)  # times the diagonal of these points
    border = np.floor(1.0 / merge_distance) + 0.5  # where rounding to a lattice changes
    x = (border + np.array([-0.5, 0.5]) * apart) * merge_distance
    points = [[0, 0, 0], [0, 2, 0], [x[0], 0, 0], [x[1], 0, 0], [0.5, 2, 0], [1, 2, 0]]
    repaired = repair_mesh(SimplexMesh(points, [[0, 2, 1], [3, 5, 4]]))
    assert ("1 duplicate point merged (at" in repaired.repairs) == (n_merged == 1)
    assert repaired.mesh.n_points == 6 - n_merged


@pytest.mark.parametrize("apart", [5e-9, 5e-7])
def test_nearly_equal_points_are_joined_where_edges_then_match(apart):
    points = [[0, 0, 0], [0, 2, 0], [1, 0, 0], [1 + apart, 0, 0], [0, 2 - apart, 0], [1, 2, 0]]
    soup = SimplexMesh(points, [[0, 2, 1], [3, 5, 4]])
    repaired = repair_mesh(soup)
    assert "2 nearly equal points on open edges joined (the first at" in repaired.repairs
    assert repaired.mesh.n_points == 4
    assert repaired.node_map[[2, 1]].tolist() == repaired.node_map[[3, 4]].tolist()
    # Sheets side by side stay two.
    sheets = SimplexMesh([*points[:3], *np.add(points[:3], [0, 0, 1e-5])], [[0, 2, 1], [3, 5, 4]])
    assert repair_mesh(sheets).mesh.n_points == 6


def test_cracks_are_closed_although_slivers_have_shorter_edges():
    cracked = with_cracks(random_sphere(200, 4409), 7121)
    assert not cracked.is_closed
    row = int(np.flatnonzero(cracked.facet_cell_counts == 1)[0])
    a, b = cracked.facets[row]
    (cell,) = np.flatnonzero((cracked.cell_facets == row).any(axis=1))
    # A sliver on an open edge, next to its end.
    points = np.vstack(
        [cracked.points, cracked.points[a] + 1e-8 * (cracked.points[b] - cracked.points[a])]
    )
    old, new = cracked.cells[cell], cracked.n_points
    cells = [
        *np.delete(cracked.cells, cell, axis=0),
        np.where(old == a, new, old),
        np.where(old == b, new, old),
    ]
    repaired = repair_mesh(SimplexMesh(points, cells)).mesh
    assert repaired.is_closed
    assert repaired.n_points == 200


def test_a_slit_in_tetrahedra_stays_open():
    cells = np.concatenate([CUBE.cells, CUBE.cells + CUBE.n_points])
    points = np.concatenate([CUBE.points, CUBE.points + np.eye(3)[0]])
    assert repair_mesh(SimplexMesh(points, cells)).mesh.n_points == 2 * CUBE.n_points


def test_inverted_cells_are_turned_and_unused_nodes_dropped():
    points = np.concatenate([CUBE.points, [[5.0, 5.0, 5.0]]])
    repaired = repair_mesh(SimplexMesh(points, CUBE.cells[:, [1, 0, 2, 3]])).mesh
    assert (repaired.signed_measures > 0.0).all()
    assert repaired.n_points == CUBE.n_points


def test_a_first_volume_larger_than_the_surface_is_reported_or_refused():
    inner = replace(as_problem("tetrahedra", CUBE, 1e-3), size=lambda x: np.full(len(x), 0.1))
    expected = predict(CUBE, inner.size, backend="mmg").cells  # about 10 000
    assert number_note(inner, expected, 1000) == ""
    text = r"elements instead of the predicted 1000: the mesh fills more than the surface"
    assert re.search(text, number_note(inner, 1000, 1e6))
    with pytest.raises(TooManyElementsError, match=f"{text}.* raise max_elements = 1000"):
        number_note(inner, 1000, 1000)
