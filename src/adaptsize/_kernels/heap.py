"""Indexed min-heap with four children per entry and back pointers."""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel


class Heap(NamedTuple):
    """A heap of up to n nodes, which can be kept between calls.

    Parameters
    ----------
    key : float64[n]
        Keys in heap order; ``key[:size]`` is in use.
    node : int32[n]
        The node of each entry.
    place : int32[n]
        Where a node stands in the heap; -1 if it is not in it.
    size : int64[1]
        Number of entries.
    """

    key: np.ndarray
    node: np.ndarray
    place: np.ndarray
    size: np.ndarray


def new_heap(n: int) -> Heap:
    """Return an empty heap."""
    return Heap(np.empty(n), np.empty(n, np.int32), np.full(n, -1, np.int32), np.zeros(1, np.int64))


@lean
def _rise(heap, here, value, i):
    """Put node i with its key at ``here`` or above."""
    key, node, place, _ = heap
    while here > 0:
        parent = (here - 1) >> 2
        if key[parent] <= value:
            break
        key[here] = key[parent]
        node[here] = node[parent]
        place[node[here]] = here
        here = parent
    key[here] = value
    node[here] = i
    place[i] = here


@lean_kernel
def push_or_decrease(heap, i, value):
    """Insert node i, or lower its key if it is in the heap already."""
    here = heap.place[i]
    if here < 0:
        here = heap.size[0]
        heap.size[0] += 1
    _rise(heap, here, value, i)


@lean_kernel
def push_all(heap, nodes, h):
    """Put nodes into a heap, with their sizes as keys."""
    for i in range(nodes.shape[0]):
        push_or_decrease(heap, np.int64(nodes[i]), h[nodes[i]])


@lean_kernel
def pop(heap):
    """Take out the entry of smallest key and return its node; the heap must not be empty."""
    key, node, place, size = heap
    top = np.int64(node[0])
    place[top] = -1
    size[0] -= 1
    n = size[0]
    if n == 0:
        return top
    value = key[n]
    i = np.int64(node[n])
    here = 0
    while True:
        child = 4 * here + 1
        if child >= n:
            break
        least = child
        for other in range(child + 1, min(child + 4, n)):
            if key[other] < key[least]:
                least = other
        if key[least] >= value:
            break
        key[here] = key[least]
        node[here] = node[least]
        place[node[here]] = here
        here = least
    key[here] = value
    node[here] = i
    place[i] = here
    return top
