"""How many elements sizes ask for, and sizes for so many elements."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from adaptsize._checks import as_number, as_sizes
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray

#: Elements of edge length 1 per unit of measure: of segments, regular triangles and tetrahedra.
ELEMENTS_PER_MEASURE = {1: 1.0, 2: 4.0 / math.sqrt(3.0), 3: 6.0 * math.sqrt(2.0)}

#: Cells that generators make per cell predicted, by dimension of the cells: medians of what was
#: measured (docs/adaptive-loops.md).
CELLS_PER_PREDICTED: dict[tuple[str, int], float] = {
    ("mmg", 2): 1.02,
    ("mmg", 3): 1.08,
}

# Logarithm of the scale: a hundredth of a per cent of the size.
_TOLERANCE = 1e-4
# Up to which logarithm a scale is sought, and what stands for that of nothing.
_REACH = 40.0
_NOTHING = -700.0


def predicted_elements(mesh: SimplexMesh, size: npt.ArrayLike) -> float:
    """Return how many elements of the given sizes fill a mesh.

    Parameters
    ----------
    mesh : SimplexMesh
    size : array_like of float, shape (n_points,)
        Wanted edge lengths at the nodes, positive; ``inf`` counts nothing.

    Returns
    -------
    float
        The measure of each cell over that of a regular simplex of edge h, with 1 / h^d, d the
        dimension of the cells, averaged over its nodes.

    Raises
    ------
    ValueError
        If the sizes have another shape or are not positive.

    Notes
    -----
    Generators make about as many triangles; tetrahedra cannot all be regular, and
    generators differ.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> round(predicted_elements(mesh, [0.1, 0.1, 0.1]))
    115
    """
    h = as_sizes("size", size, (mesh.n_points,))
    d = mesh.cell_dim
    density = (h**-d)[mesh.cells].mean(axis=1)
    return float(ELEMENTS_PER_MEASURE[d] * (mesh.measures * density).sum())


def calibration(backend: str | None, cell_dim: int) -> float:
    """Return how many cells a generator makes per cell predicted; 1 for those not measured."""
    return CELLS_PER_PREDICTED.get((backend or "", cell_dim), 1.0)


def present_sizes(mesh: SimplexMesh) -> FloatArray:
    """Return per cell the edge length of the regular simplex of the same measure."""
    d = mesh.cell_dim
    return np.asarray((ELEMENTS_PER_MEASURE[d] * mesh.measures) ** (1.0 / d))


def scale_to(wanted: float, falling: Callable[[float], float], start: float) -> float:
    """Return where a falling function of a positive number has a value, or comes nearest.

    Parameters
    ----------
    wanted : float
        Positive.
    falling : callable
        Does not rise; need not be strictly falling, and may be bounded on either side.
    start : float
        Positive, near the result.

    Returns
    -------
    float
        Where ``falling`` leaves its bound if ``wanted`` lies beyond it.
    """

    def excess(exponent: float) -> float:
        value = falling(start * math.exp(exponent))
        return max(math.log(value / wanted), _NOTHING) if value > 0.0 else _NOTHING

    low = high = 0.0
    at_low = at_high = excess(0.0)
    step = math.log(2.0)
    while at_low < 0.0 and low > -_REACH:
        high, at_high = low, at_low
        low, step = low - step, 2.0 * step
        at_low = excess(low)
    while at_high > 0.0 and high < _REACH:
        low, at_low = high, at_high
        high, step = high + step, 2.0 * step
        at_high = excess(high)
    if at_low <= 0.0:
        return start * math.exp(low)
    if at_high >= 0.0:
        return start * math.exp(high)
    return start * math.exp(float(brentq(excess, low, high, xtol=_TOLERANCE)))


def as_goal(tolerance: float | None, target_elements: float | None) -> tuple[str, float]:
    """Return which of two goals is given, and its value."""
    if (tolerance is None) == (target_elements is None):
        given = "none" if tolerance is None else "both"
        raise ValueError(f"one of tolerance and target_elements must be given, got {given}")
    if tolerance is not None:
        return "tolerance", as_number("tolerance", tolerance, lower=0.0, strict=True)
    return "target_elements", as_number("target_elements", target_elements, lower=1.0)
