"""The records by which fields of finite elements, and data at points of quadrature, are given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_flag,
    as_plain_array,
    as_values,
    as_whole_number,
    describe,
    refuse_where,
)
from adaptsize.adaptation.lagrange import LagrangeSpace
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.typing import FloatArray


@dataclass(frozen=True, eq=False)
class ElementField:
    """A field of Lagrange elements of order 0 to 2, as `adapt` and `transfer_fields` take it.

    It is projected onto the same elements of the new mesh (L2), so that its integral is kept.

    Parameters
    ----------
    values : array_like or callable
        Values at the nodes of the elements, which `nodes` returns, of any trailing shape.
        Or a function of points, float64[n, dim], which is integrated on each mesh anew.
    order : int, default 1
        0 to 2.
    continuous : bool, default True
        Whether cells share nodes.  Elements of order 0 are discontinuous.
    log : bool, default False
        Transfer the logarithms of symmetric positive definite matrices, shape (..., d, d), so that
        they stay positive at the nodes.  The integral changes then.

    Examples
    --------
    >>> old = SimplexMesh([[0, 0], [2, 0], [0, 2]], [[0, 1, 2]])
    >>> new = SimplexMesh([[0, 0], [2, 0], [0, 2], [1, 1]], [[0, 1, 3], [0, 3, 2]])
    >>> x = ElementField.nodes(old, 2)
    >>> x[3:].tolist()
    [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    >>> from adaptsize import transfer_fields
    >>> made = transfer_fields(old, new, fields={"u": ElementField(x[:, 0] ** 2, order=2)})
    >>> bool(np.allclose(made.fields["u"].values, ElementField.nodes(new, 2)[:, 0] ** 2))
    True
    """

    values: Any
    order: int = 1
    continuous: bool = True
    log: bool = False

    def __post_init__(self) -> None:
        as_whole_number("order", self.order, lower=0, upper=2)
        as_flag("continuous", self.continuous)
        if as_flag("log", self.log) and callable(self.values):
            raise ValueError("log must be False if values is a function")

    @staticmethod
    def nodes(mesh: SimplexMesh, order: int, *, continuous: bool = True) -> FloatArray:
        """Return the nodes of the elements of a mesh, in the order of ``values``.

        Parameters
        ----------
        mesh : SimplexMesh
        order : int
            0 to 2.
        continuous : bool, default True
            Whether cells share nodes.

        Returns
        -------
        ndarray of float64
            Of continuous elements shape (n, dim): the nodes of the mesh, for order 2 followed by
            the middles of ``mesh.edges``.  Of discontinuous ones shape (n_cells, k, dim): the
            corners of each cell, for order 2 followed by the middles of its edges (0, 1), (0, 2),
            ... (2, 3); for order 0 shape (n_cells, dim), the centroids.
        """
        mesh = as_mesh("mesh", mesh)
        order = as_whole_number("order", order, lower=0, upper=2)
        space = LagrangeSpace(mesh, order, as_flag("continuous", continuous))
        return space.nodes.reshape(*space.shape, mesh.dim)

    @staticmethod
    def at_points(
        values: npt.ArrayLike,
        points: npt.ArrayLike,
        weights: npt.ArrayLike,
        *,
        log: bool = False,
    ) -> QuadratureField:
        """Return data at points of quadrature in each cell as a field.

        In each cell they are represented by the polynomial of order 0 to 2 that fits them best,
        which is projected onto those of the new mesh and evaluated at its points (L2).  The
        integral by the rule is kept.

        Parameters
        ----------
        values : array_like of float, shape (n_cells, n, ...)
        points : array_like of float, shape (n, dim)
            The points in the simplex with a corner at the origin, which is the first node of a
            cell, and the others at distance 1 along the axes.
        weights : array_like of float, shape (n,)
            Positive.  Only their ratios count.
        log : bool, default False
            As for other elements.

        Returns
        -------
        QuadratureField
            With ``values``, ``points``, ``weights`` and ``log``.
        """
        places = as_values("points", points)
        if places.ndim != 2 or len(places) == 0:
            raise ValueError(f"points must have shape (n, dim), got {places.shape}")
        rule = as_values("weights", weights, (len(places),))
        refuse_where("weights", rule <= 0.0, rule, "must be positive")
        data = as_plain_array("values", values)
        if data.dtype.kind not in "biufc" or data.ndim < 2 or data.shape[1] != len(places):
            raise ValueError(
                f"values must be numbers of shape (n_cells, {len(places)}, ...), got "
                f"{describe(values)}"
            )
        kind = np.complex128 if data.dtype.kind == "c" else np.float64
        return QuadratureField(data.astype(kind), places, rule, as_flag("log", log))


@dataclass(frozen=True, eq=False)
class QuadratureField:
    """Data at points of quadrature in each cell, see `ElementField.at_points`."""

    values: Any
    points: Any
    weights: Any
    log: bool = False
