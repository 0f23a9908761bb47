"""Where a path that is extended over one more edge acts, by angles around that edge."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from adaptsize._kernels.space_network import extend_paths
from adaptsize._kernels.space_paths import Bases, Edges, Paths

CASES = 300


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
        assert is_of_use or not reached.any()
        n_paths += np.count_nonzero(reached)
        n_left_out += np.count_nonzero(~acts)
    assert n_paths > CASES
    assert kind == "across" or n_left_out > CASES, "other points need no test"
