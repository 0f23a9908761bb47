"""Distances on grids and meshes from values near where they are zero, by fast marching."""

from __future__ import annotations

import warnings
from functools import partial

import numpy as np

from adaptsize._kernels import fast_marching as kernels
from adaptsize._kernels.heap import new_heap
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.marching import (
    accept_all,
    march_on_grid,
    patience,
    stars_in,
    sweep_into_heap,
)
from adaptsize.background.padding import pad, strides_of_padded, unpad
from adaptsize.errors import ConvergenceWarning
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# Where dependencies between nodes are cyclic, among flat cells, changes must be larger.
_KEEP_ROUGHLY = 1.0 - 1e-3


def march_distance(
    grid: CartesianGrid,
    seeds: FloatArray,
    *,
    where: BoolArray | None = None,
    report: ProgressCallback,
    text: str = "marching distances",
) -> FloatArray:
    r"""Return the largest distances up to the seeds that solve the eikonal equation.

    .. math:: \sum_a \max\left(\frac{d - v_a}{\Delta x_a}, 0\right)^2 = 1, \qquad d \le d_0,

    with the smaller neighbour :math:`v_a` along each axis.  The scheme is of first order [1]_.

    Parameters
    ----------
    grid : CartesianGrid
        ``active`` is ignored; pass it as ``where``.
    seeds : float64[shape]
        Known distances, >= 0; inf elsewhere, no NaN.  A seed is lowered only if another seed
        requires it.
    where : bool[shape], optional
        Nodes that paths may pass through; all by default.
    report : callable
        Called with ``text`` and the fraction completed.
    text : str, optional

    Returns
    -------
    float64[shape]
        inf at nodes outside ``where`` and at those that no seed reaches.

    Notes
    -----
    O(n) time and 36 bytes per node besides seeds and result.

    References
    ----------
    .. [1] J. A. Sethian, SIAM Review 41 (1999) 199-235.
    """
    domain = grid.with_active(where)
    u = pad(domain, seeds)
    weights = tuple(float(w) for w in 1.0 / grid.spacing**2)
    march_on_grid(grid, u, (strides_of_padded(grid), weights, np.ones(1), 0), False, report, text)
    return unpad(domain, u)


def march_through_mesh(
    mesh: SimplexMesh, seeds: FloatArray, *, report: ProgressCallback, text: str
) -> FloatArray:
    """Return the largest distances up to the seeds that the local updates allow.

    Each node has the minimum of its seed and of the local updates from the opposite sides of its
    cells, on which distances are linear.  The scheme is of first order [1]_.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra, of any shape.
    seeds : float64[n_points]
        Known distances, >= 0; inf elsewhere, no NaN.
    report : callable
        Called with ``text`` and the fraction completed.
    text : str

    Returns
    -------
    float64[n_points]
        inf where no seed reaches.

    Warns
    -----
    ConvergenceWarning
        If updates among flat cells go on for so long that changes below 0.1 % are ignored.

    References
    ----------
    .. [1] F. Bornemann, C. Rasch, Comput. Vis. Sci. 9 (2006) 57-69.
    """
    limit = (np.ones(1), 0)
    u, heap = seeds.copy(), new_heap(mesh.n_points)
    sweep_into_heap(mesh, kernels.sweep_cells, u, limit, heap)
    march = partial(kernels.march, stars_in(mesh, limit), u, limit, heap)
    accepted = accept_all(march, heap, partial(report, text), most=patience(mesh.n_points))
    if heap.size[0] > 0:
        warnings.warn(
            f"{text} updated {mesh.n_points} nodes {accepted} times: changes below "
            f"{1.0 - _KEEP_ROUGHLY:.1%} are ignored from here on; the background has very flat "
            "cells",
            ConvergenceWarning,
            stacklevel=4,
        )
        accept_all(march, heap, partial(report, text), keep=_KEEP_ROUGHLY)
    report(text, 1.0)
    return u
