"""The time step that sizes allow, before there is a mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, check_type, refuse_where
from adaptsize._size_function import SizeFunction
from adaptsize.typing import FloatArray

#: A number, values at the nodes, or a function of points.
Coefficient: TypeAlias = npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike]


def time_step(
    size: SizeFunction,
    *,
    velocity: Coefficient | None = None,
    diffusivity: Coefficient | None = None,
    courant: float = 1.0,
) -> float:
    r"""Return the largest time step of an explicit scheme on a mesh of given sizes.

    .. math:: \Delta t = C \min_i \min\left(\frac{h_i}{|v_i|}, \frac{h_i^2}{2 d \kappa_i}\right)

    Parameters
    ----------
    size : SizeFunction
        Of the mesh to be made, or of one that exists: ``SizeFunction(mesh, mesh.sizes())``.
    velocity : float, array_like or callable, optional
        Speed, or vectors: a number, values at the nodes of the background, shape (n,) or (n, dim),
        or a function of points that returns them.
    diffusivity : float, array_like or callable, optional
        Of diffusion, in squared lengths per time; shape (n,).
    courant : float, default 1.0
        C, which depends on the scheme.

    Returns
    -------
    float
        inf if nothing moves.

    Raises
    ------
    ValueError
        If neither or something invalid is given, or a size is inf.

    Examples
    --------
    >>> from adaptsize import CartesianGrid
    >>> grid = CartesianGrid([0.0, 0.0], 0.5, (3, 3))
    >>> size = SizeFunction(grid, np.full((3, 3), 0.1))
    >>> round(time_step(size, velocity=[2.0, 0.0]), 12), round(time_step(size, diffusivity=1.0), 12)
    (0.05, 0.0025)
    """
    check_type("size", size, SizeFunction)
    if velocity is None and diffusivity is None:
        raise ValueError("velocity or diffusivity must be given, got neither")
    courant = as_number("courant", courant, lower=0.0, strict=True)
    h = np.ravel(size.values)
    refuse_where("size", np.isinf(h), h, "must be finite")
    dim = size.background.dim
    points = np.asarray(size.background.points).reshape(-1, dim)
    step = math.inf
    with np.errstate(divide="ignore"):
        if velocity is not None:
            speed = _at_nodes("velocity", velocity, points)
            step = float((h / speed).min())
        if diffusivity is not None:
            kappa = _at_nodes("diffusivity", diffusivity, points, vectors=False)
            step = min(step, float((h**2 / (2.0 * dim * kappa)).min()))
    return courant * step


def _at_nodes(
    name: str, given: Coefficient, points: FloatArray, *, vectors: bool = True
) -> FloatArray:
    """Return lengths of vectors, or values >= 0, float64[n] or float64[1]."""
    n, dim = points.shape
    values = as_float_array(name, given(points) if callable(given) else given)
    shapes = [(), (n,)] + ([(dim,), (n, dim)] if vectors else [])
    if values.shape not in shapes:
        text = f", ({dim},) or ({n}, {dim})" if vectors else ""
        raise ValueError(f"{name} must have shape (), ({n},){text}, got {values.shape}")
    refuse_where(name, ~np.isfinite(values), values, "must be finite")
    if values.shape in ((dim,), (n, dim)) and vectors and values.shape != (n,):
        return np.atleast_1d(np.linalg.norm(values, axis=-1))
    refuse_where(name, values < 0.0, values, "must be >= 0")
    return np.atleast_1d(values)
