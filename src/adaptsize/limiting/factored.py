"""Factored fast marching over triangles in the plane: smooth g(x) and point sources."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adaptsize.limiting.hermite import march_with_gradients
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope


def solve_factored(
    mesh: SimplexMesh,
    h0: FloatArray,
    slope: Slope,
    *,
    nodal_g: FloatArray | None,
    residual: bool,
    report: ProgressCallback,
) -> Solution:
    r"""Limit sizes by fast marching that interpolates mean slopes from point sources.

    Besides size and gradient (see `solve_hermite`), each node stores its controlling source:
    the node z from which its size grew.  On an edge whose ends have the same source z, sizes
    are

    .. math:: h_z + G(s) \, |x(s) - z|, \qquad G_a = (h_a - h_z) / |x_a - z|

    with the cubic Hermite interpolant G of the mean slopes.  G is smooth up to z, where h
    has the tip of a cone [1]_.  With constant g, G is constant and the update is exact.
    Edges without a common source get the Hermite update.  This includes edges between
    adjacent sources, where sizes are given along a boundary or everywhere.

    In a convex domain, an edge between the regions of two point sources propagates both,
    as if each region continued across it.  At a reentrant corner of the boundary paths bend,
    and the corner node becomes the source of the region in its shadow.  On shadow
    boundaries the Hermite update is used.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane.
    h0 : float64[n]
        inf allowed.
    slope : Slope
        One limit; used if ``nodal_g`` is None.
    nodal_g : float64[n] or None
        A smooth limit, interpolated linearly between the nodes.
    residual : bool
    report : callable

    Returns
    -------
    Solution
        As for `solve_hermite`.  With constant g, a convex domain and isolated point sources,
        the sizes are exact to rounding at all nodes that a chain of updates reaches; on
        Delaunay meshes this was every node.  With smooth g the scheme is of second order.

    Raises
    ------
    ValueError
        If the mesh is not one of triangles in the plane, or g is given per cell.

    Notes
    -----
    Cost: about twice that of fast marching.  The properties that `solve_hermite` does not
    satisfy to rounding do not hold to rounding here either.

    References
    ----------
    .. [1] S. Fomel, S. Luo, H. Zhao, "Fast sweeping method for the factored eikonal
       equation", J. Comput. Phys. 228 (2009) 6440-6455.
    """
    if mesh.cell_dim != 2 or mesh.dim != 2:
        raise ValueError(f"method='factored' needs triangles in the plane, got {mesh!r}")
    if slope.step and nodal_g is None:
        raise ValueError(
            "method='factored' needs a g that varies smoothly, one number or one per node, "
            "got one per cell"
        )
    return march_with_gradients(mesh, h0, slope, nodal_g, True, residual, report)
