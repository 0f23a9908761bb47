"""`point_sources` and `with_info` on parts of a mesh: sizes and figures of the whole."""

import domains
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, random_sphere, structured_square
from partitions import BOUNDS, KINDS, SIZE, bounds, on_ranks, partition
from simulated_ranks import SimulatedCommunicator

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact
from adaptsize.limiting.in_parts.info import _order_statistics


def beside_each_other():
    """Return two squares that touch without common nodes, and a node in no cell."""
    one, two = structured_square(4), structured_square(6)
    points = np.concatenate([one.points, [[500.0, 0.0]], two.points + np.array([100.0, 0.0])])
    return SimplexMesh(points, np.concatenate([one.cells, two.cells + one.n_points + 1]))


def interval():
    points = np.random.default_rng(813).random(20)[:, None]
    order = np.argsort(points[:, 0])
    return SimplexMesh(points, np.column_stack([order[:-1], order[1:]]))


FLAT = {
    "square": jittered_square(7, 814),
    "cube": jittered_cube(4, 815),
    "stars": domains.star_holes(10, seed=816)[0],
    "wall": domains.wall_box(200, seed=817)[0],
    "squares": beside_each_other(),
    "interval": interval(),
}
FIGURES = ["method", "converged", "n_changed", "n_free", "residual", "largest_edge_slope"]
FIGURES += ["cell_gradient_quantiles", "n_proved", "largest_gap"]


def between_nodes(mesh, rng):
    """Return points at nodes, on edges, in cells and outside, and bounds there."""
    used = mesh.cells[rng.integers(0, mesh.n_cells, 6)]
    weights = np.zeros(used.shape)
    weights[:2, 0] = 1.0
    weights[2:4, :2] = 0.5
    weights[4:] = rng.dirichlet(np.ones(used.shape[1]), 2)
    points = np.einsum("iv,ivd->id", weights, mesh.points[used])
    sizes = mesh.diagonal * rng.uniform(0.005, 0.1, 8)
    sizes[5] = np.inf
    return np.concatenate([points, points[:1] + 900.0, points[:1]]), sizes


def assert_equal_to_serial(mesh, h0, rank_of, g=0.3, **options):
    whole, expected = limit_gradient.with_info(mesh, h0, g, **options)

    def work(part):
        return limit_gradient.with_info(part, h0[part.global_ids], g, **options)

    results, parts = on_ranks(mesh, rank_of, SIZE, work)
    for (h, info), part in zip(results, parts, strict=True):
        np.testing.assert_array_equal(h, whole[part.global_ids])
        assert info == results[0][1]
    for name in FIGURES:
        assert getattr(info, name) == getattr(expected, name), name
    assert str(info) in repr(expected)
    return info


@pytest.mark.usefixtures("nothing_is_collected")
@pytest.mark.parametrize("kind", ["none", "some", "noise"])
@pytest.mark.parametrize("name", FLAT)
def test_equal_to_serial_for_every_partition(name, kind):
    mesh, rng = FLAT[name], np.random.default_rng(818)
    h0 = np.full(mesh.n_points, np.inf) if kind == "none" else bounds(mesh, kind, rng)
    for number, parts in enumerate(KINDS[1:]):
        points = between_nodes(mesh, rng) if kind == "none" or number % 2 else None
        rank_of = partition(mesh, parts, SIZE, rng)
        options = {"point_sources": points, "method": Exact(number < 2)}
        assert_equal_to_serial(mesh, h0, rank_of, **options)


@pytest.mark.usefixtures("nothing_is_collected")
@given(data=st.data())
@settings(deadline=None, max_examples=15)
def test_equal_to_serial_for_drawn_problems(data):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    mesh = FLAT[data.draw(st.sampled_from(list(FLAT)))]
    kinds = [kind for kind in BOUNDS if kind != "smooth"]
    h0 = bounds(mesh, data.draw(st.sampled_from(kinds)), rng)
    rank_of = partition(mesh, data.draw(st.sampled_from(KINDS)), SIZE, rng)
    assert_equal_to_serial(
        mesh,
        h0,
        rank_of,
        data.draw(st.sampled_from([0.0, 0.05, 0.3, 2.0, lambda h: 0.1 + 0.3 * h / (1.0 + h)])),
        point_sources=between_nodes(mesh, rng),
        method=Exact(data.draw(st.booleans())),
    )


def test_points_between_components_act_in_both():
    mesh = FLAT["squares"]
    h0 = np.full(mesh.n_points, np.inf)
    info = assert_equal_to_serial(mesh, h0, None, point_sources=([[50.0, 5.0]], [1.0]))
    assert info.n_free == 1  # the node in no cell


