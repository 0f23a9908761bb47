"""Sizes from the curvature of a boundary given by the signed distance on a grid."""

import math
from itertools import product

import numpy as np
import numpy.typing as npt

from adaptsize.background import CartesianGrid
from adaptsize.background.grid import strides_of
from adaptsize.background.topology import marked
from adaptsize.geometry.level_sets import as_level_set, curvature_at_nodes
from adaptsize.options import CurvatureOptions
from adaptsize.sizes import tuning
from adaptsize.typing import BoolArray, FloatArray, LongArray

# A radius above 10^7 diagonals is a rounding error.
_FLAT = 1e-7


def size_from_distance(
    grid: CartesianGrid, boundary: npt.ArrayLike, given: CurvatureOptions
) -> FloatArray:
    """Return nodal sizes that give 1 / (K kappa) on the boundary, where phi is zero.

    ``given`` are checked options of `adaptsize.size_from_curvature`.
    """
    phi = as_level_set("boundary", boundary, grid)
    angle = math.radians(given["crease_angle"])
    tolerance = given["tolerance"]
    within = (
        tuning.REACH_OF_CURVATURE * float(grid.spacing.max()) if tolerance is None else tolerance
    )
    nodes = _nodes_near(grid, phi, within)
    # The mean of two unit vectors with that angle between them is shorter by this much.
    kink = 1.0 - math.cos(0.5 * angle)
    principal = curvature_at_nodes(grid, phi, nodes, kink, given["smoothing"])
    kappa = np.abs(principal).max(axis=1)
    if np.isnan(kappa).all():
        raise ValueError(
            f"boundary must be a signed distance, or finer resolved: at none of the {len(kappa)} "
            f"nodes near its zeros is its gradient of about length 1"
        )
    # Differences across a corner give a curvature of the order of 1 / spacing, which depends on the
    # position of the corner between the nodes.  Some of these nodes are detected, and their
    # neighbours are excluded too.
    smooth = kappa * grid.spacing.max() <= angle
    known = smooth & (phi.ravel()[nodes] >= -within)
    known[smooth] &= ~_are_beside(grid, marked(nodes[~smooth], grid.n_points), nodes[smooth])
    nodes, kappa = nodes[known], kappa[known]
    kappa[kappa * grid.diagonal < _FLAT] = 0.0
    h0 = np.full(grid.n_points, np.inf)
    reciprocal = given["elements_per_radian"] * kappa
    h0[nodes] = _sizes_beside_boundary(grid, phi, nodes, reciprocal, given["g"])
    return h0.reshape(grid.shape)


def _nodes_near(grid: CartesianGrid, phi: FloatArray, within: float) -> LongArray:
    """Return the active nodes near the boundary and their neighbours inside, flat indices.

    The distance has a kink on the line from a corner inwards.  Of two nodes beside it, the one that
    shows it may be deeper than ``within``.
    """
    near = np.abs(phi) <= within
    if grid.active is not None:
        near &= grid.active
    if not near.any():
        closest = np.nanmin(np.abs(phi), initial=np.inf)
        raise ValueError(
            f"boundary must be zero near nodes of the background, got distances of "
            f"{closest:g} and more, which is over the tolerance {within:g}"
        )
    beside = phi >= -within - float(np.linalg.norm(grid.spacing))
    if grid.active is not None:
        beside &= grid.active
    return np.flatnonzero(near | (beside & (phi < 0.0)))


def _sizes_beside_boundary(
    grid: CartesianGrid, phi: FloatArray, nodes: LongArray, per_size: FloatArray, g: float
) -> FloatArray:
    """Return nodal sizes that give 1 / ``per_size`` at the closest point of the boundary.

    A limited field with the slope m along the boundary has the slope sqrt(g^2 - m^2) across
    it.  Inside, the slope g is used instead: limiting corrects sizes that are too large, and
    errors of m have no effect there.
    """
    distance = phi.ravel()[nodes]
    with np.errstate(divide="ignore"):
        size = 1.0 / per_size
    h0 = size - g * np.minimum(distance, 0.0)
    outside = distance > 0.0
    along = _slope_along(grid, nodes, per_size)[outside]
    across = np.sqrt(np.maximum(g**2 - along**2, 0.0))
    h0[outside] -= across * distance[outside]
    h0 = np.maximum(h0, tuning.LEAST_SHARE_OUTSIDE * size)
    is_beside = _are_beside(grid, phi.ravel() <= 0.0, nodes[outside])
    h0[outside] = np.where(is_beside, h0[outside], np.inf)
    return h0


def _slope_along(grid: CartesianGrid, nodes: LongArray, per_size: FloatArray) -> FloatArray:
    """Return the slope of 1 / ``per_size`` at nodes, from their valid neighbours."""
    nodal = np.full(grid.n_points, np.nan)
    nodal[nodes] = per_size
    total = np.zeros(len(nodes))
    for stride, spacing in zip(strides_of(grid.shape), grid.spacing, strict=True):
        below, above = nodal[nodes - stride], nodal[nodes + stride]
        steps = np.isfinite(below).astype(float) + np.isfinite(above)
        rise = np.where(np.isnan(above), per_size, above) - np.where(
            np.isnan(below), per_size, below
        )
        total += (rise / (np.maximum(steps, 1.0) * spacing)) ** 2
    # d(1/c) = -dc / c^2; where c is zero the size is infinite and has no slope.
    return np.asarray(np.sqrt(total) / np.where(per_size > 0.0, per_size, np.inf) ** 2)


def _are_beside(grid: CartesianGrid, chosen: BoolArray, nodes: LongArray) -> BoolArray:
    """Return which nodes share a box with a chosen node; none may be on the grid border."""
    steps = np.array(list(product((-1, 0, 1), repeat=grid.dim)))
    found = np.zeros(len(nodes), np.bool_)
    for step in (steps @ strides_of(grid.shape)).tolist():  # of flat indices, one of them 0
        found |= chosen[nodes + step]
    return found
