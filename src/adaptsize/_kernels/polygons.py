"""Crossings of polygons by rays along x, which tell what is inside."""

from adaptsize._kernels.compiling import lean, lean_kernel


@lean
def _is_left_of(chain, i, x, y):
    """Return whether a point is to the left of a segment, seen from its lower to its upper end."""
    low, high = (i, i + 1) if chain[i, 1] < chain[i + 1, 1] else (i + 1, i)
    ux, uy = chain[high, 0] - chain[low, 0], chain[high, 1] - chain[low, 1]
    return ux * (y - chain[low, 1]) - (x - chain[low, 0]) * uy > 0.0


@lean_kernel
def mark_inside(chain, boxes, points, stack, inside):
    """Mark the points from which a ray to the right crosses a closed chain an odd number of times.

    A ray that begins to the left of a box crosses the part of the chain in it an odd number of
    times if the two ends of this part are on different sides of the ray.  So only boxes that
    contain the point are opened.

    Parameters
    ----------
    chain : float64[n_leaves + 1, 2]
    boxes : float64[2 * n_leaves, 4]
        Lower and upper corners; leaf l holds the segment from node l to l + 1 (see trees.py).
    points : float64[n, 2]
    stack : int64[DEPTH]
        Scratch.
    inside : bool[n]
        Out.
    """
    n_leaves = boxes.shape[0] // 2
    for q in range(points.shape[0]):
        x, y = points[q, 0], points[q, 1]
        inside[q] = False
        stack[0], height = 1, 1
        while height > 0:
            height -= 1
            b = stack[height]
            if x > boxes[b, 2] or not boxes[b, 1] <= y < boxes[b, 3]:
                continue
            if x >= boxes[b, 0] and b < n_leaves:
                stack[height], stack[height + 1] = 2 * b, 2 * b + 1
                height += 2
                continue
            first, last = b, b + 1
            while first < n_leaves:
                first, last = 2 * first, 2 * last
            begin, end = chain[first - n_leaves, 1], chain[last - n_leaves, 1]
            if (begin <= y) != (end <= y) and (
                b < n_leaves or _is_left_of(chain, b - n_leaves, x, y)
            ):
                inside[q] = not inside[q]