def test_sizes_in_a_solid_that_are_not_proved():
    mesh, rng = FLAT["wall"], np.random.default_rng(819)
    h0 = bounds(mesh, "corner", rng)
    info = assert_equal_to_serial(mesh, h0, partition(mesh, "random", SIZE, rng))
    assert 0 < info.n_proved < mesh.n_points
    assert info.largest_gap > 0.0


def test_marching_and_collected_meshes():
    """Marching agrees to rounding; cells without measure are collected."""
    square, sphere = FLAT["square"], random_sphere(60, 820)
    rng = np.random.default_rng(821)
    for mesh in (square, sphere):
        h0 = bounds(mesh, "some", rng)
        options = {"method": "fast-marching"}
        whole, expected = limit_gradient.with_info(mesh, h0, 0.3, **options)

        def work(part, h0=h0, options=options):
            return limit_gradient.with_info(part, h0[part.global_ids], 0.3, **options)

        results, parts = on_ranks(mesh, partition(mesh, "strips", SIZE, rng), SIZE, work)
        for (h, info), part in zip(results, parts, strict=True):
            np.testing.assert_allclose(h, whole[part.global_ids], rtol=1e-12)
            assert info == results[0][1]
        assert (info.n_proved, info.largest_gap, info.n_free) == (None, None, 0)
        assert info.n_changed == pytest.approx(expected.n_changed, abs=3)
        assert abs(info.residual) < 1e-12
        assert info.largest_edge_slope == pytest.approx(expected.largest_edge_slope)
        assert info.cell_gradient_quantiles == pytest.approx(expected.cell_gradient_quantiles)
    square = structured_square(3)
    flat = SimplexMesh(square.points, np.concatenate([square.cells, [[0, 4, 8]]]))
    h0, points = bounds(flat, "two", rng), between_nodes(square, rng)
    for point_sources in (None, points):
        assert_equal_to_serial(
            flat, h0, partition(flat, "random", SIZE, rng), point_sources=point_sources
        )


def test_points_are_not_exchanged_and_figures_take_ten_reductions():
    mesh, rng = FLAT["square"], np.random.default_rng(822)
    h0, points = np.full(mesh.n_points, np.inf), between_nodes(mesh, rng)

    def work(part):
        traffic, counts = part.ranks.traffic, []
        for full in (False, False, True):
            before = traffic.exchanges, traffic.bytes_sent, traffic.reductions
            limit = limit_gradient.with_info if full else limit_gradient
            limit(part, h0[part.global_ids], 0.3, point_sources=points)
            after = traffic.exchanges, traffic.bytes_sent, traffic.reductions
            counts.append(np.subtract(after, before))
        return [*counts[2][:2].tolist(), int(counts[2][2] - counts[1][2])]

    assert on_ranks(mesh, None, SIZE, work)[0] == [[1, 0, 10]] * SIZE


@given(data=st.data())
def test_order_statistics_are_those_of_all_values(data):
    numbers = st.floats(0.0, np.inf) | st.sampled_from([0.0, 1.0, 1.0 + 2.0**-52])
    values = [np.array(data.draw(st.lists(numbers, max_size=9))) for _ in range(3)]
    every = np.concatenate([*values, [0.5]])
    values[1] = np.append(values[1], 0.5)
    places = [0, len(every) // 2, len(every) - 1]
    found = SimulatedCommunicator.run(
        3, lambda comm: _order_statistics(comm, values[comm.rank], places)
    )
    assert found == [np.sort(every)[places].tolist()] * 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"point_sources": ([[0.0, 0.0]], [2.0])}, "^point_sources must be the same on all ranks"),
        ({"point_sources": [[0.0, 0.0]]}, "^rank 2: point_sources must be a pair"),
    ],
)
def test_bad_input_on_one_rank_is_reported_by_all(change, message):
    def work(part):
        options = {"point_sources": ([[0.0, 0.0]], [1.0])}
        options |= change if part.ranks.rank == 2 else {}
        with pytest.raises(ValueError, match=message):
            limit_gradient(part, 1.0, 0.3, **options)

    on_ranks(FLAT["square"], None, SIZE, work)


def test_the_info_is_for_all_ranks_or_for_none():
    def work(part):
        limit = limit_gradient if part.ranks.rank else limit_gradient.with_info
        with pytest.raises(ValueError, match=r"^with_info must be the same on all ranks"):
            limit(part, 1.0, 0.3)

    on_ranks(FLAT["square"], None, SIZE, work)


def test_points_need_the_exact_method_and_a_bound():
    def work(part):
        points = ([[0.0, 0.0]], [1.0])
        with pytest.raises(ValueError, match="point_sources is for method='exact'"):
            limit_gradient(part, 1.0, np.full(part.n_points, 0.3), point_sources=points)
        with pytest.raises(ValueError, match="h0 must be finite at one node at least"):
            limit_gradient(part, np.inf, 0.3, point_sources=([[0.0, 0.0]], [np.inf]))

    on_ranks(FLAT["square"], None, SIZE, work)
