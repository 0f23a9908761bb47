"""Multilinear interpolation of a field in a box of pixels, with its gradient."""

import numpy as np

from adaptsize._kernels.compiling import kernel


@kernel
def interpolate_field(values, shape, place, found, slope):
    """Fill the values of a field at points, and its gradients.

    Parameters
    ----------
    values : float32[n_pixels]
        The field, axis 0 slowest.
    shape : int64[dim]
        Number of pixels along each axis, at least 2.
    place : float64[n, dim]
        Points in pixels, 0 at the first one.  Beyond the box, the field continues linearly.
    found : float64[n]
        Out.
    slope : float64[n, dim], or float64[0, dim]
        Out: derivatives per pixel, if there is room for them.
    """
    dim = shape.shape[0]
    share = np.empty(dim)
    corners = np.empty(1 << dim)
    for i in range(place.shape[0]):
        first = 0
        for d in range(dim):
            start = min(max(int(place[i, d]), 0), shape[d] - 2)
            first = first * shape[d] + start
            share[d] = place[i, d] - start
        # Bit d of the number of a corner is set where it is above along axis d.
        corners[0] = values[first]
        stride = 1
        for d in range(dim - 1, -1, -1):
            for k in range(1 << (dim - 1 - d)):
                corner = k << (d + 1)
                at = first
                step = 1
                for e in range(dim - 1, -1, -1):
                    if corner >> e & 1:
                        at += step
                    step *= shape[e]
                corners[corner | 1 << d] = values[at + stride]
            stride *= shape[d]
        if slope.shape[0] > 0:
            for d in range(dim):
                total = 0.0
                for corner in range(1 << dim):
                    weight = 1.0 if corner >> d & 1 else -1.0
                    for e in range(dim):
                        if e != d:
                            weight *= share[e] if corner >> e & 1 else 1.0 - share[e]
                    total += weight * corners[corner]
                slope[i, d] = total
        for d in range(dim - 1, -1, -1):
            for k in range(1 << d):
                above = corners[k | 1 << d]
                corners[k] += share[d] * (above - corners[k])
        found[i] = corners[0]
