"""Formula (11): the closed form in a convex domain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels.exact import lower_by_all_sources
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope


def solve_exact(
    mesh: SimplexMesh, h0: FloatArray, slope: Slope, *, residual: bool, report: ProgressCallback
) -> Solution:
    """Evaluate h(x) = min over nodes y of h0(y) + g |x - y|, to rounding.

    The true limited size where the domain is convex, g is one number and the bound
    is asked for at the nodes only; elsewhere straight lines leave the domain.
    Quadratic in the number of nodes with finite ``h0``: the oracle of tests.

    Raises
    ------
    ValueError
        If g varies in space, or the mesh is a surface or curve in a larger space.
    """
    if slope.step:
        raise ValueError("method='exact' needs one number g or g(h), got g that varies in space")
    if mesh.cell_dim != mesh.dim:
        raise ValueError(f"method='exact' needs a flat domain of full dimension, got {mesh!r}")
    sources = np.flatnonzero(np.isfinite(h0))
    sources = sources[np.argsort(h0[sources], kind="stable")]
    h = h0.copy()
    g = float(slope.values[0])
    chunk = max(1, 50_000_000 // len(sources))
    for first in range(0, mesh.n_points, chunk):
        last = min(first + chunk, mesh.n_points)
        lower_by_all_sources(mesh.points, (0,) * mesh.dim, sources, h0, g, first, last, h)
        report("evaluating formula (11)", last / mesh.n_points)
    return Solution(h, 1, 0.0)
