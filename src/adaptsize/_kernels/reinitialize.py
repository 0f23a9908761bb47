"""One step of the reinitialization equation on a grid.

Grids have three axes here, of one node where there are fewer, and nodes are numbered row by
row, the last axis fastest.
"""

import math

from adaptsize._kernels.compiling import inner, kernel


@inner
def _minmod(a, b):
    """Return the smaller in modulus of two numbers of one sign, else 0."""
    if a * b <= 0.0:
        return 0.0
    return a if abs(a) < abs(b) else b


@inner
def _second_difference(phi, node, at, n, stride):
    """Return phi_{i-1} - 2 phi_i + phi_{i+1} along an axis; 0 at its ends."""
    if at < 1 or at > n - 2:
        return 0.0
    return phi[node - stride] - 2.0 * phi[node] + phi[node + stride]


@kernel
def measure_cuts(values, nodes, shape, cuts):
    """Measure how far along each axis the zero level of a function is.

    Where the sign changes between nodes i and j, the place is the root of the quadratic whose
    second derivative is the smaller one of those at i and j.

    Parameters
    ----------
    values : float64[n_nodes]
    nodes : int64[m]
    shape : int64[3]
    cuts : float64[m, 6]
        Out: in spacings, backward and forward along each axis; 1 where no zero is nearer than
        the next node, 2 where there is no next node.
    """
    strides = (shape[1] * shape[2], shape[2], 1)
    for place in range(nodes.shape[0]):
        node = nodes[place]
        at = (node // strides[0], node // strides[1] % shape[1], node % shape[2])
        f = values[node]
        for a in range(3):
            for side in range(2):
                ahead = at[a] + (1 if side == 1 else -1)
                if ahead < 0 or ahead >= shape[a]:
                    cuts[place, 2 * a + side] = 2.0
                    continue
                other = node + (strides[a] if side == 1 else -strides[a])
                g = values[other]
                cuts[place, 2 * a + side] = 1.0
                if (f > 0.0) == (g > 0.0):
                    continue
                here = _second_difference(values, node, at[a], shape[a], strides[a])
                there = _second_difference(values, other, ahead, shape[a], strides[a])
                bend = _minmod(here, there)
                # f + slope t + bend t^2 / 2 is g at t = 1; the stable form of its root.
                slope = g - f - 0.5 * bend
                root = math.sqrt(max(slope * slope - 2.0 * f * bend, 0.0))
                below = slope + math.copysign(root, slope)
                t = -2.0 * f / below if below != 0.0 else 0.5
                cuts[place, 2 * a + side] = min(max(t, 0.0), 1.0)


@kernel
def relax(phi, positive, nodes, cuts, spacing, shape, steps, change):
    """Fill  -dt s (|grad phi| - 1)  with s the sign and one-sided differences of second order.

    Parameters
    ----------
    phi : float64[n_nodes]
    positive : bool[n_nodes]
    nodes : int64[m]
    cuts : float64[m, 6]
        From `measure_cuts`: differences towards the zero level end there.
    spacing : float64[3]
    shape : int64[3]
    steps : float64[m]
        Time step of each node.
    change : float64[m]
        Out.
    """
    strides = (shape[1] * shape[2], shape[2], 1)
    for place in range(nodes.shape[0]):
        node = nodes[place]
        at = (node // strides[0], node // strides[1] % shape[1], node % shape[2])
        own = phi[node]
        sign = 1.0 if positive[node] else -1.0
        squares = 0.0
        for a in range(3):
            if shape[a] == 1:
                continue
            h = spacing[a]
            here = _second_difference(phi, node, at[a], shape[a], strides[a])
            steepest = 0.0
            for side in range(2):
                cut = cuts[place, 2 * a + side]
                if cut > 1.0:
                    continue
                stride = strides[a] if side == 1 else -strides[a]
                ahead = at[a] + (1 if side == 1 else -1)
                beyond = _second_difference(phi, node + stride, ahead, shape[a], strides[a])
                end = phi[node + stride] if cut == 1.0 else 0.0
                # Descent towards that side, of |phi|: phi grows away from the zero level.
                slope = (own - end) / (cut * h) + 0.5 * cut * _minmod(here, beyond) / h
                steepest = max(steepest, sign * slope)
            squares += steepest * steepest
        change[place] = -steps[place] * sign * (math.sqrt(squares) - 1.0)
