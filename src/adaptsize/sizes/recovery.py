"""Recovered derivatives of nodal fields, and an error estimate from them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations_with_replacement, pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_float_array, as_values
from adaptsize._workers import in_all_threads
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background.interfaces import divided_by_region
from adaptsize.background.interpolation import cell_gradients
from adaptsize.background.simplex import as_mesh
from adaptsize.background.surroundings import surroundings_of
from adaptsize.background.topology import marked
from adaptsize.sizes import tuning
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array  # slow to import

# Pairs of nodes in a part of the work, of which each thread has its own: 24 MB in space.
_PAIRS_AT_ONCE = 30_000


def recovered_gradient(mesh: SimplexMesh, values: npt.ArrayLike) -> FloatArray:
    """Return the gradient of a nodal field at the nodes, by polynomial preserving recovery.

    At each node a quadratic is fitted to the values at the node and its neighbours, by least
    squares, and differentiated there [1]_.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra.
    values : array_like of float, shape (n_points,)
        Finite, for instance a finite element solution at the nodes.

    Returns
    -------
    ndarray of float64, shape (n_points, dim)
        Zero at nodes in no cell.  At nodes between regions (cell tags), the mean of the gradients
        on all sides.

    Raises
    ------
    ValueError
        If the cells do not have the dimension of the space, 2 or 3, or the values have another
        shape or are not finite.

    Notes
    -----
    In each region, the gradient is recovered from the values in that region, since it jumps between
    materials.

    The recovery is exact for quadratic fields on any mesh whose patches determine a quadratic.  It
    is therefore of second order in the spacing for smooth fields, also at the boundary.  A patch
    consists of the nodes that share an edge with the node.  At the boundary, and where these do
    not determine a quadratic well, their neighbours are added.  If that is not sufficient, a
    linear function is fitted.  The cost is O(n): 10 to 20 microseconds per node in the plane,
    about 40 in space.

    References
    ----------
    .. [1] Z. Zhang, A. Naga, "A new finite element gradient recovery method:
       superconvergence property", SIAM J. Sci. Comput. 26 (2005) 1192-1213.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.spatial import Delaunay
    >>> points = np.random.default_rng(7).random((50, 2))
    >>> mesh = SimplexMesh(points, Delaunay(points).simplices)
    >>> gradient = recovered_gradient(mesh, points[:, 0] * points[:, 1])
    >>> bool(np.allclose(gradient, points[:, ::-1]))
    True
    """
    mesh = as_mesh("mesh", mesh)
    found, nodes, _ = _in_regions(mesh, as_nodal_field(values, mesh), _gradients)
    copies = np.bincount(nodes, minlength=mesh.n_points)
    total = np.zeros(mesh.points.shape)
    np.add.at(total, nodes, found)
    return np.asarray(total / np.maximum(copies, 1)[:, None])


def recovered_hessian(mesh: AnyMesh, values: npt.ArrayLike) -> FloatArray:
    r"""Return the second derivatives of a nodal field at the nodes.

    They are those of a quadratic, fitted by weighted least squares to the values at the nodes up
    to two edges away.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Triangles in the plane or tetrahedra.
    values : array_like of float, shape (n_points,)
        Finite.

    Returns
    -------
    ndarray of float64, shape (n_points, dim, dim)
        Symmetric.  Zero at nodes in no cell.

    Raises
    ------
    ValueError
        If the cells do not have the dimension of the space, 2 or 3, or the values have another
        shape or are not finite.

    Notes
    -----
    In coordinates z in which the patch has unit covariance, node i has the weight
    :math:`e^{-|z_i|^2 / (2 \\sigma^2)}` with :math:`\\sigma = 0.7`.  On stretched meshes distances
    are thus measured relative to the stretched patch.

    In each region (cell tag) they are recovered from the values in that region, since gradients
    jump between materials.  At nodes between regions, those of the region with the largest ones
    are returned.

    The recovery is exact for quadratic fields.  For smooth fields it is of first order in the
    spacing on irregular meshes, and of second order on translation-invariant meshes.  (Repeated
    averaging of cell gradients does not converge on irregular meshes.)  Fields must be smooth on
    the scale of the mesh: noise e becomes e / h^2.  Where a patch does not determine all second
    derivatives, as in a plate with one layer of cells, the fit of least norm is taken.  The cost is
    O(n): about 10 microseconds per node in the plane, and 20 in space.

    The recovered gradient of the recovered gradient [1]_ has a smaller error for smooth fields,
    and a larger one for finite element solutions and in layers, which its larger patches smear.

    References
    ----------
    .. [1] H. Guo, Z. Zhang, R. Zhao, "Hessian recovery for finite element methods",
       Mathematics of Computation 86 (2017) 1671-1692.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.spatial import Delaunay
    >>> x = np.random.default_rng(7).random((50, 2))
    >>> mesh = SimplexMesh(x, Delaunay(x).simplices)
    >>> hessian = recovered_hessian(mesh, x[:, 0] ** 2 + 3.0 * x[:, 0] * x[:, 1])
    >>> bool(np.allclose(hessian, [[2.0, 3.0], [3.0, 0.0]]))
    True
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)
    return second_derivatives(mesh, mesh.ranks.agree(lambda: as_nodal_field(values, mesh)))


