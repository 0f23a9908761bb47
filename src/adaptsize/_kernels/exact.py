"""Formula (11) of Persson, by brute force."""

from numba import njit

from adaptsize._kernels.local import distance


@njit(cache=True, nogil=True)
def lower_by_all_sources(points, axes, sources, h0, g, first, last, h):
    """Lower nodes first..last - 1 to the least h0(y) + g |x - y| over all sources y.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    sources : int64[s]
        Nodes with finite h0, in ascending order of h0.
    h0 : float64[n]
    g : float64
    first, last : int
    h : float64[n]
        In/Out.
    """
    for i in range(first, last):
        least = h[i]
        for s in range(sources.shape[0]):
            j = sources[s]
            if h0[j] >= least:
                break  # so are all that follow
            least = min(least, h0[j] + g * distance(points, axes, i, j))
        h[i] = least
