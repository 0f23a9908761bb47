"""Lagrange elements of order 0 to 2 on simplices, continuous or not."""

from __future__ import annotations

from collections.abc import Hashable
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from adaptsize.adaptation.pieces import rule_of
from adaptsize.adaptation.projection import semi_iteration
from adaptsize.background import SimplexMesh
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Relative error of coefficients: below rounding, also in small cells next to large ones.
_ACCURACY = 1e-18


class LagrangeSpace:
    """The functions that are polynomials of an order in each cell.

    Parameters
    ----------
    mesh : SimplexMesh
    order : int
        0 to 2.
    continuous : bool
        No effect for order 0.
    """

    def __init__(self, mesh: SimplexMesh, order: int, continuous: bool) -> None:
        self.mesh, self.degree = mesh, order
        self.continuous = continuous and order > 0
        self._pairs = list(combinations(range(mesh.cell_dim + 1), 2))

    @cached_property
    def dofs(self) -> IntArray:
        """The numbers of the nodes of each cell, int32[n_cells, k]."""
        mesh = self.mesh
        if not self.continuous:
            width = {0: 1, 1: mesh.cell_dim + 1}.get(self.degree, 0)
            width = width or mesh.cell_dim + 1 + len(self._pairs)
            return np.arange(mesh.n_cells * width, dtype=np.int32).reshape(-1, width)
        if self.degree == 1:
            return mesh.cells
        ends = np.sort(mesh.cells[:, self._pairs], axis=2).astype(np.int64)
        first, second = mesh.edges.astype(np.int64).T
        middles = np.searchsorted(
            first * mesh.n_points + second, ends[..., 0] * mesh.n_points + ends[..., 1]
        )
        return np.hstack([mesh.cells, mesh.n_points + middles]).astype(np.int32)

    @property
    def key(self) -> Hashable:
        """Equal for equal spaces on a mesh."""
        return self.degree, self.continuous

    @property
    def n(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.shape))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the values at the nodes."""
        mesh = self.mesh
        if self.continuous:
            return (mesh.n_points + (len(mesh.edges) if self.degree == 2 else 0),)
        return (mesh.n_cells,) if self.degree == 0 else self.dofs.shape

    @cached_property
    def nodes(self) -> FloatArray:
        """Coordinates of the nodes, float64[n, dim]."""
        mesh = self.mesh
        if self.continuous:
            middles = mesh.points[mesh.edges].mean(axis=1)
            return np.vstack([mesh.points, middles]) if self.degree == 2 else mesh.points
        corners = mesh.points[mesh.cells]
        if self.degree == 0:
            return np.asarray(corners.mean(axis=1))
        parts = [corners]
        if self.degree == 2:
            parts.append(corners[:, self._pairs].mean(axis=2))
        return np.concatenate(parts, axis=1).reshape(-1, mesh.dim)

    def functions(self, places: FloatArray) -> FloatArray:
        """Return the functions of a cell at barycentric coordinates, float64[..., k]."""
        if self.degree == 0:
            return np.ones((*places.shape[:-1], 1))
        if self.degree == 1:
            return places
        edges = [4.0 * places[..., i] * places[..., j] for i, j in self._pairs]
        return np.concatenate([places * (2.0 * places - 1.0), np.stack(edges, axis=-1)], axis=-1)

    @cached_property
    def means(self) -> FloatArray:
        """Means over a cell of its functions."""
        rule = rule_of(self.mesh.cell_dim, self.degree)
        return np.asarray(rule.weights @ self.functions(rule.places))

    @cached_property
    def integrals(self) -> FloatArray:
        """Integrals of the functions, float64[n]."""
        of_cells = self.mesh.measures[:, None] * self.means
        return np.bincount(self.dofs.ravel(), of_cells.ravel(), self.n).astype(np.float64)

    def values(self, held: npt.NDArray[Any], cells: IntArray, places: FloatArray) -> FloatArray:
        """Return the values of columns of coefficients at places in cells, float64[p, q, c]."""
        return np.asarray(self.functions(places) @ held[self.dofs[cells]])

    def load(self, cells: IntArray, places: FloatArray, values: FloatArray) -> FloatArray:
        """Return the sums of values times the functions of the space, float64[n, c]."""
        of_pieces = np.swapaxes(self.functions(places), 1, 2) @ values
        rows = self.dofs[cells].ravel()
        sums = csr_array(
            (np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(self.n, len(rows))
        )
        return np.asarray(sums @ of_pieces.reshape(len(rows), values.shape[2]))

    @cached_property
    def is_loose(self) -> BoolArray:
        """Which nodes are in no cell with a measure, bool[n]."""
        measures = np.repeat(self.mesh.measures, self.dofs.shape[1])
        return np.asarray(np.bincount(self.dofs.ravel(), measures.ravel(), self.n) == 0.0)

    @cached_property
    def _of_cell(self) -> FloatArray:
        """The mass matrix of a cell of measure 1."""
        rule = rule_of(self.mesh.cell_dim, 2 * self.degree)
        at = self.functions(rule.places)
        return np.asarray(at.T @ (rule.weights[:, None] * at))

    def solve(self, load: FloatArray) -> FloatArray:
        """Return the coefficients of the functions whose products with the space are ``load``.

        They are 0 where there is no cell with a measure.
        """
        measures = self.mesh.measures
        if not self.continuous:
            by_cell = load.reshape(*self.dofs.shape, load.shape[1])
            found = np.linalg.solve(self._of_cell, by_cell)
            inverse = np.divide(1.0, measures, out=np.zeros_like(measures), where=measures > 0.0)
            return np.asarray((inverse[:, None, None] * found).reshape(self.n, -1))
        of_cells = measures[:, None, None] * self._of_cell
        rows = np.broadcast_to(self.dofs[:, :, None], of_cells.shape)
        columns = np.broadcast_to(self.dofs[:, None, :], of_cells.shape)
        mass = csr_array((of_cells.ravel(), (rows.ravel(), columns.ravel())), (self.n, self.n))
        diagonal = mass.diagonal()[:, None]
        inverse = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)
        scale = 1.0 / np.sqrt(np.diag(self._of_cell))
        smallest, *_, largest = np.linalg.eigvalsh(scale[:, None] * self._of_cell * scale)
        ends = float(smallest), float(largest)
        start = inverse * load
        return semi_iteration(lambda u: inverse * (load - mass @ u), start, ends, _ACCURACY)[0]
