r"""The Hamilton-Jacobi iteration on Cartesian grids.

Nodal values live in flat, padded arrays: the grid in C order with ghost layers on
every side.  Ghosts and nodes that take no part hold NaN.  Every comparison with NaN is
False, so a missing neighbour adds nothing and needs no test.
"""

import numpy as np

from adaptsize._kernels.compiling import kernel


@kernel
def hamilton_jacobi_stage(u, base, share, problem, out):
    r"""Set ``out = min(h0, share base + (1 - share) (u - dt (D - g)))``.

    D is the Godunov upwind value of the gradient's norm: with D^- and D^+ the backward and
    forward differences along an axis,

        D^2 = sum over axes of max(D^-, -D^+, 0)^2.

    At order 2 both differences are corrected by ENO second differences,

        dx D^- = u_i - u_l + minmod(u_i - 2 u_l + u_ll, u_r - 2 u_i + u_l) / 2,
        dx D^+ = u_r - u_i - minmod(u_rr - 2 u_r + u_i, u_r - 2 u_i + u_l) / 2,

    with u_ll, u_l, u_r, u_rr the two neighbours on either side; a second difference with a
    missing node counts as 0.  There u - dt (D - g) is kept above the lowest neighbour, or above
    u if none is lower, as it is at order 1 by itself; only roughness that is not yet limited
    is touched by that.  The loops run along one row at a time and hold no branch, so that
    they are vectorised.

    Parameters
    ----------
    u, base : float64[n_padded]
        ``base`` may be ``u``; NaN at missing nodes.
    share : float64
        0 for Euler's step; the later stages of a Runge-Kutta step mix in the values that
        the step began with.
    problem : tuple (h0, g, g_step, rows, n_row, strides, weights, order, dt, still)
        h0 : float64[n_padded], inf allowed;
        g : float64[1] for one limit and g_step = 0, or float64[n_padded] and g_step = 1;
        rows : int64[n_rows], the first node of every row along the last axis;
        n_row : int64, nodes per row;
        strides : int64[dim], distance of neighbours in the arrays, 1 along the last axis;
        weights : float64[dim], 1/dx^2 per axis;
        order : int64, 1, or 2 with two ghost layers;
        dt : float64;
        still : float64, a node moves if it changes by more than this.
    out : float64[n_padded]
        Out: set in the rows, the rest is left alone.  Neither ``u`` nor ``base``.

    Returns
    -------
    int64
        Number of nodes with ``|out - base| > still``.
    """
    h0, g, g_step, rows, n_row, strides, weights, order, dt, still = problem
    total, deepest = np.empty(n_row), np.empty(n_row)
    limit = np.full(n_row, g[0])
    moving = 0
    for s in rows:
        e = s + n_row
        mid = u[s:e]
        total[:] = 0.0
        deepest[:] = 0.0
        for axis in range(strides.shape[0]):
            stride, weight = strides[axis], weights[axis]
            low, high = u[s - stride : e - stride], u[s + stride : e + stride]
            if order == 1:
                for i in range(n_row):
                    fall_low, fall_high = mid[i] - low[i], mid[i] - high[i]
                    steepest = fall_low if fall_low > 0.0 else 0.0
                    steepest = fall_high if fall_high > steepest else steepest
                    total[i] += weight * steepest * steepest
                continue
            low2, high2 = u[s - 2 * stride : e - 2 * stride], u[s + 2 * stride : e + 2 * stride]
            for i in range(n_row):
                fall_low, fall_high = mid[i] - low[i], mid[i] - high[i]
                deepest[i] = fall_low if fall_low > deepest[i] else deepest[i]
                deepest[i] = fall_high if fall_high > deepest[i] else deepest[i]
                bend = -(fall_low + fall_high)
                bend_low = fall_low - (low[i] - low2[i])
                bend_high = fall_high - (high[i] - high2[i])
                least = bend if abs(bend) < abs(bend_low) else bend_low
                fall_low += 0.5 * least if bend * bend_low > 0.0 else 0.0
                least = bend if abs(bend) < abs(bend_high) else bend_high
                fall_high += 0.5 * least if bend * bend_high > 0.0 else 0.0
                steepest = fall_low if fall_low > 0.0 else 0.0
                steepest = fall_high if fall_high > steepest else steepest
                total[i] += weight * steepest * steepest
        if g_step == 1:
            limit = g[s:e]
        old, bound, new = base[s:e], h0[s:e], out[s:e]
        for i in range(n_row):
            fall = dt * (np.sqrt(total[i]) - limit[i])
            if order == 2:  # loop-invariant: costs nothing
                fall = deepest[i] if fall > deepest[i] else fall
            moved = mid[i] - fall
            moved += share * (old[i] - moved)
            moved = bound[i] if bound[i] < moved else moved
            new[i] = moved
            moving += abs(moved - old[i]) > still
    return moving


@kernel
def iterate_hamilton_jacobi(n_steps, u, spare, stage, problem):
    """Take steps until no node moves; return how many were taken and the last count.

    With Euler's step E(u) = u - dt (D - g), and each value lowered to h0 if it is above,
    order 1 takes u' = E(u), order 2 the third-order TVD Runge-Kutta step

        u1 = E(u),    u2 = 3/4 u + 1/4 E(u1),    u' = 1/3 u + 2/3 E(u2).

    Parameters
    ----------
    n_steps : int64
        Most steps, at least 1.
    u, spare : float64[n_padded]
        In: the start in ``u``, NaN at the missing nodes of both.  Out: the last two
        states, the last one in ``u`` if the number of steps is even, else in ``spare``.
    stage : float64[n_padded]
        Scratch of order 2, NaN at missing nodes; any array at order 1.
    problem : tuple
        As in `hamilton_jacobi_stage`.

    Returns
    -------
    taken, moving : int64
    """
    order = problem[7]
    moving = 0
    for step in range(n_steps):
        share, latest = 0.0, u
        if order == 2:
            hamilton_jacobi_stage(u, u, 0.0, problem, spare)
            hamilton_jacobi_stage(spare, u, 0.75, problem, stage)
            share, latest = 1.0 / 3.0, stage
        moving = hamilton_jacobi_stage(latest, u, share, problem, spare)
        u, spare = spare, u
        if moving == 0:
            return step + 1, moving
    return n_steps, moving
