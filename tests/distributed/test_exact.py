"""The exact method on parts of a mesh equals that on the whole, bit by bit."""

import domains
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, random_square, slit_square, structured_square
from partitions import (
    BOUNDS,
    KINDS,
    SIZE,
    assert_equal_to_serial,
    bounds,
    on_ranks,
    partition,
)
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

CONVEX = {
    "jittered square": jittered_square(8, 821),
    "structured square": structured_square(6),
    "random square": random_square(60, 822),
    "cube": jittered_cube(4, 823),
}
IN_THE_PLANE = {
    "slit": slit_square(6),
    "stars": domains.star_holes(10, seed=824)[0],
    "blocks": domains.blocks(10, seed=825)[0],
    "holes": domains.holes(14, 3, 6, seed=826)[0],
}


@pytest.mark.usefixtures("nothing_is_collected")
@pytest.mark.parametrize("face_sources", [True, False])
@pytest.mark.parametrize("kind", BOUNDS)
@pytest.mark.parametrize("domain", [*CONVEX, *IN_THE_PLANE])
def test_equal_to_serial_for_every_partition(domain, kind, face_sources):
    mesh = (CONVEX | IN_THE_PLANE)[domain]
    rng = np.random.default_rng(830)
    h0 = bounds(mesh, kind, rng)
    for parts in KINDS:
        rank_of = partition(mesh, parts, SIZE, rng)
        assert_equal_to_serial(mesh, h0, 0.3, rank_of, method=Exact(face_sources))


@given(data=st.data())
@settings(deadline=None, max_examples=12)
def test_equal_to_serial_for_drawn_problems(data):
    seed = data.draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    if data.draw(st.booleans()):
        mesh = random_square(data.draw(st.integers(5, 40)), seed)
    else:
        mesh, _ = domains.with_removed_cells(jittered_square(7, seed), seed, 6)
    h0 = bounds(mesh, data.draw(st.sampled_from(BOUNDS)), rng)
    rank_of = partition(mesh, data.draw(st.sampled_from(KINDS)), SIZE, rng)
    g = data.draw(st.sampled_from([0.0, 0.05, 0.3, 2.0]))
    assert_equal_to_serial(mesh, h0, g, rank_of, method=Exact(data.draw(st.booleans())))


def test_number_of_exchanges_and_bytes():
    """One exchange of sources; one more between neighbours if bounds are linear on cells.

    The first call finds the boundary, in six more.
    """
    mesh = jittered_square(20, 840)
    rng = np.random.default_rng(841)
    for kind, linear, expected in [("two", True, 1), ("noise", True, 2), ("noise", False, 1)]:
        h0 = bounds(mesh, kind, rng)

        def work(part, h0=h0, linear=linear):
            counts = []
            for _ in range(2):
                before = part.ranks.traffic.exchanges, part.ranks.traffic.bytes_sent
                limit_gradient(part, h0[part.global_ids], 0.3, method=Exact(linear))
                now = part.ranks.traffic.exchanges, part.ranks.traffic.bytes_sent
                counts.append((now[0] - before[0], now[1] - before[1]))
            return counts[0][0] - counts[1][0], *counts[1]

        results, _ = on_ranks(mesh, None, SIZE, work)
        assert {counts[:2] for counts in results} == {(6, expected)}
        if kind == "two":  # each source, six numbers, goes to at most all others
            assert sum(n_bytes for _, _, n_bytes in results) <= 2 * (SIZE - 1) * 6 * 8


@pytest.mark.usefixtures("nothing_is_collected")
def test_components_and_nodes_in_no_cell():
    one, two = jittered_square(5, 850), jittered_square(4, 851)
    lonely = [[500.0, 0.0]]
    points = np.concatenate([one.points, lonely, two.points + np.array([200.0, 0.0])])
    cells = np.concatenate([one.cells, two.cells + one.n_points + 1])
    mesh = SimplexMesh(points, cells)
    rng = np.random.default_rng(852)
    for kind in ("two", "noise", "corner"):
        h0 = bounds(mesh, kind, rng)
        h0[one.n_points] = 1e-3
        for parts in KINDS:
            assert_equal_to_serial(mesh, h0, 0.3, partition(mesh, parts, SIZE, rng))


