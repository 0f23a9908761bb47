"""`Metric`: sizes along orthogonal directions at each node."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_aspect,
    as_float_array,
    as_index_array,
    as_limits,
    as_points,
    as_sizes,
    as_values,
    as_whole_number,
    check_type,
    refuse_where,
)
from adaptsize._kernels.metric_joint import MOST
from adaptsize._pickling import ReadOnlyState
from adaptsize.background import SimplexMesh
from adaptsize.metrics import algebra
from adaptsize.typing import BoolArray, FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Metric(ReadOnlyState):
    r"""Requested edge lengths at nodes that depend on the direction of the edge.

    At each node there are ``dim`` sizes :math:`h_i` along orthogonal directions, the columns of
    R.  In matrix form this is the symmetric positive definite

    .. math:: M = R\, \mathrm{diag}(h_1^{-2}, \dots, h_d^{-2})\, R^T .

    An edge e has the length :math:`\sqrt{e^T M e}` in the metric, which is 1 for the requested
    length.  Note that the eigenvalues of M are not sizes, but :math:`h^{-2}`.

    Parameters
    ----------
    sizes : array_like of float, shape (n, dim)
        Sizes in the unit of the coordinates, positive; inf where there is no bound in a direction.
        They are stored in ascending order.
    directions : array_like of float, shape (n, dim, dim)
        Orthonormal columns: ``sizes[i, k]`` is the size along ``directions[i, :, k]``.

    Raises
    ------
    ValueError
        If a shape is wrong, a size is not positive, or the directions of a node are not
        orthonormal to 1e-6.  The message names the first such node.

    See Also
    --------
    Metric.from_matrices : a metric from matrices M.
    Metric.isotropic : the same size in all directions.

    Examples
    --------
    A size of 0.1 along x and of 1 along y, and the distance from the origin to two points:

    >>> metric = Metric([[1.0, 0.1]], [[[0.0, 1.0], [1.0, 0.0]]])
    >>> metric
    Metric(1 node in 2-D, sizes 0.1 to 1, aspect ratio up to 10)
    >>> metric.matrices[0]
    array([[100.,   0.],
           [  0.,   1.]])
    >>> metric.size_along([0.0, 1.0])
    array([1.])
    """

    sizes: FloatArray
    """float64[n, dim], ascending."""
    directions: FloatArray
    """float64[n, dim, dim]"""

    def __init__(self, sizes: npt.ArrayLike, directions: npt.ArrayLike) -> None:
        h = as_float_array("sizes", sizes)
        if h.ndim != 2 or h.shape[1] not in (1, 2, 3):
            raise ValueError(f"sizes must have shape (n, dim) with dim 1, 2 or 3, got {h.shape}")
        h = as_sizes("sizes", h, h.shape)
        r = as_float_array("directions", directions, (*h.shape, h.shape[1]))
        self._keep(h, algebra.orthonormal(r))

    def _keep(self, h: FloatArray, r: FloatArray) -> None:
        """Store sizes and orthonormal directions in ascending order of the sizes."""
        order = np.argsort(h, axis=1, kind="stable")
        h = np.take_along_axis(h, order, axis=1)
        r = np.take_along_axis(r, order[:, None, :], axis=2)
        for name, array in (("sizes", h), ("directions", r)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)  # needed for a frozen dataclass

    @classmethod
    def of(cls, sizes: FloatArray, directions: FloatArray) -> Metric:
        """Return a metric from checked sizes and orthonormal directions, without checks."""
        metric = cls.__new__(cls)
        metric._keep(sizes, directions)
        return metric

    @classmethod
    def isotropic(cls, h: npt.ArrayLike, dim: int) -> Metric:
        """Return the metric with the same size in all directions.

        Parameters
        ----------
        h : array_like of float, shape (n,)
            Sizes, positive; inf where there is no bound.
        dim : int
            1, 2 or 3.

        Returns
        -------
        Metric

        Examples
        --------
        >>> Metric.isotropic([0.5, 2.0], 3)
        Metric(2 nodes in 3-D, sizes 0.5 to 2, aspect ratio up to 1)
        """
        size = as_float_array("h", h).ravel()
        size = as_sizes("h", size, size.shape)
        dim = as_whole_number("dim", dim, lower=1, upper=3)
        shape = (len(size), dim, dim)
        return cls.of(np.repeat(size[:, None], dim, axis=1), np.broadcast_to(np.eye(dim), shape))

    @classmethod
    def from_matrices(cls, matrices: npt.ArrayLike) -> Metric:
        """Return the metric of symmetric positive definite matrices with entries 1 / length^2.

        Parameters
        ----------
        matrices : array_like of float, shape (n, dim, dim)
            Finite, symmetric to 1e-6 of the largest entry, and positive definite.

        Returns
        -------
        Metric
            The relative error of a size is about 1e-16 times the condition number of its matrix.

        Raises
        ------
        ValueError
            If a matrix is not as required.  The message names the first such node.

        Examples
        --------
        >>> Metric.from_matrices([[[4.0, 0.0], [0.0, 0.25]]]).sizes
        array([[0.5, 2. ]])
        """
        m = as_float_array("matrices", matrices)
        if m.ndim != 3 or m.shape[1] != m.shape[2] or m.shape[1] not in (1, 2, 3):
            raise ValueError(
                f"matrices must have shape (n, dim, dim) with dim 1, 2 or 3, got {m.shape}"
            )
        refuse_where("matrices", ~np.isfinite(m), m, "must be finite")
        algebra.refuse_skew("matrices", m)
        largest = np.abs(m).max(axis=(1, 2), initial=0.0)
        # Scaled to unit size: squares stay in range.
        unit = np.where(largest > 0.0, largest, 1.0)[:, None, None]
        values, vectors = np.linalg.eigh((0.5 * (m + m.swapaxes(1, 2))) / unit)
        refuse_where("matrices", ~(values[:, 0] > 0.0), m, "must be positive definite")
        return cls.of(1.0 / (np.sqrt(values) * np.sqrt(unit[:, :, 0])), vectors)

    @property
    def n(self) -> int:
        """Number of nodes."""
        return len(self.sizes)

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return int(self.sizes.shape[1])

    @property
    def matrices(self) -> FloatArray:
        """float64[n, dim, dim]: the matrices M, zero along directions without a bound."""
        return algebra.assemble(self.directions, self.sizes**-2.0)

    @property
    def lengths(self) -> FloatArray:
        """float64[n, dim, dim]: the matrices L = M^(-1/2), whose eigenvalues are the sizes.

        Not defined where a size is inf: a ValueError names the first node.
        """
        refuse_where("sizes", np.isinf(self.sizes), self.sizes, "must be finite for `lengths`")
        return algebra.assemble(self.directions, self.sizes)

    @property
    def aspect_ratio(self) -> FloatArray:
        """float64[n]: largest size over smallest; 1 where there is no bound at all."""
        with np.errstate(invalid="ignore"):
            ratio = self.sizes[:, -1] / self.sizes[:, 0]
        return np.where(np.isinf(self.sizes[:, 0]), 1.0, ratio)

    @property
    def density(self) -> FloatArray:
        r"""float64[n]: :math:`\sqrt{\det M}`, the volume in the metric per volume."""
        return np.asarray(1.0 / self.sizes.prod(axis=1))

    def __len__(self) -> int:
        return self.n

    def __getitem__(self, nodes: slice | npt.NDArray[np.int_] | BoolArray) -> Metric:
        """Return the metric at some nodes, given as a slice, or an array of numbers or booleans."""
        return Metric.of(np.atleast_2d(self.sizes[nodes]), self.directions[nodes].reshape(
            -1, self.dim, self.dim
        ))  # fmt: skip

    def __repr__(self) -> str:
        nodes = "1 node" if self.n == 1 else f"{self.n} nodes"
        if self.n == 0:
            return f"Metric({nodes} in {self.dim}-D)"
        return (
            f"Metric({nodes} in {self.dim}-D, sizes {self.sizes.min():.3g} to "
            f"{self.sizes.max():.3g}, aspect ratio up to {self.aspect_ratio.max():.3g})"
        )

    def size_along(self, directions: npt.ArrayLike) -> FloatArray:
        r"""Return the requested length of edges in given directions, :math:`1/\sqrt{u^T M u}`.

        Parameters
        ----------
        directions : array_like of float, shape (dim,) or (n, dim)
            One direction for all nodes, or one for each; of any length but zero.

        Returns
        -------
        ndarray of float64, shape (n,)
            inf where there is no bound.
        """
        u = as_values("directions", directions)
        if u.shape not in ((self.dim,), (self.n, self.dim)):
            raise ValueError(
                f"directions must have shape ({self.dim},) or ({self.n}, {self.dim}), got {u.shape}"
            )
        norm = np.linalg.norm(u, axis=-1)
        refuse_where("directions", norm == 0.0, norm, "must not be zero")
        along = np.einsum("nij,ni->nj", self.directions, np.broadcast_to(u, (self.n, self.dim)))
        with np.errstate(divide="ignore"):
            return np.asarray(norm / np.linalg.norm(along / self.sizes, axis=1))

    def edge_lengths(self, points: npt.ArrayLike, edges: npt.ArrayLike) -> FloatArray:
        r"""Return the lengths of edges in the metric.

        With the lengths a and b of an edge in the metrics of its ends, the result is their
        logarithmic mean :math:`(a - b) / \log(a / b)`.  This is the integral along the edge of
        a density that changes geometrically [1]_.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)
        edges : array_like of int, shape (m, 2)

        Returns
        -------
        ndarray of float64, shape (m,)
            1 for edges of the requested length.

        References
        ----------
        .. [1] F. Alauzet, "Size gradation control of anisotropic meshes", Finite Elements in
           Analysis and Design 46 (2010) 181-202.
        """
        x = as_points("points", points, self.dim)
        if len(x) != self.n:
            raise ValueError(f"points must have shape ({self.n}, {self.dim}), got {x.shape}")
        ends = as_index_array("edges", edges, self.n, width=2)
        e = x[ends[:, 1]] - x[ends[:, 0]]
        at_ends = [
            np.linalg.norm(np.einsum("nij,ni->nj", self.directions[v], e) / self.sizes[v], axis=1)
            for v in ends.T
        ]
        return algebra.logarithmic_mean(*at_ends)

    def complexity(self, mesh: SimplexMesh) -> float:
        r"""Return the volume of a mesh in the metric, :math:`\int \sqrt{\det M}\, dx`.

        On curves and surfaces it is the length or area in the metric.  The density is linear in
        each cell.  Cells with a node without a bound count as zero.

        Parameters
        ----------
        mesh : SimplexMesh
            With as many nodes and coordinates as the metric.

        Returns
        -------
        float

        Examples
        --------
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
        >>> from adaptsize import Metric
        >>> round(Metric.isotropic([0.1, 0.1, 0.1], 2).complexity(mesh), 9)
        50.0
        """
        self.check_mesh(mesh)
        return float(algebra.cell_volumes(self.sizes, self.directions, mesh).sum())

    def predicted_elements(self, mesh: SimplexMesh) -> float:
        """Return the number of simplices of unit edges in the metric that fill a mesh.

        The nodes are those of the metric.

        Parameters
        ----------
        mesh : SimplexMesh

        Returns
        -------
        float
            The complexity over the measure of a regular simplex of edge 1.

        Examples
        --------
        >>> from adaptsize.metrics import Metric
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
        >>> round(Metric.isotropic([0.1, 0.1, 0.1], 2).predicted_elements(mesh))
        115
        """
        from adaptsize.metrics.hessian import predicted_elements

        return predicted_elements(self, mesh)

    def check_mesh(self, mesh: SimplexMesh) -> None:
        """Raise a ValueError unless this is a metric at the nodes of a mesh."""
        check_type("mesh", mesh, SimplexMesh)
        if (mesh.n_points, mesh.dim) != (self.n, self.dim):
            raise ValueError(
                f"the metric must have {mesh.n_points} nodes in {mesh.dim}-D, as the mesh has, "
                f"got {self!r}"
            )

    def scaled(self, factor: npt.ArrayLike) -> Metric:
        """Return the metric with all sizes multiplied by a positive number, or one per node."""
        f = as_float_array("factor", factor)
        shape = () if f.ndim == 0 else (self.n,)
        f = as_float_array("factor", f, shape)
        refuse_where("factor", ~((f > 0.0) & np.isfinite(f)), f, "must be finite and > 0")
        return Metric.of(self.sizes * np.reshape(f, (-1, 1)), self.directions)

    def clip(
        self, hmin: float | None = None, hmax: float | None = None, max_aspect: float | None = None
    ) -> Metric:
        """Return the metric with limits on its sizes and aspect ratio.

        Parameters
        ----------
        hmin, hmax : float, optional
            Limits of the sizes, positive.
        max_aspect : float, optional
            Limit of the aspect ratio, at least 1.  Larger sizes are lowered; it is applied last.

        Returns
        -------
        Metric
            With the same directions.
        """
        h = np.clip(self.sizes, *as_limits(hmin, hmax))
        if max_aspect is not None:
            ratio = as_aspect("max_aspect", max_aspect)
            with np.errstate(over="ignore"):  # inf is no limit
                h = np.minimum(h, ratio * h[:, :1])
        return Metric.of(h, self.directions)

    def intersect(self, *others: Metric) -> Metric:
        r"""Return the largest metric that is nowhere above this one and the others.

        No edge may be longer than in any of the given metrics.  Of all such metrics it is the one
        with the least density :math:`\sqrt{\det M}`, which is unique.  For two metrics it is found
        by simultaneous reduction.  The result does not depend on the order of the metrics.

        Parameters
        ----------
        *others : Metric
            With the same number of nodes and coordinates.

        Returns
        -------
        Metric

        Examples
        --------
        Two layers that cross:

        >>> along_x = Metric([[0.1, 1.0]], [[[1.0, 0.0], [0.0, 1.0]]])
        >>> along_y = Metric([[1.0, 0.1]], [[[1.0, 0.0], [0.0, 1.0]]])
        >>> along_x.intersect(along_y).sizes
        array([[0.1, 0.1]])
        """
        if len(others) >= MOST:
            raise ValueError(f"others must be at most {MOST - 1} metrics, got {len(others)}")
        for other in others:
            check_type("others", other, Metric)
            if other.sizes.shape != self.sizes.shape:
                raise ValueError(f"others must have the nodes of {self!r}, got {other!r}")
        if not others:
            return self
        h, r = algebra.intersection(
            [self.sizes, *(other.sizes for other in others)],
            [self.directions, *(other.directions for other in others)],
        )
        return Metric.of(h, r)

    def interpolate(self, indices: npt.ArrayLike, weights: npt.ArrayLike) -> Metric:
        r"""Return the log-Euclidean mean of the metrics of some nodes.

        .. math:: M = \exp \sum_j w_j \log M_j

        The determinant is interpolated geometrically [1]_.

        Parameters
        ----------
        indices : array_like of int, shape (m, k)
            Nodes.
        weights : array_like of float, shape (m, k)
            Barycentric coordinates, for instance.

        Returns
        -------
        Metric
            At m points.  Without a bound where a node with one infinite size has a weight other
            than zero.

        References
        ----------
        .. [1] V. Arsigny, P. Fillard, X. Pennec, N. Ayache, "Log-Euclidean metrics for fast and
           simple calculus on diffusion tensors", Magnetic Resonance in Medicine 56 (2006)
           411-421.

        Examples
        --------
        >>> from adaptsize import Metric
        >>> Metric.isotropic([0.1, 0.4], 2).interpolate([[0, 1]], [[0.5, 0.5]]).sizes
        array([[0.2, 0.2]])
        """
        nodes = as_index_array("indices", indices, self.n)
        w = as_float_array("weights", weights, nodes.shape)
        refuse_where("weights", ~np.isfinite(w), w, "must be finite")
        return Metric.of(*algebra.log_mean(self.sizes, self.directions, nodes, w))
