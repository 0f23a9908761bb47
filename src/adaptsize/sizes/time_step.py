"""The time step that sizes allow, before there is a mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, refuse_where
from adaptsize.typing import BoolArray, FloatArray

#: A number, values at the nodes, or a function of points.
Coefficient: TypeAlias = npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike]


class SizesAtPlaces(NamedTuple):
    """Sizes at the nodes of a background, and at places between them where sizes are small."""

    h: FloatArray
    """float64[n]: at the nodes that count, then at those places."""
    points: FloatArray
    """float64[n, dim]"""
    counts: BoolArray
    """Which nodes of the background count, of the nodal shape."""

    @property
    def n_between(self) -> int:
        """Number of places between the nodes."""
        return len(self.h) - int(np.count_nonzero(self.counts))


def time_step(
    at: SizesAtPlaces,
    velocity: Coefficient | None,
    diffusivity: Coefficient | None,
    courant: float,
) -> float:
    """Return the time step of `SizeFunction.time_step` for sizes at some places."""
    if velocity is None and diffusivity is None:
        raise ValueError("velocity or diffusivity must be given, got neither")
    courant = as_number("courant", courant, lower=0.0, strict=True)
    h, dim = at.h, at.points.shape[1]
    step = math.inf
    with np.errstate(divide="ignore"):
        if velocity is not None:
            speed = _at_places("velocity", velocity, at)
            step = float((h / speed).min())
        if diffusivity is not None:
            kappa = _at_places("diffusivity", diffusivity, at, vectors=False)
            step = min(step, float((h**2 / (2.0 * dim * kappa)).min()))
    return courant * step


def _at_places(
    name: str, given: Coefficient, at: SizesAtPlaces, *, vectors: bool = True
) -> FloatArray:
    """Return lengths of vectors, or values >= 0, float64[n] or float64[1]."""
    dim, counts = at.points.shape[1], at.counts
    if callable(given):
        counts = np.ones(len(at.points), np.bool_)
        name = f"{name}(points)"
    values = as_float_array(name, given(at.points.copy()) if callable(given) else given)
    nodal = dict.fromkeys([(counts.size,), counts.shape])
    shapes = [(), *nodal] + ([(dim,), *((*shape, dim) for shape in nodal)] if vectors else [])
    if values.shape not in shapes:
        *others, last = map(str, shapes)
        raise ValueError(
            f"{name} must have shape {', '.join(others)} or {last}, got {values.shape}"
        )
    if vectors and values.shape == (dim,) == (counts.size,):
        raise ValueError(
            f"{name} of shape {values.shape} may be one vector or the speeds at {dim} points: pass "
            f"vectors of shape {(dim, dim)}, or the largest speed"
        )
    refuse_where(name, ~np.isfinite(values), values, "must be finite")
    is_nodal = values.shape not in ((), (dim,)) or values.shape == (counts.size,)
    if is_nodal and not callable(given) and at.n_between:
        raise ValueError(
            f"{name} must be a number, a vector or a function of points, since sizes are small "
            f"between the nodes, too: at {at.n_between} places of sources"
        )
    is_vector = vectors and values.shape in ((dim,), *((*shape, dim) for shape in nodal))
    if is_vector and values.shape not in nodal:
        values = np.linalg.norm(values, axis=-1)
    refuse_where(name, values < 0.0, values, "must be >= 0")
    return values.ravel()[counts.ravel()] if is_nodal else np.atleast_1d(values)
