"""Indexed min-heap with four children per entry and back pointers.

The heap is four plain objects, so that it can be kept between calls:

key : float64[n]
    Keys in heap order; ``key[:size]`` is in use.
node : int32[n]
    The node of each entry.
place : int32[n]
    Where a node stands in the heap; -1 if it is not in it.
size : int64[1]
    Number of entries.
"""

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel


@lean
def _rise(key, node, place, here, value, i):
    """Put node i with its key at ``here`` or above."""
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
def push_or_decrease(key, node, place, size, i, value):
    """Insert node i, or lower its key if it is in the heap already."""
    here = place[i]
    if here < 0:
        here = size[0]
        size[0] += 1
    _rise(key, node, place, here, value, i)


@lean_kernel
def pop(key, node, place, size):
    """Take out the entry of smallest key and return its node; the heap must not be empty."""
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
