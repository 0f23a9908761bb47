"""Cells side by side that are not connected, and cells twice: what is reported, and where."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, random_square, slit_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import SimplexMesh, check_mesh, read, remesh, write
from adaptsize.errors import InputWarning
from adaptsize.quality.connections import repeated_cells, unconnected


def mesh_of(dim, seed):
    return random_square(30, seed) if dim == 2 else jittered_cube(3, seed)


def parted(mesh, part):
    """Give each part nodes of its own."""
    keys = np.stack([mesh.cells, np.broadcast_to(part[:, None], mesh.cells.shape)], axis=-1)
    nodes, cells = np.unique(keys.reshape(-1, 2), axis=0, return_inverse=True)
    return SimplexMesh(mesh.points[nodes[:, 0]], cells.reshape(mesh.cells.shape))


def changed(mesh, rng):
    """The same mesh turned, scaled and shifted, with its nodes and cells in another order."""
    turn = np.linalg.qr(rng.standard_normal((mesh.dim, mesh.dim)))[0]
    points = 10.0 ** rng.uniform(-3, 3) * (mesh.points @ turn + rng.standard_normal(mesh.dim))
    order = rng.permutation(mesh.n_points)
    cells = np.argsort(order)[mesh.cells][rng.permutation(mesh.n_cells)]
    return SimplexMesh(points[order], cells), points


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_parts_are_counted_and_slits_are_not_parts(seed, dim):
    rng = np.random.default_rng(seed)
    whole = mesh_of(dim, seed)
    assert unconnected(whole) == []
    side = (whole.points[whole.cells].mean(axis=1)[:, 0] > 0.5).astype(int)
    apart = parted(whole, side)
    between = (len(apart.boundary().mesh.cells) - len(whole.boundary().mesh.cells)) // 2
    moved, _ = changed(apart, rng)
    (found,) = unconnected(moved)
    assert (found.kind, found.number) == ("parts", between)
    ends = moved.points[moved.facets].mean(axis=1)
    assert np.linalg.norm(ends - found.place, axis=1).min() <= 1e-9 * moved.diagonal
    slit = changed(slit_square(4), rng)[0]
    assert [one.kind for one in unconnected(slit)] == ["slits"]


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_cells_around_some_nodes_with_own_nodes_are_no_slits(seed, dim):
    mesh, rng = mesh_of(dim, seed), np.random.default_rng(seed)
    inside = np.flatnonzero(~np.isin(np.arange(mesh.n_points), mesh.boundary().nodes))
    if not len(inside):
        return
    node = rng.choice(inside)
    cells, points = mesh.cells.copy(), [*mesh.points]
    for cell in np.flatnonzero((cells == node).any(axis=1)):
        cells[cell][cells[cell] == node] = len(points)
        points.append(mesh.points[node])
    split, _ = changed(SimplexMesh(points, cells), rng)
    used = SimplexMesh(split.points, split.cells)
    assert [one.kind for one in unconnected(used)] == ["parts"]


@pytest.mark.parametrize("dim", [2, 3])
def test_coordinates_that_differ_by_rounding_are_one_place(dim):
    mesh = mesh_of(dim, 81)
    apart = parted(mesh, (np.arange(mesh.n_cells) < 5).astype(int))
    noise = 1e-16 * np.random.default_rng(82).standard_normal(apart.points.shape)
    exact, near = unconnected(apart), unconnected(apart.moved(apart.points + noise))
    assert exact[0].number == near[0].number > 0


def test_reading_checking_and_remeshing_say_the_same(tmp_path):
    pytest.importorskip("mmgpy")
    mesh = random_square(30, 83)
    apart = parted(mesh, (mesh.points[mesh.cells].mean(axis=1)[:, 1] > 0.4).astype(int))
    (found,) = unconnected(apart)
    text = str(found)
    write(tmp_path / "a.vtu", apart)
    with pytest.warns(InputWarning) as caught:
        assert read(tmp_path / "a.vtu").n_points == apart.n_points
    assert text in str(caught[0].message)
    assert read(tmp_path / "a.vtu", keep_slits=True).n_points == apart.n_points  # no warning
    assert text in check_mesh(apart).notes
    with pytest.warns(InputWarning) as caught:
        remesh(apart, 0.3)
    assert any(text in str(one.message) for one in caught)


@pytest.mark.parametrize("dim", [2, 3])
def test_cells_twice_are_refused_with_their_place(dim):
    mesh = mesh_of(dim, 84)
    again = np.roll(mesh.cells[[4, 2]], 1, axis=1)
    twice = SimplexMesh(mesh.points, np.vstack([mesh.cells, again]))
    assert_array_equal(repeated_cells(twice), [[mesh.n_cells, 4], [mesh.n_cells + 1, 2]])
    check = check_mesh(twice, n_places=100)
    (cells,) = (one for one in check.failures if one.name == "cells")
    assert "2 with the nodes of another" in cells.text
    places = np.array([place.point for place in cells.places])[:, None]
    centroids = mesh.points[mesh.cells[[2, 4]]].mean(axis=1)
    assert_allclose(np.linalg.norm(places - centroids, axis=2).min(axis=0), 0.0, atol=1e-12)
    message = rf"each cell once, got 2 with .*: cells\[{mesh.n_cells}\] is cells\[4\] again, at \("
    with pytest.raises(ValueError, match=message):
        remesh(twice, 0.5)


@pytest.mark.parametrize("seed", range(3))
def test_nodes_in_the_middle_of_edges_are_found_at_their_places(seed):
    # Two triangles on the left, and on the right three around the middle of the common side.
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1], [1, 0.5]], float)
    cells = [[0, 1, 2], [0, 2, 3], [1, 4, 6], [6, 4, 5], [6, 5, 2]]
    order = np.random.default_rng(3114 + seed).permutation(len(points))
    number = np.argsort(order)
    (found,) = unconnected(SimplexMesh(points[order], number[np.array(cells)]))
    assert (found.kind, found.number, found.place.tolist()) == ("hanging", 1, [1.0, 0.5])
