r"""The L2 projection of nodal fields onto the linear elements of another mesh.

The projection :math:`u = \sum_j u_j \phi_j` of a field :math:`v` has the same integrals with all
hat functions :math:`\phi_i` of the new mesh:

.. math::

    M u = b, \qquad M_{ij} = \int \phi_i \phi_j, \qquad b_i = \int \phi_i v = \sum_j B_{ij} v_j.

The mixed mass matrix :math:`B` holds integrals over the intersections of the cells of both meshes
[1]_.  The sum of all equations says that the integral is preserved, because the hat functions sum
to 1.  Where the new domain extends beyond the old one, the interpolated field continues :math:`v`.

References
----------
.. [1] P. E. Farrell, M. D. Piggott, C. C. Pain, G. J. Gorman, C. R. Wilson, "Conservative
   interpolation between unstructured meshes via supermesh construction", Comput. Methods Appl.
   Mech. Eng. 198 (2009) 2632-2642.
.. [2] A. J. Wathen, "Realistic eigenvalue bounds for the Galerkin mass matrix", IMA J. Numer.
   Anal. 7 (1987) 449-457.
.. [3] A. J. Wathen, T. Rees, "Chebyshev semi-iteration in preconditioning for problems including
   the mass matrix", Electron. Trans. Numer. Anal. 34 (2009) 125-135.
.. [4] D. Kuzmin, M. Moeller, J. N. Shadid, M. Shashkov, "Failsafe flux limiting and constrained
   data projections for equations of gas dynamics", J. Comput. Phys. 229 (2010) 8766-8779.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from adaptsize._kernels.simplex import add_mass
from adaptsize.background._mesh_arrays import read_only
from adaptsize.ranks import SharedNodes
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Relative error of the solution of M u = b.
_ACCURACY = 1e-13

#: Share of the range of a field by which bounds may be exceeded before fluxes are limited, and of
#: the integral of a hat function that may be missing.
_ROUNDING = 1e-12


def sums_over(matrix: csr_array, columns: FloatArray, n_bounded: int = 0) -> FloatArray:
    """Return the sums of the rows of a matrix, its products with columns, and ranges.

    The ranges are the least values and then the largest ones, of the first ``n_bounded`` columns at
    the nodes in a row.  With the mixed mass matrix, this is what the projection needs.
    """
    parts = [np.asarray(matrix.sum(axis=1)).reshape(-1, 1), matrix @ columns]
    rows = np.flatnonzero(np.diff(matrix.indptr))
    if n_bounded and len(rows):
        values = columns[matrix.indices, :n_bounded]
    for merge, neutral in ((np.minimum, np.inf), (np.maximum, -np.inf)):
        extreme = np.full((matrix.shape[0], n_bounded), neutral)
        if n_bounded and len(rows):
            extreme[rows] = merge.reduceat(values, matrix.indptr[rows], axis=0)
        parts.append(extreme)
    return np.hstack(parts)


def semi_iteration(
    rest_of: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    ends: tuple[float, float],
    accuracy: float = _ACCURACY,
) -> tuple[FloatArray, FloatArray]:
    """Return the solution of M u = b by the Chebyshev semi-iteration [3]_, and the last residual.

    The eigenvalues of a preconditioned mass matrix are between those of its cells [2]_, which are
    the same for all cells.  So the number of steps is known, without scalar products, and does not
    depend on the mesh.

    Parameters
    ----------
    rest_of : callable
        Returns the preconditioned residual of columns.
    start : float64[n, k]
    ends : tuple of float
        The smallest and the largest eigenvalue.
    accuracy : float
        Share of the error of ``start`` that is left.  That of small cells next to large ones is
        larger, by up to the square root of the ratio of their measures.
    """
    middle, radius = 0.5 * (ends[1] + ends[0]), 0.5 * (ends[1] - ends[0])
    ratio = middle / radius
    steps = math.ceil(math.acosh(1.0 / accuracy) / math.acosh(ratio))
    found = np.array(start, np.float64, order="C")
    rest = rest_of(found)
    step = rest / middle
    rho = 1.0 / ratio
    for _ in range(steps):
        found += step
        rest = rest_of(found)
        before, rho = rho, 1.0 / (2.0 * ratio - rho)
        step = rho * before * step + (2.0 * rho / radius) * rest
    return found, rest


class Projection:
    """The projection onto the linear elements of a mesh, or of one part of it.

    Parameters
    ----------
    cells : int32[n_cells, k]
    measures : float64[n_cells]
    shared : SharedNodes
        The nodes that other ranks hold, too.
    n_points : int
    """

    def __init__(
        self, cells: IntArray, measures: FloatArray, shared: SharedNodes, n_points: int
    ) -> None:
        k = cells.shape[1]
        self.cells = np.ascontiguousarray(cells)
        self.shared = shared
        self._n = n_points
        # The mass matrix of a cell is this share times 1 + delta_ij.
        self._share = measures / (k * (k + 1))
        #: Integrals of the hat functions, the lumped mass matrix.
        self.lumped = self._gathered(np.repeat((k + 1) * self._share[:, None], k, axis=1))
        self._inverse = np.zeros(n_points)
        np.divide(1.0, self.lumped, out=self._inverse, where=self.lumped > 0.0)

    def field(
        self, sums: FloatArray, interpolated: Callable[[], FloatArray], n_bounded: int
    ) -> FloatArray:
        """Return the projected columns; collective.

        Parameters
        ----------
        sums : float64[n_points, 1 + k + 2 n_bounded]
            Those of `sums_over`, of this rank.
        interpolated : callable
            Returns the values at the nodes, float64[n_points, k], which count where the old domain
            does not extend and at nodes in no cell; collective.
        n_bounded : int
            So many columns, the first ones, keep within the range of the old values nearby.
        """
        ends = sums.shape[1] - 2 * n_bounded, sums.shape[1] - n_bounded
        merges = zip(np.split(sums, ends, axis=1), (np.add, np.minimum, np.maximum), strict=True)
        sums, low, high = (
            self.shared.merge(part, merge) if part.shape[1] else part for part, merge in merges
        )
        load, outside = sums[:, 1:], self.lumped - sums[:, 0]
        covered = np.abs(outside) < _ROUNDING * self.lumped
        start = load * self._inverse[:, None]
        if self.shared.ranks.allreduce(int(not covered.all()), "max"):
            values = interpolated()
            load = load + np.where(covered, 0.0, outside)[:, None] * values
            start = np.where(self.lumped[:, None] > 0.0, load * self._inverse[:, None], values)
            low, high = (
                np.minimum(low, values[:, :n_bounded]),
                np.maximum(high, values[:, :n_bounded]),
            )
        found = self._solved(load, start)
        for j in range(n_bounded):
            found[:, j] = self._within(found[:, j], low[:, j], high[:, j])
        return found

    def _solved(self, load: FloatArray, start: FloatArray) -> FloatArray:
        r"""Return the solution of M u = b by the Chebyshev semi-iteration [3]_.

        Preconditioned by lumping, the eigenvalues are between 1 / (d + 2) and 1.  The last step is
        one of the preconditioner, after which the integral is exact.
        """
        ends = 1.0 / (self.cells.shape[1] + 1), 1.0
        found, rest = semi_iteration(lambda u: self._rest(load, u), start, ends)
        return np.asarray(found + rest)

    def _rest(self, load: FloatArray, found: FloatArray) -> FloatArray:
        """Return the preconditioned residual."""
        product = np.zeros_like(found)
        add_mass(read_only(self.cells), self._share, found, product)
        rest: FloatArray = load - self.shared.merge(product, np.add)
        rest *= self._inverse[:, None]
        return rest

    def _within(self, found: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        r"""Return values between bounds with the same integral: flux-corrected transport [4]_.

        With lumping, :math:`b_i / L_i` is a mean of old values and so within the bounds.  The
        projection differs from it by fluxes between the nodes of each cell, which sum to zero.
        They are kept, except in cells at whose nodes the bounds would be exceeded, where they are
        multiplied by the largest factor for which no node can exceed its bounds.
        """
        ranks, used = self.shared.ranks, self.lumped > 0.0
        ends = np.array([-low[used].min(initial=np.inf), high[used].max(initial=-np.inf)])
        slack = _ROUNDING * max(float(ranks.allreduce(ends, "max").sum()), 0.0)
        cells = self.cells
        values = found[cells]
        flux = self._share[:, None] * (cells.shape[1] * values - values.sum(axis=1)[:, None])
        limited = np.zeros(len(cells), np.bool_)
        base = found
        while True:
            exceeded = used & ((base < low - slack) | (base > high + slack))
            more = exceeded[cells].any(axis=1) & ~limited
            if not ranks.allreduce(int(more.any()), "max"):
                break
            limited |= more
            base = found - self._inverse * self._gathered(flux, limited)
        if base is not found:
            base = base + self._inverse * self._scaled_fluxes(base, flux, limited, (low, high))
        return np.clip(base, low, high)

    def _scaled_fluxes(
        self,
        base: FloatArray,
        flux: FloatArray,
        where: BoolArray,
        bounds: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """Return the sums of fluxes, multiplied by factors for which the bounds hold (Zalesak)."""
        low, high = bounds
        factor = np.ones(len(self.cells))
        for sign, bound in ((1.0, high), (-1.0, low)):
            part = np.maximum(sign * flux, 0.0)
            most = self._gathered(part, where)
            room = np.maximum(self.lumped * (sign * (bound - base)), 0.0)
            share = np.ones(self._n)
            np.divide(room, most, out=share, where=most > room)
            corners = np.where(part > 0.0, share[self.cells], 1.0)
            factor = np.minimum(factor, corners.min(axis=1))
        return self._gathered(factor[:, None] * flux, where)

    def _gathered(self, by_corner: FloatArray, where: BoolArray | None = None) -> FloatArray:
        """Return the sums at the nodes of values at the corners of cells, of some cells."""
        cells = self.cells
        if where is not None:
            cells, by_corner = cells[where], by_corner[where]
        # bincount of nothing is an array of integers.
        sums = np.bincount(cells.ravel(), by_corner.ravel(), self._n).astype(np.float64)
        return np.asarray(self.shared.merge(sums, np.add))