@recorded("zz_indicator")
def zz_indicator(mesh: SimplexMesh, values: npt.ArrayLike) -> FloatArray:
    r"""Return the Zienkiewicz-Zhu error indicator of a linear finite element solution.

    It is the difference of the gradient, constant in each cell, and the recovered gradient G u,
    linear in each cell [1]_,

    .. math:: \eta_K^2 = \int_K |G u - \nabla u|^2 ,

    with G by polynomial preserving recovery [2]_.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra.
    values : array_like of float, shape (n_points,) or (n_points, k)
        Nodal values of a continuous function that is linear in each cell, or of k of them, for
        instance displacements.

    Returns
    -------
    ndarray of float64, shape (n_cells,)
        ``sqrt(sum(eta**2))`` estimates the error of the gradient in the L2 norm, of k functions
        the root of the sum of squares; zero in cells without volume.

    Raises
    ------
    ValueError
        If the cells do not have the dimension of the space, 2 or 3, or the values have another
        shape or are not finite.

    Notes
    -----
    The ratio of estimate and error tends to 1 under refinement where the solution is smooth and
    the mesh is sufficiently regular.  It is an estimate, not a bound.  In each region (cell tag)
    the gradient is recovered from the values in that region, since it jumps between materials.

    References
    ----------
    .. [1] O. C. Zienkiewicz, J. Z. Zhu, "A simple error estimator and adaptive procedure
       for practical engineering analysis", Int. J. Numer. Methods Eng. 24 (1987) 337-357.
    .. [2] A. Naga, Z. Zhang, "A posteriori error estimates based on the polynomial
       preserving recovery", SIAM J. Numer. Anal. 42 (2004) 1780-1800.

    Examples
    --------
    Linear functions have no error:

    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1], [1, 1]], [[0, 1, 2], [1, 3, 2]])
    >>> zz_indicator(mesh, [0.0, 2.0, 1.0, 3.0]).round(9)
    array([0., 0.])
    """
    mesh = as_mesh("mesh", mesh)
    columns = as_float_array("values", values)
    one = columns.ndim < 2 or columns.shape[1] == 0  # the latter is refused
    squares = np.zeros(mesh.n_cells)
    for column in [columns] if one else columns.T:
        squares += _squared_defects(mesh, as_nodal_field(column, mesh))
    # The exact integral of the square of a function that is linear in a simplex.
    d = mesh.dim
    return np.asarray(np.sqrt(mesh.measures * squares / ((d + 1) * (d + 2))))


def _squared_defects(mesh: SimplexMesh, nodal: FloatArray) -> FloatArray:
    """Return in each cell the squared defects of the gradient, of the corners and of their sum."""
    recovered, _, cells = _in_regions(mesh, nodal, _gradients)
    defect = recovered[cells] - cell_gradients(mesh, nodal)[:, None]
    return np.asarray((defect**2).sum(axis=(1, 2)) + (defect.sum(axis=1) ** 2).sum(axis=1))


