"""Where a path that is extended over one more edge acts, by angles around that edge."""

import numpy as np
import pytest
from numba import njit
from scipy.spatial.transform import Rotation

from adaptsize._kernels import space_paths
from adaptsize._kernels.space_network import bound_paths, extend_paths
from adaptsize._kernels.space_paths import Bases, Edges, Paths

CASES = 300


@njit
def promise_of(boxes, b, x, sizes, count, g):
    return space_paths.promise_of(boxes, b, x, sizes, count, g)


@njit
def in_sector(paths, w, box, slack):
    return space_paths.in_sector(paths, w, box, slack)


def around(angle):
    """Return unit vectors at angles from the middle of the obstacle, across its edge."""
    return np.stack([-np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)


def wedge(rng, turn):
    """Return half of the angle of an obstacle, outward normals of its faces, and its middle."""
    half = rng.uniform(0.05, 1.4)
    normals = np.stack([around(half - np.pi / 2), around(np.pi / 2 - half)])
    middle = rng.uniform(0.5, 2.0) * around(np.array(0.0))
    return half, normals[rng.permutation(2)] @ turn.T, middle @ turn.T


def before(rng, turn, kind):
    """Return the ends of an edge where paths start that bend at the z-axis next."""
    if kind == "across":  # above the obstacle, from one side of it to the other
        x = rng.uniform(0.1, 2.0, 2) * [1.0, -1.0]
        ends = np.column_stack([x[rng.permutation(2)], rng.uniform(0.05, 1.0, 2)])
    else:
        ends = rng.uniform(-1.0, 1.0, (2, 2))
    return np.column_stack([ends, rng.uniform(-1.0, 1.0, 2)]) @ turn.T


def paths_over(edges):
    """Return a straight path from a point, and one from there over edge 0."""
    bases = Bases(np.zeros((1, 12)), np.ones(1, np.int8), np.full((1, 3), -1, np.int32))
    row = np.zeros(2, np.int32)
    part = np.array([[0.0, 0.0], [0.0, edges.length[0]]])
    numbers = row, np.array([-1, 0], np.int32), np.array([-1, 0], np.int32)
    return Paths(
        bases, edges, *numbers, np.full((2, 2), 1.5), np.zeros(2), np.zeros((2, 9)),
        np.zeros(2, np.bool_), part,
    )  # fmt: skip


def extended(edges, middle):
    """Return the sector of the path that is extended over edge 1, and whether it is of use."""
    one = np.ones(1, np.int32)
    given = one, one, 0 * one, np.array([[0.0, edges.length[1]]])
    found = np.empty((1, 2)), np.empty(1), np.empty((1, 9)), *np.empty((2, 1), np.bool_)
    starts = np.zeros((1, 3)), np.zeros(1)
    extend_paths(paths_over(edges), np.array([middle, middle]), given, starts, 1e-12, found)
    return found[2].reshape(3, 3), found[4][0]


def angle_of(points, turn):
    """Return the angle around the z-axis from the middle of the obstacle, from 0 to 360 degrees."""
    x, y, _ = (points @ turn).T
    return np.arctan2(-x, y) % (2.0 * np.pi)


@pytest.mark.parametrize("kind", ["across", "anywhere"])
def test_a_path_acts_wherever_it_bends_by_half_a_turn_around_the_obstacle(kind):
    rng = np.random.default_rng(2701)
    n_paths = n_left_out = 0
    for _ in range(CASES):
        turn = Rotation.random(random_state=rng).as_matrix()
        half, normals, middle = wedge(rng, turn)
        ends = before(rng, turn, kind)
        along = ends[1] - ends[0]
        length = np.linalg.norm(along)
        axis = turn[:, 2]
        edges = Edges(
            np.stack([ends[0], -axis]), np.stack([along / length, axis]), np.array([length, 2.0]),
            np.stack([normals, normals]),
        )  # fmt: skip
        sector, is_of_use = extended(edges, middle)
        starts = ends[0] + rng.random(40)[:, None] * along
        targets = rng.uniform(-1.0, 1.0, (40, 3)) @ turn.T
        of_start, of_target = angle_of(starts, turn), angle_of(targets, turn)
        free = [(half < a) & (a < 2.0 * np.pi - half) for a in (of_start, of_target)]
        bends = np.abs(of_start[:, None] - of_target) > np.pi + 1e-6
        bends &= free[0][:, None] & free[1]
        reached = bends.any(axis=0)
        product = targets @ sector.T
        acts = (product[:, 0] <= 1e-12) & (product[:, 1:].max(axis=1) >= -1e-12)
        assert acts[reached].all()
        paths = paths_over(edges)
        paths.edge[1], paths.sector[1] = 1, sector.ravel()
        found = [in_sector(paths, 1, np.concatenate([x, x]), 1e-12) for x in targets[:8]]
        assert found == acts[:8].tolist()
        assert is_of_use or not reached.any()
        n_paths += np.count_nonzero(reached)
        n_left_out += np.count_nonzero(~acts)
    assert n_paths > CASES
    assert kind == "across" or n_left_out > CASES, "other points need no test"


def test_boxes_and_least_sizes_of_paths_hold_for_all_places_where_they_bend():
    rng = np.random.default_rng(2702)
    for count in (1, 2, 3) * 20:
        ends = rng.uniform(-1.0, 1.0, (2, 2, 3))
        length = np.linalg.norm(ends[1] - ends[0], axis=1)
        along = (ends[1] - ends[0]) / length[:, None]
        edges = Edges(ends[0], along, length, np.zeros((2, 2, 3)))
        paths, g = paths_over(edges), rng.uniform(0.1, 1.0)
        vertices, sizes = rng.uniform(-1.0, 1.0, (3, 3)), rng.random(3)
        vertices[count:], sizes[count:] = vertices[0], np.inf  # as in tables of sources
        paths.bases.table[0, :9], paths.bases.table[0, 9:] = vertices.ravel(), sizes
        paths.image[1], paths.offset[1] = rng.uniform(-1.0, 3.0, 2), 0.2
        paths.part[1] = np.sort(rng.uniform(0.0, length[0], 2))
        lower, upper, middle = np.empty((3, 2, 3))
        value = np.empty(2)
        bound_paths(paths, np.arange(2, dtype=np.int32), g, lower, upper, middle, value)
        assert (lower[0] <= vertices).all()
        assert (vertices <= upper[0]).all()
        assert value[0] == sizes.min()
        t = np.linspace(*paths.part[1], 200)
        places = ends[0, 0] + t[:, None] * along[0]
        assert (lower[1] - 1e-12 <= places).all()
        assert (places <= upper[1] + 1e-12).all()
        at_places = 0.2 + g * np.hypot(t - paths.image[1, 0], paths.image[1, 1])
        np.testing.assert_allclose(value[1], at_places.min(), rtol=1e-3)
        assert value[1] <= at_places.min() + 1e-12
        np.testing.assert_allclose(middle, 0.5 * (lower + upper))


def test_a_box_of_paths_is_passed_over_only_if_it_lowers_no_point():
    rng = np.random.default_rng(2703)
    for _ in range(50):
        lower, x, g = rng.uniform(-1.0, 0.0, 3), rng.uniform(-2.0, 2.0, (3, 16)), rng.random()
        upper, value = lower + rng.random(3), rng.random()
        gap = np.maximum(0.0, np.maximum(lower[:, None] - x, x - upper[:, None]))
        bound = value + g * np.linalg.norm(gap, axis=0)
        sizes = bound * (1.0 + rng.choice([-1e-3, -1e-9, 0.0, 1e-9, 1e-3], 16))
        box = np.concatenate([lower, upper, [value]])[None]
        expected = np.count_nonzero(bound[:12] * (1.0 - 1e-10) <= sizes[:12])
        assert promise_of(box, 0, x, sizes, 12, g) == expected
    assert promise_of(np.full((1, 7), np.inf), 0, x, sizes, 12, g) == 0
