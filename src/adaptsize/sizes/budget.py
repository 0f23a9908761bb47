"""Numbers of elements and nodes of nodal sizes."""

from __future__ import annotations

import math

import numpy as np

from adaptsize._checks import as_number, check_type
from adaptsize._pickling import once
from adaptsize.background import AnyMesh, CartesianGrid, Octree
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.migration import boundary_facets
from adaptsize.typing import FloatArray

#: Elements of edge length 1 per unit of measure: of segments, regular triangles and tetrahedra.
ELEMENTS_PER_MEASURE = {1: 1.0, 2: 4.0 / math.sqrt(3.0), 3: 6.0 * math.sqrt(2.0)}

#: Cells that generators make per predicted cell, by dimension of the cells: measured medians
#: (docs/adaptive-loops.md); "mmg inside" is Mmg on a first volume in a surface (docs/remeshing.md).
CELLS_PER_PREDICTED: dict[tuple[str, int], float] = {
    ("mmg", 2): 1.00,
    ("mmg", 3): 1.22,
    ("mmg inside", 3): 1.18,
    ("tetwild", 3): 1.04,
}

#: Largest ratios of the sizes in a cell, and Gauss rules that are exact for these to 1e-12, the
#: last one up to 16.
_RULES = [
    (ratio, np.column_stack(np.polynomial.legendre.leggauss(n)).tolist())
    for ratio, n in ((1.8, 7), (4.0, 10), (np.inf, 16))
]
#: Cells whose numbers fit into the cache.
_CELLS_AT_ONCE = 4096


def count_elements(mesh: AnyMesh, h: FloatArray) -> float:
    """Return the number of regular simplices of checked sizes; collective."""
    with np.errstate(over="ignore"):  # inf for tiny sizes in large domains
        counted = (mesh.measures * mean_density(h[mesh.cells])).sum()
    return ELEMENTS_PER_MEASURE[mesh.cell_dim] * float(mesh.ranks.allreduce(float(counted), "sum"))


def mean_density(corner_sizes: FloatArray) -> FloatArray:
    r"""Return the mean of h^-d over simplices of d dimensions on which h is linear.

    The mean of :math:`H^{-(d+1)}` over a simplex of H linear is the product of the
    :math:`1 / H_i` at its corners.  With H = h + s, and integrated over s > 0,

    .. math:: \overline{h^{-d}} = d \int_0^\infty \prod_i \frac{1}{h_i + s} \, ds,

    by Gauss' rule after :math:`s = m (1 + x) / (1 - x)`, with m between the least and the largest
    corner: exact for constants, to 1e-12 where they differ by a factor of 16, to 1e-4 for 1000.

    Parameters
    ----------
    corner_sizes : float64[n, d + 1]
        Positive; inf gives 0.

    Returns
    -------
    float64[n]
        At most about 1e300.
    """
    densities = np.empty(len(corner_sizes))
    for first in range(0, len(densities), _CELLS_AT_ONCE):
        part = slice(first, first + _CELLS_AT_ONCE)
        corners = np.ascontiguousarray(corner_sizes[part].T)
        least, largest = corners.min(axis=0), corners.max(axis=0)
        bounded, below = np.isfinite(largest), 0.0
        least[~bounded] = 1.0
        own = np.zeros(len(least))
        for ratio, rule in _RULES:
            which = bounded & (largest > below * least) & (largest <= ratio * least)
            below = ratio
            if which.all():
                own = _integrated(corners, least, largest, rule)
            elif which.any():
                own[which] = _integrated(corners[:, which], least[which], largest[which], rule)
        densities[part] = own
    return densities


def _integrated(
    h: FloatArray, least: FloatArray, largest: FloatArray, rule: list[list[float]]
) -> FloatArray:
    """Return the mean densities of cells, by the sizes at their corners, float64[d + 1, n]."""
    d = len(h) - 1
    m = np.sqrt(least) * np.sqrt(largest)
    over_m = h / m  # powers of small or large sizes stay in range
    total, term = np.zeros(len(m)), np.empty(len(m))
    for x, weight in rule:
        product = np.full(len(m), 2.0 * d * weight * (1.0 - x) ** (d - 1))
        for at_corner in over_m:
            np.multiply(at_corner, 1.0 - x, out=term)
            term += 1.0 + x
            product /= term
        total += product
    # Larger densities of elements are cut, since powers of tiny sizes overflow.
    total *= np.maximum(m, 1e300 ** (-1.0 / d)) ** -d
    return total


