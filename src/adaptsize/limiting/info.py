"""`LimitingInfo`: diagnostics of a limited size field."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from adaptsize._kernels.fast_marching import largest_edge_slope
from adaptsize.background import AnyMesh, CartesianGrid, Octree, PartitionedMesh, SimplexMesh
from adaptsize.background.interpolation import cell_gradients
from adaptsize.background.partitioned import local_mesh
from adaptsize.limiting.exact import ExactSolution
from adaptsize.limiting.fast_marching import cells_in
from adaptsize.limiting.gradient_limit import SizeTransform, Slope
from adaptsize.limiting.problem import Problem, Scheme, Solution
from adaptsize.limiting.sources import SizeSources
from adaptsize.ranks import Communicator, SingleRank, kept, values_in_order
from adaptsize.typing import BoolArray, FloatArray

_QUANTILES = (0.5, 0.9, 0.99, 1.0)


@dataclass(frozen=True, eq=False, repr=False)
class LimitingInfo:
    """Diagnostics of a limited size field.

    Slopes are given as multiples of the gradient limit: 1 means "as steep as allowed", also
    where g varies.  With g(h) they are slopes of the transformed size.  Numbers that need a
    pass over all nodes or cells are computed on first access.  For a mesh in parts, they are those
    of the whole mesh, the same on all ranks, and computed at once; only ``iterations`` depends on
    the partition, since ranks repeat work of others.
    """

    scheme: Scheme
    """The scheme that was used, with its options."""
    problem: Problem
    """What it solved, for internal use like the following."""
    solution: Solution
    background: AnyMesh | CartesianGrid | Octree
    transform: SizeTransform | None
    """The change of variable for g(h), of which the sizes of problem and solution are values."""

    def completed(self) -> LimitingInfo:
        """Compute all figures; collective."""
        for name, attribute in vars(LimitingInfo).items():
            if isinstance(attribute, property | kept):
                getattr(self, name)
        return self

    @property
    def _ranks(self) -> Communicator:
        return getattr(self.problem.domain, "ranks", None) or SingleRank()

    def _count(self, chosen: BoolArray) -> int:
        """Return the number of nodes that are chosen on the ranks that own them; collective."""
        domain = self.problem.domain
        if isinstance(domain, PartitionedMesh):
            chosen = chosen & domain.is_owned
        return int(self._ranks.allreduce(int(np.count_nonzero(chosen)), "sum"))

    @property
    def n_points(self) -> int:
        """Number of nodes, also inactive ones of a grid."""
        domain = self.problem.domain
        return domain.n_global_points if isinstance(domain, PartitionedMesh) else domain.n_points

    @property
    def method(self) -> str:
        """Name of the scheme that was used.

        ``"exact (propagated)"`` if paths over edges of a solid were propagated from node to node.
        """
        propagated = isinstance(self.solution, ExactSolution) and self.solution.propagated
        return f"{self.scheme.name} (propagated)" if propagated else self.scheme.name

    @kept
    def iterations(self) -> int:
        """Number of accepted nodes (marching), steps (iterations) or sources (exact method)."""
        return int(self._ranks.allreduce(self.solution.iterations, "sum"))

    @property
    def converged(self) -> bool:
        """Whether the scheme converged; an iteration has to meet its tolerance."""
        return not self.solution.unfinished

    def __repr__(self) -> str:
        """Say which method was used and how many sizes are below their bounds."""
        return (
            f"LimitingInfo({self.method}: {self.n_changed} of {self.n_points} sizes are below h0)"
        )

    @kept
    def n_changed(self) -> int:
        """Number of nodes whose size is now below ``h0``."""
        return self._count(self.solution.h < self.problem.h0)

    @kept
    def n_free(self) -> int:
        """Number of nodes whose size is inf because there is no bound in their component.

        Inactive nodes of a grid are not counted.
        """
        active = getattr(self.problem.domain, "active", None)
        return self._count(np.isinf(self.solution.h) & (True if active is None else active))

    @kept
    def residual(self) -> float:
        """Residual of the discrete equations of the scheme.

        Relative to the largest finite size (marching) or to g (iterations); 0 for the exact
        method.
        """
        return self.solution.residual

    @kept
    def _slopes(self) -> tuple[float, dict[float, float]]:
        domain, u, slope = self.problem.domain, self.solution.h, self.problem.slope
        steepest, ratio = 0.0, np.empty(0)
        if isinstance(domain, CartesianGrid):
            steepest, ratio = _slopes_on_grid(domain, u, slope)
        elif (mesh := local_mesh(domain)) is not None:
            steepest, ratio = _slopes_on_mesh(mesh, u, slope)
        return float(self._ranks.allreduce(steepest, "max")), _quantiles(self._ranks, ratio)

    @property
    def largest_edge_slope(self) -> float:
        """Largest ``(h_i - h_j) / (g |x_i - x_j|)`` over all edges.

        All schemes guarantee a value of at most 1, to rounding.
        """
        return self._slopes[0]

    @property
    def cell_gradient_quantiles(self) -> dict[float, float]:
        """Quantiles (0.5, 0.9, 0.99, 1) of ``|grad h| / g`` of the interpolant.

        Over all cells that are not degenerate; on grids, at the centre of each box.  They may
        exceed 1 around point sources and where fronts meet, even with exact nodal values.
        """
        return self._slopes[1]

    @kept
    def n_proved(self) -> int | None:
        """Number of nodes whose size is proved exact; None for other methods than ``"exact"``.

        In convex domains and in the plane these are all nodes.  In solids these are the nodes
        from which the source of the smallest bound, among visible and hidden ones, is visible.  On
        surfaces these are all nodes, or those within the distance of a source to which all paths
        are searched.
        """
        if not isinstance(self.solution, ExactSolution):
            return None
        n_hidden = self.solution.h.size - self.solution.n_proved
        return self.n_points - int(self._ranks.allreduce(n_hidden, "sum"))

    @kept
    def largest_gap(self) -> float | None:
        """Largest difference between a size that is not proved exact and its lower bound.

        The lower bound is the size that would result if all sources were visible.  On surfaces
        the gap is an estimate: the largest change of a size if fewer paths are searched.  It has
        the unit of the sizes, with g(h) of the transformed size.  It is 0 if all sizes are
        proved exact, and None for other methods than ``"exact"``.
        """
        if not isinstance(self.solution, ExactSolution):
            return None
        return float(self._ranks.allreduce(self.solution.largest_gap, "max"))

    @kept
    def sources(self) -> SizeSources | None:
        """Source of each size; None for other methods than ``"exact"``.

        Also None on grids where sizes propagate through passages without a whole box, and on meshes
        in parts.
        """
        solution = self.solution
        if isinstance(self.background, PartitionedMesh) or not isinstance(solution, ExactSolution):
            return None
        if not solution.parts:
            return None
        return SizeSources.of(self.background, solution, self.problem.h0, self.transform)


def _slopes_on_mesh(mesh: SimplexMesh, u: FloatArray, slope: Slope) -> tuple[float, FloatArray]:
    """Return the steepest edge and |grad u| in each cell with a volume, as multiples of g."""
    steepest = largest_edge_slope(cells_in(mesh), u, (slope.values, slope.step))
    norms = np.linalg.norm(cell_gradients(mesh, u), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(norms > 0.0, norms / slope.values, 0.0)[mesh.measures > 0.0]
    return float(steepest), ratio


def _quantiles(ranks: Communicator, values: FloatArray) -> dict[float, float]:
    """Return quantiles of numbers >= 0 on all ranks, 0 if there are none; collective.

    They are values that occur, not means of two, since a cell with g = 0 may have inf.
    """
    n = ranks.allreduce(len(values), "sum")
    if n == 0:
        return dict.fromkeys(_QUANTILES, 0.0)
    places = np.array([math.ceil((n - 1) * share) for share in _QUANTILES])
    return dict(zip(_QUANTILES, values_in_order(ranks, values, places).tolist(), strict=True))


def _slopes_on_grid(grid: CartesianGrid, u: FloatArray, slope: Slope) -> tuple[float, FloatArray]:
    """Return the steepest edge and |grad u| at the centre of each box, as multiples of g.

    On an edge, g is taken at the end of larger size, as in the update of that node.
    """
    g = np.broadcast_to(
        slope.values.reshape((1,) * grid.dim) if not slope.step else slope.values, grid.shape
    )
    steepest = 0.0
    squares = np.zeros([n - 1 for n in grid.shape])
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(grid.dim):
            lower, upper = _ends(u, axis)
            rise = (upper - lower) / grid.spacing[axis]
            at_upper = np.where(rise > 0.0, _ends(g, axis)[1], _ends(g, axis)[0])
            ratio = np.abs(rise) / at_upper
            ratio = ratio[np.isfinite(rise) & (rise != 0.0)]
            steepest = max(steepest, float(ratio.max(initial=0.0)))
            squares += _averaged(rise, (a for a in range(grid.dim) if a != axis)) ** 2
        norms = np.sqrt(squares)
        ratio = np.where(norms > 0.0, norms / _averaged(g, range(grid.dim)), 0.0)
    # Boxes at inf or inactive nodes have no gradient.
    return steepest, ratio[np.isfinite(norms)]


def _ends(values: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """Return the values at both ends of the edges along an axis."""
    n = values.shape[axis]
    return values.take(range(n - 1), axis), values.take(range(1, n), axis)


def _averaged(values: FloatArray, axes: Iterable[int]) -> FloatArray:
    """Return the means of neighbours along axes: from nodes or edges to the middle of boxes."""
    for axis in axes:
        first, last = _ends(values, axis)
        values = 0.5 * (first + last)
    return values
