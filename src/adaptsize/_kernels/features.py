"""Feature edges of a surface."""

from adaptsize._kernels.compiling import lean_kernel


@lean_kernel
def remove_loose(edges, is_kept, is_feature, degree):
    """Remove feature edges with a loose end until there are none.

    Parameters
    ----------
    edges : int32[n_edges, 2]
    is_kept : bool[n_edges]
        Edges that are not removed.
    is_feature : bool[n_edges]
        In/Out.
    degree : int32[n_points]
        In/Out: number of feature edges at each node.
    """
    n = edges.shape[0]
    left, forward = True, True
    while left:
        left = False
        for k in range(n):
            e = k if forward else n - 1 - k  # chains of edges are numbered in either direction
            if not is_feature[e] or is_kept[e]:
                continue
            i, j = edges[e, 0], edges[e, 1]
            if degree[i] == 1 or degree[j] == 1:
                is_feature[e] = False
                degree[i] -= 1
                degree[j] -= 1
                left = True
        forward = not forward
