"""The entries in reach of some boxes, as those of the parts of a mesh on other ranks."""

from adaptsize._kernels.compiling import lean_kernel
from adaptsize._kernels.exact import SLACK, least_allowed
from adaptsize._kernels.trees import LEAF, distance_to_box


@lean_kernel
def list_entries_in_reach(table, boxes, axes, g, around, order, stack, found):
    """List the entries that may allow less than the largest size in one of several boxes.

    The tree over the entries is descended as long as one of the boxes is in reach.  A box out of
    reach of a part of the tree is not tested again in this part.  So the time is that for the
    entries in reach, and a few tests for boxes that none reaches.

    Parameters
    ----------
    table : float64[m, dim * (dim + 1) or more]
        Entries (see exact.py).
    boxes : float64[2 * n_leaves, 2 * dim + 1]
        The tree over them (see trees.py).
    axes : tuple of length dim
    g : float64
    around : float64[k, 2 * dim + 1]
        The lower and the upper corner of each box, and the largest size in it.
    order : int32[k]
        Scratch: the boxes, those that may be in reach first.
    stack : int32[DEPTH, 2]
        Scratch: boxes of the tree, and how many of ``order`` may be in their reach.
    found : int32[m]
        Out: the entries, in ascending order.

    Returns
    -------
    int
        The number of entries found.
    """
    dim = len(axes)
    m, n_leaves = table.shape[0], boxes.shape[0] // 2
    for i in range(around.shape[0]):
        order[i] = i
    stack[0, 0], stack[0, 1], size = 1, around.shape[0], 1
    count = 0
    while size > 0:
        size -= 1
        b, left = stack[size, 0], stack[size, 1]
        while left > 0:  # until the first of the boxes is in reach
            box = around[order[0]]
            least = boxes[b, 2 * dim] + g * distance_to_box(boxes, b, axes, box)
            if SLACK * least < box[2 * dim]:
                break
            left -= 1
            order[0], order[left] = order[left], order[0]
        if left == 0:
            continue
        if b < n_leaves:
            for half in range(2):  # the lower one is processed first
                stack[size, 0], stack[size, 1] = 2 * b + 1 - half, left
                size += 1
            continue
        for k in range((b - n_leaves) * LEAF, min(m, (b - n_leaves + 1) * LEAF)):
            rest = left
            while rest > 0:
                box = around[order[0]]
                if least_allowed(table, k, axes, box, g, True) < box[2 * dim]:
                    found[count] = k
                    count += 1
                    break
                rest -= 1
                order[0], order[rest] = order[rest], order[0]
    return count
