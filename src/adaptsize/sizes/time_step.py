"""The time step that sizes allow, before there is a mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, refuse_where
from adaptsize.typing import FloatArray

#: A number, values at the nodes, or a function of points.
Coefficient: TypeAlias = npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike]


def time_step(
    h: FloatArray,
    points: FloatArray,
    velocity: Coefficient | None,
    diffusivity: Coefficient | None,
    courant: float,
) -> float:
    """Return the time step of `SizeFunction.time_step` for sizes at points, float64[n, dim]."""
    if velocity is None and diffusivity is None:
        raise ValueError("velocity or diffusivity must be given, got neither")
    courant = as_number("courant", courant, lower=0.0, strict=True)
    refuse_where("size", np.isinf(h), h, "must be finite")
    step = math.inf
    with np.errstate(divide="ignore"):
        if velocity is not None:
            speed = _at_nodes("velocity", velocity, points)
            step = float((h / speed).min())
        if diffusivity is not None:
            kappa = _at_nodes("diffusivity", diffusivity, points, vectors=False)
            step = min(step, float((h**2 / (2.0 * points.shape[1] * kappa)).min()))
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
