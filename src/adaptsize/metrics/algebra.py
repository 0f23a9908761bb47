"""Operations on arrays of sizes and directions, the parts of metrics."""

import math

import numpy as np

from adaptsize._checks import refuse_where
from adaptsize._kernels import metric_joint as kernels
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IntArray

#: Stands for inf, in units of the largest finite size; and what counts as inf afterwards.
UNBOUNDED = 1e30
AS_UNBOUNDED = 1e20

# Lengths whose ratio is nearer to 1 than this have their arithmetic as logarithmic mean.
_EQUAL = 1e-4


def assemble(directions: FloatArray, values: FloatArray) -> FloatArray:
    """Return symmetric matrices with given eigenvectors and eigenvalues."""
    return np.asarray((directions * values[:, None, :]) @ directions.swapaxes(1, 2))


def refuse_skew(name: str, matrices: FloatArray) -> None:
    """Refuse matrices that are not symmetric to 1e-6 of their largest entry."""
    skew = np.abs(matrices - matrices.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0)
    largest = np.abs(matrices).max(axis=(1, 2), initial=0.0)
    refuse_where(name, skew > 1e-6 * largest, matrices, "must be symmetric")


def power_of_two(h: FloatArray) -> float:
    """Return the power of two above the largest finite size, by which division is exact."""
    return math.ldexp(1.0, math.frexp(float(h.max(where=np.isfinite(h), initial=0.0)))[1])


def intersection(
    sizes: list[FloatArray], directions: list[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return sizes and directions of the intersections of two metrics or more."""
    h = np.stack(sizes)
    scale = power_of_two(h)
    h = np.where(np.isfinite(h), h / scale, UNBOUNDED)
    r = np.stack(directions)
    dim = h.shape[2]
    h_all, r_all = np.empty(h.shape[1:]), np.empty(r.shape[1:])
    kernels.intersect_stacks((0,) * dim, (h, r), (h_all, r_all), kernels.new_joint(dim))
    return np.where(h_all >= AS_UNBOUNDED, np.inf, h_all * scale), r_all


def logarithmic_mean(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return (a - b) / log(a / b) of numbers >= 0; 0 if one of them is 0."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(high > 0.0, (high - low) / high, 0.0)
        mean = np.where(share > _EQUAL, (high - low) / -np.log1p(-share), 0.0)
    # Series of share / -log(1 - share).
    near = high * (1.0 - share / 2.0 - share**2 / 12.0 - share**3 / 24.0)
    return np.where(share > _EQUAL, mean, near)


def cell_volumes(sizes: FloatArray, directions: FloatArray, mesh: SimplexMesh) -> FloatArray:
    """Return the measures of cells in the metric, the mean of those by the metrics of the nodes.

    Parameters
    ----------
    sizes, directions : float64[n, dim], float64[n, dim, dim]
    mesh : SimplexMesh
        Cells of any dimension.

    Returns
    -------
    float64[n_cells]
    """
    k = mesh.cell_dim
    if k == mesh.dim:
        density = 1.0 / sizes.prod(axis=1)
        return np.asarray(mesh.measures * density[mesh.cells].mean(axis=1))
    corners = mesh.points[mesh.cells]
    edges = corners[:, 1:] - corners[:, :1]
    total = np.zeros(mesh.n_cells)
    for nodes in mesh.cells.T:
        inside = (edges @ directions[nodes]) / sizes[nodes][:, None, :]
        across = inside[:, 0] if k == 1 else np.cross(inside[:, 0], inside[:, 1])
        total += np.hypot.reduce(across, axis=1) / (math.factorial(k) * (k + 1))  # no overflow
    return total


def log_mean(
    sizes: FloatArray, directions: FloatArray, nodes: IntArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return sizes and directions of log-Euclidean means of the metrics of nodes."""
    free = np.isinf(sizes.max(axis=1))
    logs = assemble(directions, np.where(free[:, None], 0.0, np.log(sizes)))
    mean = np.einsum("mk,mkij->mij", weights, logs[nodes])
    values, vectors = np.linalg.eigh(mean)
    unbounded = (free[nodes] & (weights != 0.0)).any(axis=1)
    return np.where(unbounded[:, None], np.inf, np.exp(values)), vectors


def orthonormal(r: FloatArray) -> FloatArray:
    """Return the orthonormal matrices nearest to given ones; refuse those far from it."""
    refuse_where("directions", ~np.isfinite(r), r, "must be finite")
    for _ in range(2):  # Newton's iteration to the polar factor: 1e-6, 1e-12, 1e-24
        excess = r.swapaxes(1, 2) @ r - np.eye(r.shape[1])
        worst = np.abs(excess).max(axis=(1, 2), initial=0.0)
        refuse_where("directions", worst > 1e-6, r, "must have orthonormal columns")
        r = r - 0.5 * (r @ excess)
    return r