@pytest.mark.usefixtures("nothing_is_collected")
@pytest.mark.parametrize("kind", ["two", "some", "noise", "limited", "corner"])
def test_segments_on_a_line(kind):
    """Two intervals, one of them folded, and a node in no cell."""
    rng = np.random.default_rng(853)
    points = np.concatenate([rng.permutation(30) / 7.0, [9.0], 10.0 + rng.random(5)])[:, None]
    order = np.argsort(points[:30, 0])
    cells = np.concatenate([np.column_stack([order[:-1], order[1:]]), [[31, 32], [32, 33]]])
    mesh = SimplexMesh(points, np.concatenate([cells, [[33, 34], [34, 35]]]))
    h0 = bounds(mesh, kind, rng)
    for parts in KINDS:
        assert_equal_to_serial(mesh, h0, 0.3, partition(mesh, parts, SIZE, rng))


def test_degenerate_meshes_are_collected():
    square = structured_square(3)
    flat = SimplexMesh(square.points, np.concatenate([square.cells, [[0, 4, 8]]]))
    doubled = SimplexMesh(square.points, np.concatenate([square.cells, square.cells[:4]]))
    rng = np.random.default_rng(860)
    for mesh in (flat, doubled):
        h0 = np.where(rng.random(mesh.n_points) < 0.5, rng.uniform(0.1, 1.0, mesh.n_points), np.inf)
        assert_equal_to_serial(mesh, h0, 0.2, partition(mesh, "random", SIZE, rng))


@pytest.mark.parametrize("shift", [0.0, 1e-13, 1e-11])
def test_cells_of_nearly_no_measure(shift):
    """A Delaunay mesh of a lattice: a fifth of its cells are flat, or nearly so between parts."""
    rng = np.random.default_rng(861)
    lattice = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
    points = lattice + shift * rng.uniform(-1.0, 1.0, lattice.shape)
    mesh = SimplexMesh(points, Delaunay(points).simplices)
    h0 = bounds(mesh, "noise", rng)
    for kind in ("random", "strips"):
        assert_equal_to_serial(mesh, h0, 0.3, partition(mesh, kind, SIZE, rng))


@pytest.mark.usefixtures("nothing_is_collected")
def test_limit_that_depends_on_the_size():
    mesh = CONVEX["jittered square"]
    rng = np.random.default_rng(863)
    h0 = bounds(mesh, "some", rng)

    def of_size(h):
        return 0.1 + 0.3 * h / (1.0 + h)

    assert_equal_to_serial(mesh, h0, of_size, partition(mesh, "random", SIZE, rng))
    assert_equal_to_serial(mesh, h0, (0.5, of_size), partition(mesh, "some empty", SIZE, rng))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"h0": -1.0}, "^rank 2: h0 must be positive"),
        ({"h0": np.nan}, "^rank 2: h0 must be positive"),
        ({"g": -0.1}, "^rank 2: g must be finite and >= 0"),
        ({"g": 0.5}, "^g must be the same on all ranks"),
        ({"method": "slow"}, "^rank 2: method must be"),
        ({"method": "fast-marching"}, "^method must be the same on all ranks"),
        ({"g": [[0.3], [0.3, 0.3]]}, "^rank 2: g must"),
        ({"h0": np.inf}, None),
    ],
)
def test_bad_input_on_one_rank_is_reported_by_all(change, message):
    mesh = CONVEX["structured square"]

    def work(part):
        options = {"h0": np.ones(part.n_points), "g": 0.3}
        options |= change if part.ranks.rank == 2 else {}
        if message is None:
            return limit_gradient(part, **options)
        with pytest.raises(ValueError, match=message):
            limit_gradient(part, **options)

    on_ranks(mesh, None, SIZE, work)


def test_no_bound_at_all_and_wrong_methods():
    mesh = CONVEX["structured square"]

    def work(part):
        with pytest.raises(ValueError, match="h0 must be finite at one node at least"):
            limit_gradient(part, np.inf, 0.3)
        with pytest.raises(ValueError, match="needs a flat domain of full dimension and one"):
            limit_gradient(part, 1.0, np.full(part.n_points, 0.3), method="exact")

    on_ranks(mesh, None, SIZE, work)
