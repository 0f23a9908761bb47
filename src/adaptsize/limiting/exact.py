"""Formula (11): the closed form in a convex domain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels.exact import lower_by_all_sources
from adaptsize.background import CartesianGrid
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope


def solve_exact(
    background: SimplexMesh | CartesianGrid,
    h0: FloatArray,
    slope: Slope,
    *,
    residual: bool,
    report: ProgressCallback,
) -> Solution:
    """Evaluate h(x) = min over nodes y of h0(y) + g |x - y|, to rounding.

    The true limited size where the domain is convex, g is one number and the bound
    is asked for at the nodes only; elsewhere straight lines leave the domain.
    Quadratic in the number of nodes with finite ``h0``: the oracle of tests.

    Raises
    ------
    ValueError
        If g varies in space, the mesh is a surface or curve in a larger space, or the grid
        has inactive nodes.
    """
    g = slope.number("exact")
    if isinstance(background, CartesianGrid):
        if background.active is not None:
            raise ValueError(
                f"method='exact' needs a convex domain, got inactive nodes: {background!r}"
            )
    elif background.cell_dim != background.dim:
        raise ValueError(
            f"method='exact' needs a flat domain of full dimension, got {background!r}"
        )
    points, bound = background.points, h0.ravel()
    sources = np.flatnonzero(np.isfinite(bound))
    sources = sources[np.argsort(bound[sources], kind="stable")]
    h = bound.copy()
    chunk = max(1, 50_000_000 // len(sources))
    for first in range(0, len(points), chunk):
        last = min(first + chunk, len(points))
        lower_by_all_sources(points, (0,) * points.shape[1], sources, bound, g, first, last, h)
        report("evaluating formula (11)", last / len(points))
    return Solution(h.reshape(h0.shape), 1, 0.0)
