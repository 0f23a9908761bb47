"""The gradient limit ``g``: slopes in space and a change of variable for g(h)."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._checks import FARTHEST, NEAREST, as_float_array, as_slopes
from adaptsize._messages import Message
from adaptsize.background import AnyMesh, CartesianGrid
from adaptsize.errors import OptionError
from adaptsize.limiting import tuning
from adaptsize.typing import FloatArray, GradientLimit, GradientOfSize

# Larger sizes mean that g(h) is unbounded and the solution overflows.
_SMALLEST, _LARGEST = NEAREST, FARTHEST


@dataclass(frozen=True)
class Slope:
    """The bound |grad u| <= slope that the schemes use."""

    values: FloatArray
    """One value for all (shape (1,)), one per cell of a mesh, or one per node of a grid."""
    varies_elsewhere: bool = False
    """Whether there is one value per cell on other ranks."""

    @property
    def step(self) -> int:
        """1 if there is one value per cell (node), else 0: cell c has ``values[c * step]``."""
        return 0 if self.values.shape == (1,) else 1

    @property
    def varies(self) -> bool:
        """Whether there is one value per cell or node, on this rank or another one."""
        return self.step == 1 or self.varies_elsewhere

    def number(self, method: str) -> float:
        """Return the single limit; raise a ValueError that names the method if it varies."""
        if self.varies:
            named = Message.name("method", repr(method))
            text = "{} needs one number {g} or {g}(h), got {g} that varies in space"
            raise OptionError(Message(text, named))
        return float(self.values[0])


class SizeTransform:
    r"""The change of variable that turns g(h) into a constant.

    With :math:`\Phi(h) = \int dh / g(h)`, the condition :math:`|\nabla h| \le g(h)`
    is :math:`|\nabla \Phi(h)| \le 1`.  For any positive g, :math:`\Phi` is strictly
    increasing.  Hence the largest such h exists and is unique; it is :math:`\Phi^{-1}` of
    the limited :math:`\Phi(h_0)`.

    The table holds :math:`\Phi` at geometrically spaced sizes (two-point Gauss rule
    in each interval).  It is interpolated linearly in both directions, so that a round
    trip is exact to rounding.

    Parameters
    ----------
    g_of_h : callable
        Takes an array of sizes and returns positive finite limits.
    smallest, largest : float
        Initial range of finite sizes, ``0 < smallest <= largest``.
    """

    def __init__(self, g_of_h: GradientOfSize, smallest: float, largest: float) -> None:
        self._g_of_h = g_of_h
        self._h = np.array([smallest])
        self._phi = np.array([0.0])
        self._extend_to(max(largest, min(smallest, _LARGEST) * math.e))

    def forward(self, h: FloatArray) -> FloatArray:
        """Return Phi(h) for sizes within the table; inf stays inf."""
        return np.where(np.isinf(h), np.inf, np.interp(h, self._h, self._phi))

    def backward(self, phi: FloatArray) -> FloatArray:
        """Return the sizes h with Phi(h) = phi; inf stays inf.

        Raises
        ------
        ValueError
            If g(h) grows so fast that a size overflows.
        """
        finite = phi[np.isfinite(phi)]
        highest = float(finite.max()) if finite.size else 0.0
        while self._phi[-1] < highest:
            if self._h[-1] > _LARGEST:
                raise ValueError("g(h) must be bounded: it grows so fast that the sizes overflow")
            self._extend_to(4.0 * float(self._h[-1]))
        return np.where(np.isinf(phi), np.inf, np.interp(phi, self._phi, self._h))

    def _extend_to(self, largest: float) -> None:
        if not _SMALLEST <= self._h[0] <= largest <= 4.0 * math.e * _LARGEST:
            raise ValueError(
                f"finite sizes must be from {_SMALLEST:g} to {_LARGEST:g} with g(h), "
                f"got {float(self._h[0]):g} to {largest:g}"
            )
        start = float(self._h[-1])
        count = max(2, math.ceil(tuning.INTERVALS * math.log(largest / start)))
        h = np.geomspace(start, largest, count + 1)
        step = np.diff(h)
        middle = 0.5 * (h[1:] + h[:-1])
        offset = step / (2.0 * math.sqrt(3.0))
        inverse = 0.5 * (1.0 / self._g(middle - offset) + 1.0 / self._g(middle + offset))
        phi = float(self._phi[-1]) + np.cumsum(step * inverse)
        self._h = np.concatenate([self._h, h[1:]])
        self._phi = np.concatenate([self._phi, phi])

    def _g(self, h: FloatArray) -> FloatArray:
        g = as_float_array("g(h)", self._g_of_h(h))
        if g.shape not in ((), h.shape):
            raise ValueError(f"g(h) must return one limit per size, shape {h.shape}, got {g.shape}")
        g = np.broadcast_to(g, h.shape)
        bad = ~(g > 0.0) | ~np.isfinite(g)
        if bad.any():
            first = int(np.argmax(bad))
            raise ValueError(f"g(h) must be positive and finite, got g({h[first]:g}) = {g[first]}")
        return g


def factors_of(g: GradientLimit) -> tuple[npt.ArrayLike, GradientOfSize | None]:
    """Return the factor of g that depends on the place, and that which depends on the size."""
    if isinstance(g, tuple | list) and len(g) == 2 and callable(g[1]):
        return g[0], g[1]
    return (1.0, g) if callable(g) else (g, None)


def in_space(
    background: AnyMesh | CartesianGrid, g: npt.ArrayLike, *, in_cells: bool = False
) -> Slope:
    """Return one limit for all, one per node of a grid, or one per cell of a mesh.

    An array that has the length of the nodes and of the cells is one of the nodes, unless
    ``in_cells``.

    Raises
    ------
    ValueError
        If g has a wrong shape, or is negative, NaN or above 1e30.
    """
    values = as_float_array("g", g)
    if isinstance(background, CartesianGrid) and values.shape == background.shape:
        # The values at inactive nodes are arbitrary.
        values = values if background.active is None else np.where(background.active, values, 0.0)
    values = as_slopes("g", values)
    if values.ndim == 0:
        return Slope(values.reshape(1))
    if isinstance(background, CartesianGrid):
        if values.shape == background.shape:
            return Slope(values)
        raise ValueError(
            f"g must be a number, an array per node {background.shape}, or callable; "
            f"got shape {values.shape}"
        )
    n_points, n_cells = background.n_points, background.n_cells
    if values.shape == (n_points,) and not in_cells:
        values = np.ascontiguousarray(values[background.cells].mean(axis=1))
    if values.shape == (n_cells,):
        return Slope(values)
    raise ValueError(
        f"g must be a number, an array per node {(n_points,)} or per cell {(n_cells,)}, "
        f"or callable; got shape {values.shape}"
    )
