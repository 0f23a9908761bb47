"""``remesh(..., strict=True)``: other routes if a mesh does not meet the demands."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from adaptsize.background import SimplexMesh
from adaptsize.errors import BackendError, BackendTimeoutError, MeshingError, ResolutionWarning
from adaptsize.quality import MeshCheck, check_mesh
from adaptsize.remeshing.protocol import Task
from adaptsize.remeshing.registry import available_backends
from adaptsize.remeshing.sizing import Size

#: Tolerances passed to a generator, over the allowed one.  Generators keep a smaller tolerance than
#: the one they are given, at most 2.2 times.
_FACTORS, _LAST_FACTOR = (1.0, 0.4), 0.15
#: Length of a failure in the message about all routes, of which there are five.
_LONGEST = 120


class Route(NamedTuple):
    """A generator, and the tolerance that it is given over the allowed one."""

    backend: str
    factor: float

    def __str__(self) -> str:
        """Return the generator and the factor."""
        return self.backend + ("" if self.factor == 1.0 else f" with {self.factor:g} x tolerance")


def remesh_strictly(
    attempt: Callable[..., SimplexMesh],
    original: SimplexMesh,
    size: Size,
    tolerance: float,
    ways: Iterable[Route],
    timeout: float | None,
) -> SimplexMesh:
    """Return the first mesh that meets all demands of `check_mesh`.

    Parameters
    ----------
    attempt : callable
        Makes a mesh with the keywords ``backend``, ``tolerance`` and ``timeout``.
    original : SimplexMesh
    size : callable
        The checked sizes.
    tolerance : float
    ways : iterable of Route
        In the order in which they are tried.
    timeout : float or None
        Time limit for all attempts together.

    Raises
    ------
    MeshingError
        If no route gives such a mesh.  The message says what was tried and what failed.

    Warns
    -----
    ResolutionWarning
        If the first attempt failed, with what was tried.
    """
    deadline = None if timeout is None else time.monotonic() + timeout
    failures: dict[str, list[str]] = {}  # routes by what was wrong
    last: MeshCheck | None = None
    for route in ways:
        left = None if deadline is None else deadline - time.monotonic()
        if left is not None and left <= 0.0:
            failures.setdefault("no time left", []).append(str(route))
            break
        try:
            new = attempt(backend=route.backend, tolerance=route.factor * tolerance, timeout=left)
        except BackendError as error:
            if isinstance(error, BackendTimeoutError) and not failures:
                raise
            failures.setdefault(_in_short(str(error)), []).append(str(route))
            continue
        last = check_mesh(new, original=original, size=size, tolerance=tolerance)
        if last.is_met:
            if failures:
                text = f"made by {route} after {_listed(failures)}"
                warnings.warn(text, ResolutionWarning, stacklevel=4)
            return new
        missed = ", ".join(f"{demand.name} {demand.text}" for demand in last.failures)
        failures.setdefault(_in_short(missed), []).append(str(route))
    message = f"no mesh meets the demands; tried {_listed(failures)}"
    raise MeshingError(message if last is None else f"{message}{_worst(last)}", last)


def _listed(failures: dict[str, list[str]]) -> str:
    return "; ".join(f"{', '.join(tried)}: {wrong}" for wrong, tried in failures.items())


def _in_short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def _worst(check: MeshCheck) -> str:
    """Return the worst place of each demand that is not met."""
    places = [
        f"{demand.name} at ({', '.join(f'{x:.6g}' for x in demand.places[0].point)})"
        for demand in check.failures
        if demand.places
    ]
    return f"; worst places of the last: {', '.join(places)}" if places else ""


def routes(task: Task, backend: str, chosen: str, *, keep_facets: bool) -> Iterator[Route]:
    """Yield the routes to try: a smaller tolerance, for "auto" other generators, the smallest."""
    names = [chosen]
    if backend == "auto":
        for name, info in available_backends().items():
            fits = task in info.tasks and info.keeps_required_facets >= keep_facets
            if info.installed and fits and name not in (chosen, "gmsh"):  # Gmsh has no tolerance
                names.append(name)
    yield from (Route(name, factor) for name in names for factor in _FACTORS)
    yield Route(chosen, _LAST_FACTOR)  # takes long