def _in_regions(
    mesh: SimplexMesh,
    nodal: FloatArray,
    recover: Callable[[SimplexMesh, FloatArray], FloatArray],
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return derivatives at the nodes, recovered in each region on its own.

    Nodes on interfaces are there once for each of their regions.  A linear function fits the values
    of a single cell exactly, so that they would have no error: the whole mesh is taken there.

    Returns
    -------
    derivatives : float64[m, ...]
    nodes : int32[m]
        The node of the mesh at each row.
    cells : int32[n_cells, dim + 1]
        The rows of each cell.
    """
    divided = divided_by_region(mesh)
    if divided is None:
        return recover(mesh, nodal), np.arange(mesh.n_points, dtype=np.int32), mesh.cells
    apart, nodes = divided
    found = recover(apart, nodal[nodes])
    near = nodes_within_an_edge(apart)
    alone = np.diff((near @ near).indptr) <= mesh.dim + 1
    if alone.any():
        found[alone] = recover(mesh, nodal)[nodes[alone]]
    return found, nodes, apart.cells


def _gradients(mesh: SimplexMesh, nodal: FloatArray) -> FloatArray:
    """Return the gradients of fits around each node, see `recovered_gradient`."""
    near, gradient = nodes_within_an_edge(mesh), np.empty(mesh.points.shape)
    inner = np.flatnonzero(~marked(mesh.facets[mesh.facet_cell_counts == 1], mesh.n_points))
    least = tuning.DETERMINED_WITHIN_AN_EDGE
    gradient[inner], good = _gradients_of_fits(mesh.points, nodal, near[inner], inner, least)
    others = np.setdiff1d(np.arange(mesh.n_points), inner[good])
    wide = near[others] @ near
    gradient[others] = _gradients_of_fits(mesh.points, nodal, wide, others, tuning.DETERMINED)[0]
    return gradient


def _gradients_of_fits(
    points: FloatArray, nodal: FloatArray, patches: csr_array, nodes: LongArray, least: float
) -> tuple[FloatArray, BoolArray]:
    """Return the gradients of fits to a field, and where quadratics were fitted, else linear ones.

    Parameters
    ----------
    points : float64[n, dim]
    nodal : float64[n]
    patches : csr_array
        Its entries in row r are the nodes of the patch around ``nodes[r]``.
    nodes : int64[m]
    least : float
        Smallest eigenvalue of a normal matrix over the largest, for quadratics to be fitted.
    """
    dim = points.shape[1]
    gradients, good = np.empty((len(nodes), dim)), np.empty(len(nodes), np.bool_)

    def fit(part: PatchPart) -> None:
        away = points[part.members] - points[nodes[part.rows]][part.patch]
        unit, to_unit = in_unit_covariance(away, part)
        monomials = monomials_of(unit)
        products = sums_of_products(monomials, part.starts)
        slopes, good[part.rows] = _slopes_of_fits(products, dim, least)
        in_unit = np.einsum("pdk,kp->pd", slopes[part.patch], monomials)
        weights = np.einsum("pij,pj->pi", to_unit[part.patch], in_unit)
        gradients[part.rows] = np.add.reduceat(weights * nodal[part.members, None], part.starts)

    for_parts(fit, patches)
    return gradients, good


def _slopes_of_fits(normal: FloatArray, dim: int, least: float) -> tuple[FloatArray, BoolArray]:
    """Return the rows of the linear terms of inverses of normal matrices, and where they exist.

    Elsewhere they are those of the fit of a linear function of least norm.
    """
    values, vectors = np.linalg.eigh(normal)
    good = values[:, 0] > least * values[:, -1]
    inverse = np.einsum(
        "pik,pk,pjk->pij",
        vectors[:, 1 : dim + 1],
        1.0 / np.where(good[:, None], values, 1.0),
        vectors,
    )
    linear = normal[~good][:, : dim + 1, : dim + 1]
    inverse[~good] = 0.0
    of_linear = np.linalg.pinv(linear, rcond=tuning.DETERMINED, hermitian=True)
    inverse[~good, :, : dim + 1] = of_linear[:, 1:]
    return np.asarray(inverse), good


def second_derivatives(mesh: AnyMesh, nodal: FloatArray) -> FloatArray:
    """Return the second derivatives of fits to a checked field; collective."""
    if isinstance(mesh, SimplexMesh):
        return _second_derivatives_in_regions(mesh, nodal)
    around = mesh.once("_surroundings", lambda: surroundings_of(mesh))
    at_nodes = around.values(mesh, nodal)
    if around.mesh is None:
        return np.zeros((0, mesh.dim, mesh.dim))
    return _second_derivatives_in_regions(around.mesh, at_nodes)[around.own]


def _second_derivatives_in_regions(mesh: SimplexMesh, nodal: FloatArray) -> FloatArray:
    """Return the second derivatives at each node, on interfaces the largest of its regions."""
    found, nodes, _ = _in_regions(mesh, nodal, second_derivatives_of_fits)
    if len(nodes) == mesh.n_points:
        return found
    largest = np.abs(np.linalg.eigvalsh(found)).max(axis=1)
    order = np.lexsort([largest, nodes])
    hessian = np.zeros((mesh.n_points, mesh.dim, mesh.dim))
    hessian[nodes[order]] = found[order]  # of several rows of a node, the last one stays
    return hessian


def as_nodal_field(value: npt.ArrayLike, mesh: AnyMesh) -> FloatArray:
    """Return finite nodal values of a mesh of triangles in the plane or of tetrahedra."""
    if mesh.cell_dim != mesh.dim or mesh.dim == 1:
        raise ValueError(f"mesh must consist of triangles in 2-D or tetrahedra, got {mesh!r}")
    return as_values("values", value, (mesh.n_points,))


class PatchPart(NamedTuple):
    """A range of the rows of a matrix of patches."""

    rows: slice
    members: IntArray
    """Nodes of all patches of the part, one patch after the other."""
    starts: IntArray
    """First member of each patch."""
    patch: LongArray
    """Patch of each member, from 0 in each part."""


def nodes_within_an_edge(mesh: SimplexMesh) -> csr_array:
    """Return a matrix whose entries in row i are i and the nodes that share an edge with it."""
    from scipy.sparse import csr_array

    n = mesh.n_points
    i, j = mesh.edges.T
    own = np.arange(n)
    rows, columns = np.concatenate([i, j, own]), np.concatenate([j, i, own])
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))


def second_derivatives_of_fits(
    mesh: SimplexMesh, nodal: FloatArray, frames: FloatArray | None = None
) -> FloatArray:
    """Return the second derivatives of fits around each node, see `recovered_hessian`.

    Parameters
    ----------
    mesh : SimplexMesh
        Of full dimension, or a surface.
    nodal : float64[n_points]
    frames : float64[n_points, 3, 2], optional
        Orthonormal tangents of a surface, in which the fits are made.

    Returns
    -------
    float64[n_points, dim, dim], or float64[n_points, 2, 2] in the tangents
    """
    near = nodes_within_an_edge(mesh)
    patches = near @ near
    dim = mesh.cell_dim
    hessian = np.empty((mesh.n_points, dim, dim))

    def fit(part: PatchPart) -> None:
        away = mesh.points[part.members] - mesh.points[part.rows][part.patch]
        if frames is not None:
            away = np.einsum("pi,pij->pj", away, frames[part.rows][part.patch])
        rises = nodal[part.members] - nodal[part.rows][part.patch]
        hessian[part.rows] = _second_derivatives(away, rises, part)

    for_parts(fit, patches)
    return hessian


def _second_derivatives(away: FloatArray, rises: FloatArray, part: PatchPart) -> FloatArray:
    """Return the second derivatives of the fit to each patch.

    The linear part is eliminated from the normal equations first.  So linear fields have no second
    derivatives, even where a patch does not determine them all.
    """
    dim = away.shape[1]
    unit, to_unit = in_unit_covariance(away, part)
    root = np.exp(-0.25 / tuning.WIDTH_OF_WEIGHTS**2 * (unit**2).sum(axis=0))
    rows = np.vstack([monomials_of(unit), rises]) * root
    products = sums_of_products(rows, part.starts)
    linear, both = products[:, : dim + 1, : dim + 1], products[:, : dim + 1, dim + 1 :]
    eliminated = np.linalg.pinv(linear, rcond=tuning.DETERMINED, hermitian=True) @ both
    reduced = products[:, dim + 1 :, dim + 1 :] - both.swapaxes(1, 2) @ eliminated
    values, vectors = np.linalg.eigh(reduced[:, :-1, :-1])
    good = values > tuning.DETERMINED * products[:, :1, 0]
    along = np.einsum("pik,pi->pk", vectors, reduced[:, :-1, -1])
    along = np.where(good, along / np.where(good, values, 1.0), 0.0)
    coefficients = np.einsum("pik,pk->pi", vectors, along)
    second = np.empty((len(values), dim, dim))
    for k, (a, b) in enumerate(combinations_with_replacement(range(dim), 2)):
        second[:, a, b] = second[:, b, a] = coefficients[:, k] * (2.0 if a == b else 1.0)
    second = to_unit @ second @ to_unit.swapaxes(1, 2)
    return np.asarray(0.5 * (second + second.swapaxes(1, 2)))


def for_parts(fit: Callable[[PatchPart], None], patches: csr_array) -> None:
    """Call a function for all rows, in parts, by all threads."""
    bounds = _bounds_of_parts(patches)

    def task(first: int, last: int) -> None:
        for start, stop in pairwise(bounds[first : last + 1]):
            begin, end = patches.indptr[start], patches.indptr[stop]
            counts = np.diff(patches.indptr[start : stop + 1])
            patch = np.repeat(np.arange(stop - start), counts)
            starts = patches.indptr[start:stop] - begin
            fit(PatchPart(slice(start, stop), patches.indices[begin:end], starts, patch))

    in_all_threads(task, len(bounds) - 1, 1)


def _bounds_of_parts(patches: csr_array) -> list[int]:
    """Return the first row of each part, and the number of rows.

    Parts have a bounded number of entries, and at least one row each.
    """
    indptr, bounds = patches.indptr, [0]
    while bounds[-1] < len(indptr) - 1:
        most = indptr[bounds[-1]] + _PAIRS_AT_ONCE
        stop = int(np.searchsorted(indptr, most, side="right")) - 1
        bounds.append(max(stop, bounds[-1] + 1))
    return bounds


def in_unit_covariance(away: FloatArray, part: PatchPart) -> tuple[FloatArray, FloatArray]:
    """Return coordinates in which each patch has unit covariance, for stretched meshes.

    Returns
    -------
    unit : float64[dim, n_members]
    to_unit : float64[n_patches, dim, dim]
        ``unit`` is ``away @ to_unit``.
    """
    sizes = np.diff(part.starts, append=len(away))
    squares, axes = np.linalg.eigh(sums_of_products(away.T, part.starts))
    squares /= sizes[:, None]
    largest = squares[:, -1:]
    lengths = np.sqrt(np.where(largest > 0.0, np.maximum(squares, 1e-24 * largest), 1.0))
    to_unit = axes / lengths[:, None, :]
    return np.einsum("pi,pij->jp", away, to_unit[part.patch]), to_unit


def monomials_of(unit: FloatArray) -> FloatArray:
    """Return 1, the coordinates, and their products, float64[n_monomials, n_members]."""
    pairs = combinations_with_replacement(range(len(unit)), 2)
    return np.stack([np.ones(unit.shape[1]), *unit, *(unit[a] * unit[b] for a, b in pairs)])


def sums_of_products(rows: FloatArray, starts: IntArray) -> FloatArray:
    """Return the sums over each patch of the products of rows, float64[m, n_rows, n_rows]."""
    n = len(rows)
    total = np.empty((len(starts), n, n))
    for a, b in combinations_with_replacement(range(n), 2):
        total[:, a, b] = total[:, b, a] = np.add.reduceat(rows[a] * rows[b], starts)
    return total
