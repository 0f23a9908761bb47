"""The exact method in parts of solids that are not convex equals that in the whole, bit by bit."""

import domains
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube
from partitions import BOUNDS, KINDS, SIZE, assert_equal_to_serial, bounds, on_ranks, partition
from solids_of_cubes import solid_of_cubes

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

pytestmark = pytest.mark.usefixtures("nothing_is_collected")


def square_ring(seed):
    """Return a frame of unit cubes whose nodes are at integers, so that many sizes are equal."""
    around = solid_of_cubes(lambda x: np.abs(x[:, :2] - 2.5).max(axis=1) > 1.0, (5, 5, 2), seed)
    return SimplexMesh(np.round(around.points), around.cells)


def without_some_cells(seed):
    """Return a cube without a fifth of its cells: pinched edges and nodes, several components."""
    cube = jittered_cube(5, seed)
    cells = cube.cells[np.random.default_rng(seed).random(cube.n_cells) < 0.8]
    used, cells = np.unique(cells, return_inverse=True)
    return SimplexMesh(cube.points[used], cells.reshape(-1, 4))


SOLIDS = {
    "wall": domains.wall_box(200, seed=871)[0],
    "window": domains.window_box(250, seed=872)[0],
    "ring": square_ring(873),
    "holes": without_some_cells(874),
}


@pytest.mark.parametrize("kind", BOUNDS)
@pytest.mark.parametrize("domain", SOLIDS)
def test_equal_to_serial_for_every_partition(domain, kind):
    mesh, rng = SOLIDS[domain], np.random.default_rng(875)
    h0 = bounds(mesh, kind, rng)
    for number, parts in enumerate(KINDS[1:]):
        rank_of = partition(mesh, parts, SIZE, rng)
        assert_equal_to_serial(mesh, h0, 0.3, rank_of, method=Exact(number % 2 == 0))


@given(data=st.data())
@settings(deadline=None, max_examples=8)
def test_equal_to_serial_for_drawn_problems(data):
    seed = data.draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    make = data.draw(st.sampled_from([square_ring, without_some_cells]))
    mesh = make(seed)
    h0 = bounds(mesh, data.draw(st.sampled_from(BOUNDS)), rng)
    if data.draw(st.booleans()):  # sources that allow the same sizes
        h0 = 1.0 + np.round(h0 / mesh.diagonal, 1) * mesh.diagonal
    g = data.draw(st.sampled_from([0.0, 0.05, 0.3, 2.0]))
    rank_of = partition(mesh, data.draw(st.sampled_from(KINDS)), SIZE, rng)
    assert_equal_to_serial(mesh, h0, g, rank_of, method=Exact(data.draw(st.booleans())))


def test_sources_that_see_nothing_of_each_other_meet_at_reflex_edges():
    """Two equal bounds on either side of the ring: every path around it has a twin."""
    mesh = SOLIDS["ring"]
    at = [np.flatnonzero((mesh.points == place).all(axis=1))[0] for place in ([0, 0, 1], [5, 5, 1])]
    h0 = np.full(mesh.n_points, np.inf)
    h0[at] = 1.0
    h = limit_gradient(mesh, h0, 0.3)
    opposite = [np.flatnonzero((mesh.points == p).all(axis=1))[0] for p in ([0, 5, 1], [5, 0, 1])]
    assert h[opposite] == pytest.approx(1.0 + 0.3 * 5.0)
    for seed in range(3):
        rank_of = partition(mesh, "random", SIZE, np.random.default_rng(seed))
        assert_equal_to_serial(mesh, h0, 0.3, rank_of)


def test_limit_that_depends_on_the_size():
    mesh, rng = SOLIDS["wall"], np.random.default_rng(876)
    h0 = bounds(mesh, "some", rng)
    rank_of = partition(mesh, "strips", SIZE, rng)
    assert_equal_to_serial(mesh, h0, lambda h: 0.1 + 0.3 * h / (1.0 + h), rank_of)


def test_number_of_exchanges_in_a_frame_of_four_strips():
    mesh, rng = SOLIDS["ring"], np.random.default_rng(879)
    x = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    strips = np.minimum((SIZE * x / 5.0).astype(int), SIZE - 1)
    for kind in BOUNDS:
        h0 = bounds(mesh, kind, rng)

        def work(part, h0=h0):
            limit_gradient(part, h0[part.global_ids], 0.3)
            before = part.ranks.traffic.exchanges
            limit_gradient(part, h0[part.global_ids], 0.3)
            return part.ranks.traffic.exchanges - before

        assert all(2 <= count <= 10 for count in on_ranks(mesh, strips, SIZE, work)[0])


def test_number_of_exchanges_and_bytes():
    """One exchange of sources, and some of sizes that grow along edges; three more if linear.

    The boundary with the cells at it is sent once, and far less later.
    """
    mesh, rng = domains.wall_box(1200, seed=877)[0], np.random.default_rng(878)
    for kind, linear, least in [("two", True, 1), ("noise", False, 2), ("noise", True, 4)]:
        h0 = bounds(mesh, kind, rng)

        def work(part, h0=h0, linear=linear):
            counts = []
            for _ in range(2):
                traffic = part.ranks.traffic
                before = (traffic.exchanges, traffic.bytes_sent + traffic.bytes_gathered)
                limit_gradient(part, h0[part.global_ids], 0.3, method=Exact(linear))
                sent = traffic.bytes_sent + traffic.bytes_gathered - before[1]
                counts.append((traffic.exchanges - before[0], sent))
            return counts

        results, _ = on_ranks(mesh, None, SIZE, work)
        again = {exchanges for _, (exchanges, _) in results}
        assert len(again) == 1
        assert least <= again.pop() <= least + 2 * 5
        first, second = (sum(counts[call][1] for counts in results) for call in (0, 1))
        if kind == "two":
            assert second < 0.1 * first
