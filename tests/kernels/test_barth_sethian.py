"""The raw positive coefficient kernel as a level set scheme (g = 0)."""

import numpy as np
from meshes import jittered_square

from adaptsize._kernels.barth_sethian import fill_residuals
from adaptsize.background.interpolation import hat_gradients


def _move(mesh, u, time):
    """March u_t + |grad u| = 0 to ``time`` with steps of half the smallest altitude."""
    measures, gradients = hat_gradients(mesh)
    n_steps = int(np.ceil(2.0 * time * np.linalg.norm(gradients, axis=2).max()))
    residual, weight, upstream = np.empty((3, mesh.n_points))
    u = u.copy()
    for _ in range(n_steps):
        hats, out = (mesh.cells, measures, gradients), (residual, weight, upstream)
        fill_residuals(hats, u, (np.zeros(1), 0), out)
        u -= time / n_steps * residual / np.where(weight > 0.0, weight, 1.0)
    return u


def test_expanding_circle_converges():
    # u0 = r - 30 moves to r - 30 - t. A level set scheme of this kind is second order
    # where the solution is smooth: errors fall by about 4 when the edges are halved.
    error = []
    for n_side in (16, 31):
        mesh = jittered_square(n_side, seed=11)
        r = np.linalg.norm(mesh.points, axis=1)
        u = _move(mesh, r - 30.0, 15.0)
        ring = (r > 20.0) & (r < 48.0)
        error.append(np.abs(u - (r - 45.0))[ring].mean())
    assert error[1] < 0.15
    assert np.log2(error[0] / error[1]) > 1.5, error
