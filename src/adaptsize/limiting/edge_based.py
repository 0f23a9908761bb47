"""The edge-based scheme, which propagates sizes along edges only; Persson's paper refutes it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from adaptsize.background import AnyMesh, CartesianGrid
from adaptsize.limiting.fast_marching import march_grid, march_mesh
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.problem import Problem, Scheme, Solution
from adaptsize.typing import FloatArray, ProgressCallback


@dataclass(frozen=True)
class EdgeBased(Scheme):
    r"""Shortest paths along edges, as most mesh generators use them for gradation.

    .. math:: h_k = \min(h_{0,k}, \min_j h_j + g |x_k - x_j|) \quad \text{over edges } jk

    They do **not** converge to the limited size function when the mesh is refined, because fronts
    follow the edges and not the straight lines between them [1]_.  The scheme is meant for
    comparison only.  On grids, g is that of node k.

    References
    ----------
    .. [1] P.-O. Persson, Engineering with Computers 22 (2006) 95-109, section 6.2.
    """

    name: ClassVar[str] = "edge-based"

    def solve(self, problem: Problem) -> Solution:
        """Solve a problem exactly; ``iterations`` is the number of accepted nodes."""
        if isinstance(problem.domain, CartesianGrid):
            return march_grid(problem, along_edges=True)
        return march_mesh(problem, along_edges=True)


def limit_along_edges(
    mesh: AnyMesh, h: FloatArray, g: float, report: ProgressCallback
) -> FloatArray:
    """Return sizes, lowered where they exceed a neighbour by more than g allows; collective."""
    return EdgeBased().solve(Problem(mesh, h, Slope(np.array([g])), report=report)).h
