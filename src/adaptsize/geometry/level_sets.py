"""Curvature of the level sets of a distance function on a Cartesian grid."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_flag, as_float_array, as_number, as_whole_number, check_type
from adaptsize._kernels.level_sets import fill_level_set_curvature
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid
from adaptsize.background.grid_location import frame_of
from adaptsize.geometry.curvatures import MOST_TURNS
from adaptsize.typing import FloatArray, LongArray, ProgressCallback

# A kink by 90 degrees leaves a gradient of 0.71; a circle of a radius of one spacing, 0.75.
_TOLERANCE = 0.25
# Number of nodes per batch.
_NODES_AT_ONCE = 1_000_000


def level_set_curvature(
    grid: CartesianGrid,
    phi: npt.ArrayLike,
    *,
    at_boundary: bool = True,
    band: float = math.inf,
    gradient_tolerance: float = _TOLERANCE,
    smoothing: int = 0,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    r"""Return the principal curvatures of the boundary given by a distance function.

    Derivatives of phi at the nodes are central differences.  In the plane, the curvature is [1]_

    .. math:: \kappa = \nabla \cdot \frac{\nabla\phi}{|\nabla\phi|}
        = \frac{\phi_{xx} \phi_y^2 - 2 \phi_x \phi_y \phi_{xy} + \phi_{yy} \phi_x^2}
        {|\nabla\phi|^3}.

    In space, the principal curvatures are :math:`H \pm \sqrt{H^2 - G}` with the mean and Gaussian
    curvature H and G [2]_.  These are curvatures of the level set through the node, whose radius
    differs from that of the boundary by the distance phi.  The curvature of the boundary is

    .. math:: \kappa_b = \kappa / (1 - \kappa \phi)

    for each principal curvature.  This is exact for circles, spheres, cylinders, lines and planes.
    (Formula (3) of [1]_ has a plus sign, which does not agree with phi < 0 inside.)

    Parameters
    ----------
    grid : CartesianGrid
        Grid in the plane or in space.  The spacing may differ between axes.
    phi : array_like of float, of ``grid.shape``
        Signed distance to the boundary, negative inside.  NaN and inf mark nodes where it is not
        known; these nodes and their neighbours get no value.  Inactive nodes get no value either,
        but differences at their neighbours use their phi.
    at_boundary : bool, default True
        True: curvature of the boundary at the closest point.  False: curvature of the level set
        through the node.
    band : float, default inf
        Nodes with ``abs(phi)`` above this number of largest spacings get no value.
    gradient_tolerance : float, default 0.25
        Nodes where the length of the discrete gradient differs from 1 by more get no value.  The
        length is :math:`\cos(\theta / 2)` at nodes on a kink where phi turns by :math:`\theta`,
        and at worst 1 - h^2 / (4 r^2) on a circle of radius r with the spacing h.
    smoothing : int, default 0
        How often phi is averaged, with weights 1/4, 1/2, 1/4 along each axis, before it is
        differentiated twice.  The standard deviation of the filter is sqrt(smoothing / 2)
        spacings, by which kinks of phi are smeared, too.  Use 1 or 2 for noise and about 20 for
        distances from images.
    progress : callable or bool, optional
        Called with a text and the fraction completed; True shows a progress bar.

    Returns
    -------
    ndarray of float64, of ``grid.shape`` and ``dim - 1``
        Curvatures, 1 / length, the larger one first; positive where the inside is convex (1 / r
        for a disc).  NaN where no reliable value exists: on the border of the grid, at inactive
        nodes, outside the band, next to unknown phi, at kinks, and with ``at_boundary`` where
        the closest point is not unique, :math:`1 - \kappa \phi \le 0`.

    Raises
    ------
    ValueError
        If the grid is 1-D, phi has another shape, or an option is out of range.

    See Also
    --------
    adaptsize.geometry.curvature : Curvature of triangulated surfaces and of lines.
    adaptsize.size_from_curvature : Size from the curvature; also accepts phi.

    Notes
    -----
    The time is O(n), and memory is 8 (dim - 1) bytes per node.  The error is of second order in
    the spacing where the boundary is smooth; on a circle of radius r the relative error is at
    most h^2 / (4 r^2).  An error e of the distance itself contributes e / h^2.  For nodes on the
    convex side of a corner, phi is the distance to a point and has no kink; the curvature there
    is large, of the order of 1 / h or above.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and
       PDE-based gradient limiting", Engineering with Computers 22 (2006) 95-109.
    .. [2] R. Goldman, "Curvature formulas for implicit curves and surfaces", Computer
       Aided Geometric Design 22 (2005) 632-658.

    Examples
    --------
    A disc of radius 0.5, at nodes inside and outside, with and without the correction:

    >>> import numpy as np
    >>> from adaptsize import CartesianGrid
    >>> grid = CartesianGrid([-1.0, -1.0], 0.05, (41, 41))
    >>> phi = grid.sample(lambda x: np.linalg.norm(x, axis=1) - 0.5)
    >>> level_set_curvature(grid, phi)[20, [28, 30, 32], 0].round(2)
    array([1.99, 2.  , 2.  ])
    >>> level_set_curvature(grid, phi, at_boundary=False)[20, [28, 30, 32], 0].round(2)
    array([2.49, 2.  , 1.66])
    """
    check_type("grid", grid, CartesianGrid)
    values = as_level_set("phi", phi, grid)
    width = as_number("band", band, lower=0.0, allow_inf=True) * float(grid.spacing.max())
    tolerance = as_number("gradient_tolerance", gradient_tolerance, lower=0.0)
    at_boundary = as_flag("at_boundary", at_boundary)
    smooth = _smoothed(values, smoothing)
    kappa = np.full((grid.n_points, grid.dim - 1), np.nan)
    with reporting(progress) as report:
        for start in range(0, grid.n_points, _NODES_AT_ONCE):
            report("curvature of level sets", start / grid.n_points)
            part = slice(start, start + _NODES_AT_ONCE)
            wanted = np.abs(values.ravel()[part]) <= width
            if grid.active is not None:
                wanted &= grid.active.ravel()[part]
            nodes = np.flatnonzero(wanted) + start
            kappa[nodes] = _curvature_at(grid, (smooth, values), nodes, (tolerance, at_boundary))
        report("curvature of level sets", 1.0)
    return kappa.reshape(*grid.shape, grid.dim - 1)


def curvature_at_nodes(
    grid: CartesianGrid, phi: FloatArray, nodes: LongArray, gradient_tolerance: float, turns: int
) -> FloatArray:
    """Return the principal curvatures of the boundary closest to some nodes.

    Parameters
    ----------
    grid, phi, gradient_tolerance
        As for `level_set_curvature`.
    nodes : ndarray of int64, shape (m,)
        Flat indices, ``values.ravel()[nodes]``.
    turns : int
        How often phi is averaged, the ``smoothing`` of `level_set_curvature`.

    Returns
    -------
    ndarray of float64, shape (m, dim - 1)
        The larger one first; NaN where no reliable value exists.
    """
    smooth = _smoothed(phi, turns)
    return _curvature_at(grid, (smooth, phi), nodes, (gradient_tolerance, True))


def as_level_set(name: str, value: npt.ArrayLike, grid: CartesianGrid) -> FloatArray:
    """Return nodal values of a grid of two or three dimensions as float64 of its shape."""
    if grid.dim == 1:
        raise ValueError(f"grid must be 2-D or 3-D, as points have no curvature, got {grid!r}")
    return as_float_array(name, value, grid.shape)


def _curvature_at(
    grid: CartesianGrid,
    fields: tuple[FloatArray, FloatArray],
    nodes: LongArray,
    choice: tuple[float, bool],
) -> FloatArray:
    """Return the principal curvatures of the level sets through nodes, float64[m, dim - 1]."""
    kappa = np.empty((len(nodes), grid.dim - 1))
    smooth, distance = fields
    flat = (smooth.ravel(), distance.ravel())
    fill_level_set_curvature(flat, frame_of(grid)[1:], nodes, choice, kappa)
    return kappa


def _smoothed(phi: FloatArray, times: int) -> FloatArray:
    """Return values averaged with their neighbours along each axis, several times."""
    turns = as_whole_number("smoothing", times, lower=0, upper=MOST_TURNS)
    if turns == 0:
        return phi
    from scipy.ndimage import correlate1d

    weights = np.ones(1)
    for _ in range(turns):
        weights = np.convolve(weights, [0.25, 0.5, 0.25])
    # Smaller weights of averages are below rounding.
    weights = weights[weights > 1e-12]
    for axis in range(phi.ndim):
        phi = correlate1d(phi, weights / weights.sum(), axis=axis, mode="nearest")
    return phi
