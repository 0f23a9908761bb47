"""Checks of generated meshes, and other generators if one is not accepted (``strict``)."""

import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from adaptsize._checks import place_text
from adaptsize.background import SimplexMesh
from adaptsize.background.interfaces import skin_of
from adaptsize.errors import (
    BackendError,
    BackendTimeoutError,
    BoundaryWarning,
    MeshingError,
    ResolutionWarning,
)
from adaptsize.geometry.solid import Solid
from adaptsize.quality import check_mesh
from adaptsize.quality.boundary import (
    interface_distances,
    keeps_topology,
    overlapping_cells,
    tagged_parts,
    topology_of,
)
from adaptsize.quality.certificate import MeshCheck
from adaptsize.quality.requests import MISSING
from adaptsize.remeshing.protocol import Problem, Task
from adaptsize.remeshing.registry import able_backends
from adaptsize.remeshing.sizing import Size
from adaptsize.typing import FloatArray


def refuse_other_domain(new: SimplexMesh, problem: Problem, backend: str) -> None:
    """Refuse a mesh of another domain.

    Of an open surface, which a generator closes as it likes, only the bounding box counts.

    Raises
    ------
    BackendError
        If the bounding box, the boundary or the volume is far from the given one.
    """
    old = problem.mesh
    # A boundary farther away than this, over the diagonal, is another one.  Coarse sizes and cut
    # corners give less.
    far = max(0.05 * old.diagonal, 10.0 * problem.tolerance)
    ends = np.stack([[mesh.points.min(axis=0), mesh.points.max(axis=0)] for mesh in (new, old)])
    off = {"bounding box": float(np.abs(ends[0] - ends[1]).max())}
    old_skin, skin = skin_of(old)[0], skin_of(new)[0]
    if old_skin.is_closed:
        # An inner part of a surface may end up inside the volume, hence not the boundary of new.
        lost = _farthest(old_skin.points, skin, far, new)[0]
        off["boundary"] = max(lost, _farthest(skin.points, old_skin, far)[0])
    for what, distance in off.items():
        if distance > far:
            raise BackendError(
                f"{backend} returned a mesh of another domain: its {what} is off by "
                f"{distance / old.diagonal:.2g} of the diagonal, at most "
                f"{far / old.diagonal:.2g} is accepted"
            )
    if old_skin.is_closed and old.cell_dim == new.cell_dim == new.dim:
        change = float(new.measures.sum() / old.measures.sum() - 1.0)
        # Allowed change of the volume or area of a mesh.
        allowed = max(0.25, problem.tolerance * old_skin.measures.sum() / old.measures.sum())
        if abs(change) > allowed:
            raise BackendError(
                f"{backend} returned a mesh of another domain: its measure differs by {change:+.0%}"
            )


def refuse_flat(new: SimplexMesh, backend: str) -> None:
    """Refuse a mesh in the given coordinates with cells that have no measure.

    Generators work near the origin; far away from it, coordinates are rounded more.

    Raises
    ------
    BackendError
        With the number and the first place.
    """
    measures = new.signed_measures if new.cell_dim == new.dim else new.measures
    flat = np.flatnonzero(measures <= 0.0)
    if len(flat):
        place = place_text(new.points[new.cells[flat[0]]].mean(axis=0))
        raise BackendError(
            f"{len(flat)} cells of the mesh by {backend} are flat in the given coordinates, the "
            f"first at {place}: move the part nearer to the origin, or request larger sizes"
        )


