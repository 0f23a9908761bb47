"""The indexed heap against sorting."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from adaptsize._kernels.heap import new_heap, pop, push_or_decrease


@given(st.integers(0, 2**32 - 1), st.integers(1, 200))
def test_pops_come_in_order_after_decreases(seed, n):
    rng = np.random.default_rng(seed)
    heap, value = new_heap(n), rng.random(n)
    for i in range(n):
        push_or_decrease(heap, i, value[i])
    for i in rng.integers(0, n, n):
        value[i] *= rng.random()
        push_or_decrease(heap, i, value[i])
    popped = [pop(heap) for _ in range(n)]
    assert heap.size[0] == 0
    assert (heap.place == -1).all()
    assert sorted(popped) == list(range(n))
    assert (np.diff(value[popped]) >= 0.0).all()
