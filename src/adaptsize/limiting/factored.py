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

    Besides size and gradient (see `solve_hermite`) each node keeps the node z whose size
    controls it.  On an edge with one source z for both its ends, sizes are

    .. math:: h_z + G(s) \, |x(s) - z|, \qquad G_a = (h_a - h_z) / |x_a - z|

    with the cubic Hermite interpolant G of the mean slopes.  G is smooth up to z, where h
    has the tip of a cone [1]_; with constant g it is constant and the update exact.
    Edges without one source get the Hermite update, which is also that of sources side
    by side: sizes given along a boundary, or everywhere.

    In a convex domain an edge between the regions of two single sources lets both
    through, as if each region went on.  Where the boundary turns inwards paths
    bend, and the node there becomes the source of what lies in its shadow; on lines
    of shadow the Hermite update takes over.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane.
    h0 : float64[n]
        inf allowed.
    slope : Slope
        One limit; used if ``nodal_g`` is None.
    nodal_g : float64[n] or None
        A limit that varies smoothly, linear between the nodes.
    residual : bool
    report : callable

    Returns
    -------
    Solution
        As from `solve_hermite`.  With constant g in a convex domain and single
        points as sources: the exact sizes to rounding at all nodes that a path of
        updates reaches, which on Delaunay meshes was every node.  With smooth g second order.

    Raises
    ------
    ValueError
        If the mesh is not one of triangles in the plane, or g is given per cell.

    Notes
    -----
    Cost: about twice that of fast marching.  What `solve_hermite` does not keep to
    rounding this does not either.

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
