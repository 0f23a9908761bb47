"""Ranks find out together whether a solid is convex, without the boundary of the whole."""

import numpy as np
import pytest
from meshes import jittered_cube
from partitions import KINDS, SIZE, on_ranks, partition
from solids_of_cubes import solid_of_cubes

from adaptsize import CartesianGrid, SimplexMesh, limit_gradient
from adaptsize.geometry.boundary import flat_boundary
from adaptsize.geometry.convexity import is_convex
from adaptsize.limiting import Exact
from adaptsize.limiting.exact import boundary_of_parts
from adaptsize.limiting.exact.boundary_of_parts import find_skeleton
from adaptsize.limiting.exact.components import piece_of


def cube():
    return CartesianGrid([0.0] * 3, 0.25, (5, 5, 5)).mesh


def dented(depth):
    """Return a cube with a node in the middle of a side that lies deeper."""
    mesh = cube()
    points = mesh.points.copy()
    points[np.argmin(np.abs(points - [0.5, 0.5, 1.0]).sum(axis=1)), 2] -= depth
    return mesh.moved(points)


def just_convex():
    """Return the deepest dent of a cube that counts as convex, and the next one."""
    low, high = 1e-9, 1e-5
    while np.nextafter(low, high) < high:
        middle = 0.5 * (low + high)
        mesh = dented(middle)
        low, high = (middle, high) if is_convex_alone(mesh) else (low, middle)
        if high - low < 1e-15:  # far below the rounding of coordinates
            break
    return dented(low), dented(high)


def is_convex_alone(mesh):
    return is_convex(mesh.points, flat_boundary(mesh))


def with_cavity():
    """Return a cube without its middle."""
    return solid_of_cubes(lambda x: np.abs(x - 1.5).max(axis=1) > 0.6, (3, 3, 3), 1)


def at_an_edge():
    """Return two cubes with one common edge."""
    return solid_of_cubes(lambda x: (x[:, 0] > 1.0) == (x[:, 1] > 1.0), (2, 2, 1), 1)


def of_parts(mesh, rank_of):
    """Return what the ranks find of the boundary."""
    return on_ranks(mesh, rank_of, SIZE, lambda part: find_skeleton(piece_of(part, 0), 1))[0]


SOLIDS = {
    "cube": cube,
    "cells of any shape": lambda: jittered_cube(5, 3811),
    "just convex": lambda: just_convex()[0],
    "hardly not convex": lambda: just_convex()[1],
    "dent": lambda: dented(0.1),
    "without a corner": lambda: solid_of_cubes(lambda x: (x < 1.0).any(axis=1), (2, 2, 2), 1),
    "cavity": with_cavity,
    "at an edge": at_an_edge,
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SOLIDS)
def test_parts_find_a_solid_convex_if_the_whole_is(name, kind):
    mesh = SOLIDS[name]()
    expected = is_convex_alone(mesh)
    assert expected == (name in ("cube", "cells of any shape", "just convex"))
    rng = np.random.default_rng(3812)
    whole = flat_boundary(mesh)
    for skeleton in of_parts(mesh, partition(mesh, kind, SIZE, rng)):
        assert skeleton.convex == expected
        assert skeleton.diagonal == np.linalg.norm(np.ptp(mesh.points, axis=0))
        if expected:  # no rank has the boundary of the whole
            assert len(skeleton.boundary.facets) == 0
        else:
            np.testing.assert_array_equal(skeleton.ids[skeleton.boundary.facets], whole.facets)


def test_facets_between_parts_are_not_listed(monkeypatch):
    """The sums at nodes between parts are those of the whole: 0 inside."""
    mesh = cube()
    counts = []

    def counted(piece, facets, statuses=boundary_of_parts._statuses):
        counts.append(len(facets))
        return statuses(piece, facets)

    monkeypatch.setattr(boundary_of_parts, "_statuses", counted)
    middle = mesh.points[mesh.cells].mean(axis=1)
    of_parts(mesh, (middle[:, 0] * SIZE).astype(int))
    assert len(counts) == SIZE
    # All nodes of a slab in the middle are shared.  It has 32 facets on the sides of the cube, and
    # as many on both of its own.
    assert max(counts) == 32


def test_few_bounds_go_to_all_ranks_without_boxes():
    mesh = jittered_cube(8, 3813)
    h0 = np.full(mesh.n_points, np.inf)
    h0[:2] = 0.01
    exact = Exact(face_sources=False)
    whole = limit_gradient(mesh, h0, 0.3, method=exact)

    def work(part):
        found = limit_gradient(part, h0[part.global_ids], 0.3, method=exact)
        before = part.ranks.traffic.exchanges
        again = limit_gradient(part, h0[part.global_ids], 0.3, method=exact)
        np.testing.assert_array_equal(again, found)
        np.testing.assert_array_equal(found, whole[part.global_ids])
        return part.ranks.traffic.exchanges - before

    assert set(on_ranks(mesh, None, SIZE, work)[0]) == {0}


def test_a_slab_with_a_thin_cell_is_still_collected():
    """Cells without measure on one rank concern all."""
    mesh = cube()
    flat = np.array([[0, 1, 2, 3]])  # on one line
    mesh = SimplexMesh(mesh.points, np.concatenate([mesh.cells, flat]))
    assert of_parts(mesh, None) == [None] * SIZE
