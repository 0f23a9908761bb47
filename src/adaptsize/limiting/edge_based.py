"""The edge-based scheme, which propagates sizes along edges only; Persson's paper refutes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adaptsize._kernels import edge_based as kernels
from adaptsize.limiting.fast_marching import march_until_converged
from adaptsize.limiting.fast_marching_grid import march_grid_until_converged
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid, SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope


def solve_edge_based(
    mesh: SimplexMesh, h0: FloatArray, slope: Slope, *, report: ProgressCallback
) -> Solution:
    """Solve h_k = min(h0_k, min over edges of h_j + g |x_k - x_j|) exactly.

    These are shortest paths in the graph of the mesh.  Most mesh generators use them for
    gradation.  They do **not** converge to the limited size function when the mesh is
    refined, because fronts follow the edges and not the straight lines between them.  The
    scheme is provided for comparison only.

    Parameters and result are those of `solve_fast_marching`.  No scheme is cheaper.
    """
    return march_until_converged(mesh, h0, slope, kernels.sweep_edges, kernels.march_edges, report)


def solve_grid_edges(
    grid: CartesianGrid,
    h0: FloatArray,
    slope: Slope,
    *,
    report: ProgressCallback,
) -> Solution:
    """Solve h_k = min(h0_k, min over neighbours along the axes of h_j + g_k dx_a) exactly.

    See section 6.2 of Persson's paper.  The scheme does **not** converge to the limited size
    function, because it measures lengths along the axes.  It is used for comparison, and to
    enforce the bound along edges on second-order sizes.  Parameters and result are those of
    `solve_grid_marching`.
    """
    return march_grid_until_converged(grid, h0, slope, 1, True, report)
