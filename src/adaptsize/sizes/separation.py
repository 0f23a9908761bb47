"""Sizes from the separation of features of the boundary."""

from __future__ import annotations

import numpy as np

from adaptsize._calls import recorded
from adaptsize._checks import as_angle, as_number
from adaptsize._defaults import CORNER_ANGLE, CREASE_ANGLE, TOLERANCE
from adaptsize._progress import reporting
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.separation import Separation
from adaptsize.geometry.walls import WallTree
from adaptsize.sizes.combine import minimum
from adaptsize.sizes.feature import own_boundary
from adaptsize.typing import FloatArray, ProgressCallback


@recorded("size_from_separation")
def size_from_separation(
    background: SimplexMesh,
    *,
    elements_between: float = 1.0,
    crease_angle: float = CREASE_ANGLE,
    corner_angle: float = CORNER_ANGLE,
    tolerance: float = TOLERANCE,
    hmin: float | None = None,
    hmax: float | None = None,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    r"""Return the size that puts a number of elements between features that are close.

    .. math:: h_0(p) = F(p) / n, \qquad n = \mathrm{elements\_between},

    at the nodes on feature edges of the boundary (in the plane, at its corners), with the
    separation F of `adaptsize.geometry.boundary_separation`: the distance to the nearest corner,
    curve or face that does not meet that of the node.  A mesh generator has to put edges of this
    length there in any case.

    Parameters
    ----------
    background : SimplexMesh
        A mesh of full dimension in 2-D or 3-D, or the boundary of a domain (triangles in space,
        segments in the plane).
    elements_between : float, default 1
        Number n of elements, > 0.
    crease_angle, corner_angle : float
        As for `boundary_separation`, degrees.
    tolerance : float, default 1e-3
        Separations below this share of the diameter are raised to it, >= 0: a boundary that is
        kept within this tolerance need not have these features.
    hmin, hmax : float, optional
        Limits of the size; ``hmin`` overrides the bound.
    progress : callable, bool or None
        As in `limit_gradient`.

    Returns
    -------
    ndarray of float64, shape (n_points,)
        Sizes; ``inf`` off the feature edges, unless ``hmax`` is given.

    Raises
    ------
    ValueError
        If an option is out of range, or the background is of another kind.

    See Also
    --------
    size_from_feature : the size across narrow regions.

    Notes
    -----
    This is a function of its own, because it bounds sizes at other places than the width (on
    feature edges only), and has another default.  On surfaces with noise, where most faces are
    single triangles, each triangle is a feature; `size_function` does not use the separation
    there.  On other backgrounds, use `boundary_separation` as a `PointSource`.

    Examples
    --------
    A plate with a step of 0.1:

    >>> points = [[0, 0], [1, 0], [3, 0], [3, 1], [1, 1], [1, 0.9], [0, 0.9]]
    >>> cells = [[0, 1, 5], [0, 5, 6], [1, 2, 3], [1, 3, 4], [1, 4, 5]]
    >>> size_from_separation(SimplexMesh(points, cells)).round(3)
    array([0.9, inf, 1. , 1. , 0.1, 0.1, 0.9])
    """
    background = as_mesh("background", background)
    n = as_number("elements_between", elements_between, lower=0.0, strict=True)
    angles = as_angle("crease_angle", crease_angle), as_angle("corner_angle", corner_angle)
    share = as_number("tolerance", tolerance, lower=0.0)
    boundary, nodes = own_boundary(background)
    faces = Faces.of(boundary, angles[0])
    separation = Separation(faces, angles[1], WallTree.of(faces))
    at_boundary = np.full(boundary.n_points, np.inf)
    with reporting(progress) as report:
        at_boundary[separation.nodes.node] = separation.at_nodes(report).distances
    at_boundary = np.maximum(at_boundary, share * boundary.diameter)
    h0 = np.full(background.n_points, np.inf)
    h0[nodes] = at_boundary[faces.targets] / n
    return minimum(h0, hmin=hmin, hmax=hmax)