def nodal_measures(background: AnyMesh | CartesianGrid | Octree) -> FloatArray:
    """Return the length, area or volume around each node, of the nodal shape.

    A cell gives the same share to each of its nodes.  Inactive nodes have none.  Those of a mesh
    are kept with it.
    """
    if isinstance(background, CartesianGrid):
        measures = np.full(background.shape, float(np.prod(background.spacing)))
        for d in range(background.dim):
            ends = np.moveaxis(measures, d, 0)
            ends[0] *= 0.5
            ends[-1] *= 0.5
        if background.active is not None:
            measures[~background.active] = 0.0
        return measures
    mesh = background.mesh if isinstance(background, Octree) else background

    def summed() -> FloatArray:
        shares = np.repeat(mesh.measures / mesh.cells.shape[1], mesh.cells.shape[1])
        # Without cells the sums would be integers.
        summed = np.bincount(mesh.cells.ravel(), shares, mesh.n_points)
        return read_only(summed.astype(np.float64))

    return once(mesh, "_nodal_measures", summed)


def calibration(backend: str | None, cell_dim: int) -> float:
    """Return how many cells a generator makes per predicted cell, 1 for others than measured."""
    if backend is not None:
        check_type("backend", backend, str)
    return CELLS_PER_PREDICTED.get((backend or "", cell_dim), 1.0)


def present_sizes(mesh: AnyMesh) -> FloatArray:
    """Return for each cell the edge length of the regular simplex of the same measure."""
    d = mesh.cell_dim
    return np.asarray((ELEMENTS_PER_MEASURE[d] * mesh.measures) ** (1.0 / d))


def as_goal(tolerance: float | None, elements: float | None) -> tuple[str, float]:
    """Return which of two goals is given, and its value."""
    if (tolerance is None) == (elements is None):
        given = "none" if tolerance is None else "both"
        raise ValueError(f"one of tolerance and elements must be given, got {given}")
    if tolerance is not None:
        return "tolerance", as_number("tolerance", tolerance, lower=0.0, strict=True)
    return "elements", as_number("elements", elements, lower=1.0)


#: Nodes per cell and per boundary facet, by dimension of the cells.  Around an edge are 5.104
#: tetrahedra if they were regular, 5.127 to 5.132 in meshes by Mmg.
_PER_CELL = {1: 1.0, 2: 0.5, 3: 6.0 / 5.13 - 1.0}
_PER_FACET = {1: 0.5, 2: 0.5, 3: 0.25}


def nodes_of(cell_dim: int, cells: float, facets: float) -> float:
    """Return the number of nodes of a mesh with so many cells and boundary facets."""
    return _PER_CELL[cell_dim] * cells + _PER_FACET[cell_dim] * facets


def elements_with_nodes(mesh: AnyMesh, nodes: float) -> float:
    """Return the number of cells of a mesh of the same domain with so many nodes; collective.

    The number of boundary facets is taken to grow as that of a uniformly refined mesh: as the
    cells to the power of (d - 1) / d.

    Examples
    --------
    >>> from adaptsize import SimplexMesh
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> round(elements_with_nodes(square, 101**2))  # 2 * 100^2 and 4 * 100
    20002
    """
    wanted, d = as_number("nodes", nodes, lower=1.0), mesh.cell_dim
    present = np.array([len(mesh.cells), len(boundary_facets(mesh))])
    n_cells, n_facets = mesh.ranks.allreduce(present, "sum").tolist()
    facets = n_facets / n_cells ** ((d - 1) / d)
    # With x = cells^(1/d), wanted = a x^d + b x^(d - 1), increasing: Newton's method from above.
    a, b = _PER_CELL[d], _PER_FACET[d] * facets
    x = math.pow(wanted / a, 1.0 / d)
    for _ in range(50):
        excess = a * x**d + b * x ** (d - 1) - wanted
        step = excess / (a * d * x ** (d - 1) + b * (d - 1) * x ** max(d - 2, 0))
        x -= step
        if abs(step) <= 1e-12 * x:
            break
    return max(math.pow(x, d), 1.0)
