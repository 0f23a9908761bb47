"""Numbers and owners of nodes from keys."""

import numpy as np
import pytest
from simulated_ranks import SimulatedCommunicator

from adaptsize.background.migration import keys_of_points, number_nodes


@pytest.mark.parametrize("n_ranks", [1, 2, 5])
@pytest.mark.parametrize("largest", [40, 10**15])
def test_numbers_follow_the_keys(n_ranks, largest):
    rng = np.random.default_rng(881 + n_ranks)
    every = np.sort(rng.choice(largest, 40, replace=False))
    held = [rng.choice(every, rng.integers(0, 40), replace=False) for _ in range(n_ranks)]
    known = np.unique(np.concatenate(held))
    found = SimulatedCommunicator.run(n_ranks, lambda comm: number_nodes(comm, held[comm.rank]))
    for rank, (ids, owner) in enumerate(found):
        assert np.array_equal(ids, np.searchsorted(known, held[rank]))
        lowest = [min(r for r in range(n_ranks) if key in held[r]) for key in held[rank]]
        assert owner.tolist() == lowest


def test_keys_depend_on_coordinates_only():
    rng = np.random.default_rng(4402)
    points = rng.random((1000, 3))
    points[0] = 0.0
    keys = keys_of_points(points)
    assert len(np.unique(keys)) == 1000
    order = rng.permutation(1000)
    assert np.array_equal(keys_of_points(points[order]), keys[order])
    assert keys_of_points(np.array([[-0.0, 0.0, 0.0]]))[0] == keys[0]
    with pytest.raises(ValueError, match="must differ"):
        keys_of_points(points[[0, 1, 0]])
