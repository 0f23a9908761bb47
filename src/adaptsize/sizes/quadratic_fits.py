"""Quadratics fitted to nodal values on patches of nodes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray

#: Of normal matrices in coordinates of unit covariance, the smallest eigenvalue over the largest.
DETERMINED = 3e-4
# Normal matrices are assembled in parts of this number of node pairs: 80 MB in space.
_PAIRS_AT_ONCE = 100_000
# Width of the weights in coordinates of unit covariance.  1 smears layers and smooth fields more;
# 0.5 leaves hardly more nodes than a quadratic needs.
_WIDTH = 0.7


class PatchPart(NamedTuple):
    """A range of the rows of a matrix of patches."""

    rows: slice
    entries: slice
    members: npt.NDArray[np.int32]
    """Nodes of all patches of the part, one patch after the other."""
    starts: npt.NDArray[np.int32]
    """First member of each patch."""
    patch: npt.NDArray[np.int64]
    """Patch of each member, from 0 in each part."""


def nodes_within_an_edge(mesh: SimplexMesh) -> csr_array:
    """Return a matrix whose entries in row i are i and the nodes that share an edge with it."""
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
    patches = csr_array(near @ near)
    dim = mesh.cell_dim
    hessian = np.empty((mesh.n_points, dim, dim))
    for part in parts_of(patches):
        away = mesh.points[part.members] - mesh.points[part.rows][part.patch]
        if frames is not None:
            away = np.einsum("pi,pij->pj", away, frames[part.rows][part.patch])
        rises = nodal[part.members] - nodal[part.rows][part.patch]
        hessian[part.rows] = _second_derivatives(away, rises, part)
    return hessian


def _second_derivatives(away: FloatArray, rises: FloatArray, part: PatchPart) -> FloatArray:
    """Return the second derivatives of the fit to each patch.

    The linear part is eliminated from the normal equations first.  So linear fields have no second
    derivatives, even where a patch does not determine them all.
    """
    dim = away.shape[1]
    unit, to_unit = in_unit_covariance(away, part)
    root = np.exp(-0.25 / _WIDTH**2 * (unit**2).sum(axis=0))
    rows = np.vstack([monomials_of(unit), rises]) * root
    products = sums_of_products(rows, part.starts)
    linear, both = products[:, : dim + 1, : dim + 1], products[:, : dim + 1, dim + 1 :]
    eliminated = np.linalg.pinv(linear, rcond=DETERMINED, hermitian=True) @ both
    reduced = products[:, dim + 1 :, dim + 1 :] - both.swapaxes(1, 2) @ eliminated
    values, vectors = np.linalg.eigh(reduced[:, :-1, :-1])
    good = values > DETERMINED * products[:, :1, 0]
    along = np.einsum("pik,pi->pk", vectors, reduced[:, :-1, -1])
    along = np.where(good, along / np.where(good, values, 1.0), 0.0)
    coefficients = np.einsum("pik,pk->pi", vectors, along)
    second = np.empty((len(values), dim, dim))
    for k, (a, b) in enumerate(combinations_with_replacement(range(dim), 2)):
        second[:, a, b] = second[:, b, a] = coefficients[:, k] * (2.0 if a == b else 1.0)
    second = to_unit @ second @ to_unit.swapaxes(1, 2)
    return np.asarray(0.5 * (second + second.swapaxes(1, 2)))


def parts_of(patches: csr_array) -> Iterator[PatchPart]:
    """Yield rows in parts of a bounded number of entries, at least one row each."""
    indptr = patches.indptr
    start, n = 0, len(indptr) - 1
    while start < n:
        stop = int(np.searchsorted(indptr, indptr[start] + _PAIRS_AT_ONCE, side="right")) - 1
        stop = min(max(stop, start + 1), n)
        entries = slice(indptr[start], indptr[stop])
        counts = np.diff(indptr[start : stop + 1])
        yield PatchPart(
            slice(start, stop), entries, patches.indices[entries],
            indptr[start:stop] - indptr[start], np.repeat(np.arange(stop - start), counts),
        )  # fmt: skip
        start = stop


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


def sums_of_products(rows: FloatArray, starts: npt.NDArray[np.int32]) -> FloatArray:
    """Return the sums over each patch of the products of rows, float64[m, n_rows, n_rows]."""
    n = len(rows)
    total = np.empty((len(starts), n, n))
    for a, b in combinations_with_replacement(range(n), 2):
        total[:, a, b] = total[:, b, a] = np.add.reduceat(rows[a] * rows[b], starts)
    return total
