"""Reinitialization: a distance function near the zero level of any level set function."""

from __future__ import annotations

import math
import warnings

import numpy as np

from adaptsize._kernels.level_sets import Band, measure_cuts, relax
from adaptsize.background import CartesianGrid
from adaptsize.errors import ConvergenceWarning
from adaptsize.geometry.distance.propagation import frame_of
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# Width of the margin beyond the band in spacings; difference stencils extend over two.
_MARGIN = 3
# Largest number of iterations: a constant plus a number per spacing of the width.
_MOST, _MOST_PER_SPACING = 20, 4


def reinitialize(
    grid: CartesianGrid, values: FloatArray, band: float, report: ProgressCallback
) -> FloatArray:
    r"""Return a function of the same zero level that is a distance near it.

    Iterates to a steady state

    .. math:: \phi_t + \mathrm{sign}(\phi_0) (|\nabla \phi| - 1) = 0

    (Sussman et al. 1994), with differences of second order that end at the zero level of
    the given values where that is nearer than the next node, so that it does not move
    (Russo and Smereka 2000, Min 2010), by Heun's method with a time step of each node.

    Parameters
    ----------
    grid : CartesianGrid
    values : float64[shape]
        Level set function; a positive factor does not change the result.
    band : float
        Width of the band in spacings; inf: everywhere.
    report : callable

    Returns
    -------
    float64[shape]
        Distances up to ``band`` spacings; beyond, a constant with the sign of the values.

    Warns
    -----
    ConvergenceWarning
        If the iteration stops at its limit.
    """
    frame = frame_of(grid)
    positive = values > 0.0
    spacing = float(grid.spacing.max())
    farthest = (band + _MARGIN) * spacing if math.isfinite(band) else 2.0 * grid.diagonal
    phi = np.clip(values * _scale_of(grid, values), -farthest, farthest)
    near = _near_zero(grid, positive, farthest)
    phi[~near] = np.where(positive, farthest, -farthest)[~near]
    phi, positive = phi.ravel(), positive.ravel()
    nodes = np.flatnonzero(near)
    cuts = np.empty((len(nodes), 6))
    measure_cuts(np.ascontiguousarray(values).ravel(), nodes, frame.shape, cuts)
    wide = frame.shape > 1
    pieces = np.minimum(np.minimum(cuts[:, 0::2], cuts[:, 1::2]), 1.0) * frame.spacing
    # A node closer to the zero level, in spacings, is not updated: its time step would vanish.
    on_level = pieces[:, wide].min(axis=1) <= 1e-9 * spacing
    phi[nodes[on_level]] = 0.0
    nodes, cuts, pieces = nodes[~on_level], cuts[~on_level], pieces[~on_level]
    # Time step over the largest stable one.
    steps = 0.9 / np.sqrt((1.0 / pieces[:, wide] ** 2).sum(axis=1))
    near_zero = Band(positive, nodes, cuts, steps)
    phi = _settle(grid, phi, near_zero, farthest, report).reshape(grid.shape)
    return np.copysign(np.maximum(phi * np.where(values > 0.0, 1.0, -1.0), 0.0), values)


def _settle(
    grid: CartesianGrid, phi: FloatArray, band: Band, farthest: float, report: ProgressCallback
) -> FloatArray:
    """Return phi after Heun steps until convergence."""
    _, *frame = frame_of(grid)
    axes, nodes, spacing = tuple(frame), band.nodes, float(grid.spacing.max())
    most = int(_MOST + _MOST_PER_SPACING * farthest / spacing)
    first, second = np.empty(len(nodes)), np.empty(len(nodes))
    for iteration in range(most):
        relax(phi, band, axes, first)
        stage = phi.copy()
        stage[nodes] += first
        relax(stage, band, axes, second)
        change = 0.5 * (first + second)
        phi[nodes] += change
        report("reinitialization", iteration / most)
        # The iteration stops when no value changes by more, in spacings.
        if float(np.abs(change).max(initial=0.0)) <= 1e-5 * spacing:
            return phi
    in_band = np.abs(phi[nodes]) <= farthest - _MARGIN * spacing
    left = float(np.abs(change[in_band]).max(initial=0.0)) / spacing
    # Values that change by less in the band in the last iteration have the accuracy of the scheme.
    if left > 5e-3:
        warnings.warn(
            f"reinitialization stopped after {most} iterations while distances still changed by "
            f"up to {left:.2g} spacings: the values may be too steep or too flat near their zeros",
            ConvergenceWarning,
            stacklevel=6,
        )
    return phi


def _scale_of(grid: CartesianGrid, values: FloatArray) -> float:
    """Return the factor that makes the median slope of edges across the zero level 1."""
    slopes = []
    for axis in range(grid.dim):
        change = np.diff(values > 0.0, axis=axis)
        slopes.append(np.abs(np.diff(values, axis=axis)[change]) / grid.spacing[axis])
    return 1.0 / float(np.median(np.concatenate(slopes)))


def _near_zero(grid: CartesianGrid, positive: BoolArray, farthest: float) -> BoolArray:
    """Return the nodes of boxes around all changes of sign."""
    from scipy import ndimage

    near = np.zeros(grid.shape, np.bool_)
    for axis in range(grid.dim):
        change = np.diff(positive, axis=axis)
        near |= np.insert(change, 0, False, axis=axis)
        near |= np.insert(change, change.shape[axis], False, axis=axis)
    for axis, n in enumerate(grid.shape):
        reach = min(int(np.ceil(farthest / grid.spacing[axis])), n)
        near = ndimage.maximum_filter1d(near, 2 * reach + 1, axis=axis, mode="constant")
    return near
