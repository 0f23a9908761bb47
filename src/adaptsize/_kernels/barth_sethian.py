"""Residuals of the positive coefficient scheme of Barth and Sethian."""

import math

import numpy as np

from adaptsize._kernels.compiling import kernel


@kernel
def fill_residuals(hats, u, limit, out):
    r"""Gather the nodal residuals of :math:`u_t + \max(|\nabla u| - g, 0) = 0`.

    In each cell T with gradient p of u, q = |p|, and K_i = |T| p . grad N_i / q:

        u_in    = sum_l K_l^- u_l / sum_l K_l^-
        dphi_i  = K_i^+ (u_i - u_in),    alpha_i = dphi_i^+ / sum_l dphi_l^+
        R_i    += alpha_i |T| max(q - g, 0),    W_i += alpha_i |T|

    With g = 0 this is the level set scheme [1]_ itself.

    Parameters
    ----------
    hats : tuple of int32[m, k + 1], float64[m], float64[m, k + 1, dim]
        The cells, and what `simplex.fill_hat_gradients` fills.
    u : float64[n]
        Finite.
    limit : tuple of float64[m] or float64[1], int
        Gradient limit g per cell, and g_step, 1 or 0: cell c has ``g[c * g_step]``.
    out : tuple of three float64[n]
        Out: R and W, and the least u_in of the cells that act on the node, inf if none does.

    References
    ----------
    .. [1] T. J. Barth, J. A. Sethian, "Numerical schemes for the Hamilton-Jacobi
       and level set equations on triangulated domains", J. Comput. Phys. 145 (1998) 1-40.
    """
    (cells, measures, gradients), (g, g_step), (residual, weight, upstream) = hats, limit, out
    residual[:] = 0.0
    weight[:] = 0.0
    upstream[:] = math.inf
    width = cells.shape[1]
    dim = gradients.shape[2]
    slope = np.empty(dim)
    share = np.empty(width)
    for c in range(cells.shape[0]):
        if measures[c] == 0.0:
            continue
        q2 = 0.0
        for d in range(dim):
            slope[d] = 0.0
            for v in range(width):
                slope[d] += u[cells[c, v]] * gradients[c, v, d]
            q2 += slope[d] ** 2
        if q2 == 0.0:
            continue
        q = math.sqrt(q2)
        inflow = 0.0
        inflow_u = 0.0
        for v in range(width):
            share[v] = 0.0
            for d in range(dim):
                share[v] += measures[c] * slope[d] * gradients[c, v, d] / q
            if share[v] < 0.0:
                inflow += share[v]
                inflow_u += share[v] * u[cells[c, v]]
        if inflow == 0.0:
            continue
        u_in = inflow_u / inflow
        total = 0.0
        for v in range(width):
            share[v] = max(share[v], 0.0) * max(u[cells[c, v]] - u_in, 0.0)
            total += share[v]
        if total == 0.0:
            continue
        excess = max(q - g[c * g_step], 0.0)
        for v in range(width):
            if share[v] > 0.0:
                i = cells[c, v]
                residual[i] += share[v] / total * measures[c] * excess
                weight[i] += share[v] / total * measures[c]
                upstream[i] = min(upstream[i], u_in)
