"""Controlling sources on parts of a mesh are those of one process, where no two allow the same."""

import domains
import numpy as np
import pytest
from meshes import jittered_cube, jittered_square, slit_square, structured_square
from partitions import SIZE, bounds, on_ranks, partition

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact


def renumbered(mesh, seed):
    """Return a mesh whose nodes, but the first, are in random order."""
    order = np.append(0, 1 + np.random.default_rng(seed).permutation(mesh.n_points - 1))
    return SimplexMesh(mesh.points[order], np.argsort(order)[mesh.cells])


SQUARE = jittered_square(7, 890)
DOMAINS = {
    "square": SQUARE,
    "cube": jittered_cube(3, 891),
    "slit": renumbered(slit_square(6), 892),
    "wall": domains.wall_box(100, seed=893)[0],
    "interval": SimplexMesh([[0.0], [3.0], [1.0], [2.1]], [[0, 2], [2, 3], [3, 1]]),
    "two": SimplexMesh(  # and a node in no cell
        np.concatenate([SQUARE.points, [[500.0, 0.0]], SQUARE.points + np.array([200.0, 0.0])]),
        np.concatenate([SQUARE.cells, SQUARE.cells + SQUARE.n_points + 1]),
    ),
}


def assert_equal_to_serial(mesh, h0, rank_of, g=0.3, **options):
    _, info = limit_gradient.with_info(mesh, h0, g, **options)
    expected, expected_roots = info.sources, info.sources.roots()

    def work(part):
        _, own = limit_gradient.with_info(part, h0[part.global_ids], g, **options)
        return own.sources, own.sources.roots()

    results, parts = on_ranks(mesh, rank_of, SIZE, work)
    for (sources, roots), part in zip(results, parts, strict=True):
        ids = part.global_ids
        np.testing.assert_array_equal(sources.nodes, expected.nodes[ids])
        np.testing.assert_array_equal(roots, expected_roots[ids])
        bends = np.full((len(ids), mesh.dim), np.nan)
        if len(expected.bends):
            bends = expected.bends[ids]
        np.testing.assert_array_equal(sources.bends if len(sources.bends) else bends, bends)
    return expected, expected_roots


@pytest.mark.usefixtures("nothing_is_collected")
@pytest.mark.parametrize("kind", ["corner", "noise"])
@pytest.mark.parametrize("name", DOMAINS)
def test_equal_to_serial_for_every_partition(name, kind):
    mesh, rng = DOMAINS[name], np.random.default_rng(894)
    h0 = bounds(mesh, kind, rng)
    # In solids that are not convex, edges and their nodes often allow the same.
    for parts, linear in (("random", name != "wall"), ("single cells", False)):
        rank_of = partition(mesh, parts, SIZE, rng)
        found, roots = assert_equal_to_serial(mesh, h0, rank_of, method=Exact(linear))
        if kind == "corner":  # one bound, at node 0
            assert set(roots.tolist()) - {-1} == {0}
            assert np.isfinite(found.bends).any() == (name in ("slit", "wall"))
            assert (roots == -1).any() == (name == "two")


@pytest.mark.usefixtures("nothing_is_collected")
@pytest.mark.parametrize("name", ["slit", "wall", "interval"])
def test_sources_between_the_nodes(name):
    mesh, rng = DOMAINS[name], np.random.default_rng(895)
    inside = mesh.points[mesh.cells[:3]].mean(axis=1)
    points = np.concatenate([[np.full(mesh.dim, 9e3)], inside])
    h0 = bounds(mesh, "some", rng)
    rank_of = partition(mesh, "random", SIZE, rng)
    for g in (0.3, lambda h: 0.1 + 0.3 * h / (1.0 + h)):
        given = {"point_sources": (points, np.full(4, 1e-3)), "method": Exact(False)}
        _, roots = assert_equal_to_serial(mesh, h0, rank_of, g, **given)
        assert roots.max() > mesh.n_points  # the first one is outside


def test_collected_meshes_and_marching():
    square = structured_square(3)
    flat = SimplexMesh(square.points, np.concatenate([square.cells, [[0, 4, 8]]]))
    rng = np.random.default_rng(896)
    h0 = bounds(flat, "noise", rng)
    assert_equal_to_serial(flat, h0, partition(flat, "random", SIZE, rng))

    def work(part):
        return limit_gradient.with_info(part, 1.0, 0.3, method="fast-marching")[1].sources

    assert on_ranks(square, None, SIZE, work)[0] == [None] * SIZE