def warn_of_deviation(
    new: SimplexMesh,
    old: SimplexMesh,
    tolerance: float,
    solid: Solid | None = None,
    *,
    may_be_joined: bool = False,
) -> None:
    """Warn if boundary or interfaces are much farther from the given ones than the tolerance.

    Only nodes are measured.  At any distance, another topology is warned of.  An open surface is
    left out: of that `warn_of_surface` warns.  Tetrahedra that overlap are warned of, too.

    Parameters
    ----------
    new, old : SimplexMesh
    tolerance : float
        In the unit of the coordinates.
    solid : Solid, optional
        What a surface encloses.
    may_be_joined : bool
        Whether parts of the old surface may be inside the mesh, or be joined, without a warning.

    Warns
    -----
    BoundaryWarning
        With the largest distance and its place, or both topologies.
    """
    found_twice = overlapping_cells(new) if new.cell_dim == 3 else None
    if found_twice is not None:
        text = f"{found_twice}, one at {place_text(found_twice.place)}; use strict=True"
        warnings.warn(text, BoundaryWarning, stacklevel=3)
    old_skin, skin = skin_of(old)[0] if solid is None else solid.skin, skin_of(new)[0]
    if not (old_skin.is_closed if solid is None else solid.is_closed):
        return
    # Distances of a boundary over the tolerance that are warned of.  Mmg on a first volume by
    # fTetWild reaches 4 times the tolerance, everything else less.
    far = 4.0 * tolerance
    off = {
        "the mesh misses part of the domain: its boundary is": _farthest(
            old_skin.points, skin, far, new
        ),
        "the boundary of the mesh is": _farthest(skin.points, old_skin, far),
    }
    names = "the mesh misses part of an interface: it is", "an interface of the mesh is"
    for what, found in zip(names, interface_distances(new, old), strict=False):
        if found.largest > far:
            off[what] = found.largest, found.points[found.distance.argmax()]
    what, (distance, where) = max(off.items(), key=lambda item: item[1][0])
    advice = "lower the tolerance if thin parts are lost, or use strict=True"
    if distance == 0.0 and may_be_joined:
        return
    if distance == 0.0:
        distance, where = _farthest(old_skin.points, skin, far)
        what = "the mesh fills both sides of a part of the surface: its boundary is"
        advice = "a body inside another one is a cavity only if its triangles have the other side"
    if distance > 0.0:
        text = f"{what} {distance:.3g} from the given one at {place_text(where, 4)}, where the "
        text += f"tolerance is {tolerance:.3g}"
    else:
        # A thin wall or gap may be lost within the distance that is not warned of.
        if keeps_topology(skin, old_skin):
            return
        text = (
            "the boundary of the mesh has another topology than the given one: "
            f"{topology_of(skin) or 'no closed manifold'}, given: {topology_of(old_skin)}"
        )
        advice = (
            "walls or gaps about as thin as the tolerance may be lost or filled; lower the "
            "tolerance or use strict=True"
        )
    warnings.warn(f"{text}; {advice}", BoundaryWarning, stacklevel=3)


def warn_of_lost_tags(new: SimplexMesh, old: SimplexMesh, backend: str) -> None:
    """Warn if a mesh has no facets with a tag that the old one has.

    Warns
    -----
    BoundaryWarning
        With these tags.
    """
    missing = tagged_parts(new, old).missing
    if missing:
        advice = "" if backend == "mmg" else "; backend='mmg' keeps tagged facets inside of regions"
        warnings.warn(
            f"the mesh has lost the facets with the tags {', '.join(missing)}, which {backend} "
            f"did not return{advice}",
            BoundaryWarning,
            stacklevel=3,
        )


def _farthest(
    points: FloatArray, skin: SimplexMesh, far: float, inside: SimplexMesh | None = None
) -> tuple[float, FloatArray]:
    """Return the distance and the place of the farthest point; 0 if none is beyond ``far``.

    The distance is that from a surface or curve, or from the mesh that it is the boundary of.
    """
    from scipy.spatial import cKDTree

    rest, distance = points, np.empty(0)
    near = cKDTree(skin.points).query(rest, distance_upper_bound=far)[0]
    rest = rest[~np.isfinite(near)]
    for mesh in (skin, inside):  # the search tree of the cells is built for few points only
        if len(rest) and mesh is not None:
            distance = mesh.locator.nearest(rest)[2]
            rest, distance = rest[distance > far], distance[distance > far]
    if not len(rest):
        return 0.0, points[0]
    k = int(distance.argmax())
    return float(distance[k]), rest[k]


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
            with warnings.catch_warnings():  # the accepted mesh is warned of
                warnings.filterwarnings("ignore", MISSING, ResolutionWarning)
                new = attempt(
                    backend=route.backend, tolerance=route.factor * tolerance, timeout=left
                )
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
        f"{demand.name} at {place_text(demand.places[0].point)}"
        for demand in check.failures
        if demand.places
    ]
    return f"; worst places of the last: {', '.join(places)}" if places else ""


def routes(task: Task, backend: str, chosen: str, *, keep_facets: bool) -> Iterator[Route]:
    """Yield the routes to try: a smaller tolerance, for "auto" other generators, the smallest."""
    names = [chosen]
    if backend == "auto":
        able = able_backends(task, keep_facets=keep_facets)
        names += [other.name for other in able if other.installed and other.name != chosen]
    # Tolerances passed to a generator, over the allowed one.  Generators keep a smaller tolerance
    # than the one they are given, at most 2.2 times.
    yield from (Route(name, factor) for name in names for factor in (1.0, 0.4))
    yield Route(chosen, 0.15)  # takes long
