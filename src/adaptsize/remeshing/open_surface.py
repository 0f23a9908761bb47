"""Surfaces that do not enclose a volume clearly: open ones, bodies that overlap or nearly touch."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number
from adaptsize.background import SimplexMesh
from adaptsize.errors import OpenSurfaceWarning
from adaptsize.remeshing.hole_filling import (
    bodies_of,
    boundary_loops,
    fill_loop,
    merged_surface,
)
from adaptsize.remeshing.overlaps import (
    OverlappingBodies,
    bodies_with_near_boxes,
    overlapping_bodies,
)
from adaptsize.typing import FloatArray

#: Pairs of bodies whose distance is measured, those with the closest boxes first.
_MOST_PAIRS = 200
#: Coordinates of a mean smaller than this times the diagonal are 0.
_ROUNDING = 1e-12
#: Surfaces with more bodies than this are not examined for bodies that nearly touch.
_MOST_BODIES = 2000


@dataclass(frozen=True)
class OpenBoundary:
    """The open edges of a surface: edges of one triangle only."""

    n_edges: int
    """Number of open edges."""
    n_loops: int
    """Number of loops that they form: holes, and the rims of sheets."""
    n_loose: int
    """Number of open edges that are not part of a loop."""
    length: float
    """Length of the loop around the largest area; 0 if there is no loop."""
    place: tuple[float, ...]
    """Mean of the nodes of that loop, or of the open edges."""

    def __str__(self) -> str:
        """Return counts and the largest hole."""
        place = ", ".join(f"{x:.4g}" for x in self.place)
        edges = f"{self.n_edges} open edge" + ("s" if self.n_edges > 1 else "")
        if self.n_loops == 0:
            return f"{edges} around ({place})"
        loops = f"{self.n_loops} loop" + ("s" if self.n_loops > 1 else "")
        largest = "the largest " if self.n_loops > 1 else ""
        return f"{edges} in {loops}, {largest}{self.length:.4g} long around ({place})"


@dataclass(frozen=True)
class NearBodies:
    """Components of a surface that are closer to each other than a tolerance."""

    n_pairs: int
    """Number of pairs of components.  At most 200 are examined, those with the closest boxes."""
    distance: float
    """Smallest distance of a node, midpoint or centroid to the other component."""
    place: tuple[float, ...]
    """Where that is."""

    def __str__(self) -> str:
        """Return the number of pairs, and the distance and place of the closest one."""
        place = ", ".join(f"{x:.4g}" for x in self.place)
        pairs = (
            "1 pair of bodies is only"
            if self.n_pairs == 1
            else (f"{self.n_pairs} pairs of bodies are down to")
        )
        return f"{pairs} {self.distance:.3g} apart at ({place})"


def open_boundary(surface: SimplexMesh, within: float = 0.0) -> OpenBoundary | None:
    """Return the open edges of a surface in space, or None if it is closed.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.  Coincident points count as one.
    within : float
        Loops narrower than this are not counted: gaps that a generator with this tolerance
        closes.  The width is the area over half the length.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> print(open_boundary(SimplexMesh(points, [[0, 1, 3], [1, 2, 3], [2, 0, 3]])))
    3 open edges in 1 loop, 3.414 long around (0.3333, 0.3333, 0)
    """
    within = as_number("within", within, lower=0.0)
    mesh = merged_surface(surface)
    if mesh.is_closed:
        return None
    n_in_loops, n_edges, n_loops = 0, 0, 0
    largest, length, around = 0.0, 0.0, None
    for loop in boundary_loops(mesh):
        n_in_loops += len(loop)
        a, b, c = mesh.points[fill_loop(mesh.points, loop)].transpose(1, 0, 2)
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        ends = mesh.points[loop]
        whole = float(np.linalg.norm(ends - np.roll(ends, -1, axis=0), axis=1).sum())
        if area > 0.5 * within * whole:
            n_edges, n_loops = n_edges + len(loop), n_loops + 1
            if area > largest:
                largest, length, around = area, whole, ends
    open_edges = mesh.facets[mesh.facet_cell_counts == 1]
    n_loose = len(open_edges) - n_in_loops
    if n_loose == 0 and n_loops == 0:
        return None
    if around is None:
        around = mesh.points[np.unique(open_edges)]
    place = around.mean(axis=0)
    place[np.abs(place) < _ROUNDING * mesh.diagonal] = 0.0
    return OpenBoundary(n_edges + n_loose, n_loops, n_loose, length, tuple(place.tolist()))


def near_bodies(
    surface: SimplexMesh, within: float, *, overlapping: OverlappingBodies | None = None
) -> NearBodies | None:
    """Return the components of a surface that are closer than a distance, or None.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.  Coincident points count as one.
    within : float
        Distance in the unit of the coordinates.
    overlapping : OverlappingBodies or None
        Pairs to leave out, from `overlapping_bodies` of the same surface.

    Warns
    -----
    OpenSurfaceWarning
        If there are more than 2000 components.  Their distances are not examined then.

    Notes
    -----
    The distance is measured at the nodes, the midpoints of the edges and the centroids, so
    components that cross each other between these points may be missed: see `overlapping_bodies`.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.01], [1, 0, 0.01], [0, 1, 0.01]]
    >>> print(near_bodies(SimplexMesh(points, [[0, 1, 2], [3, 4, 5]]), 0.1))
    1 pair of bodies is only 0.01 apart at (0, 0, 0)
    """
    within = as_number("within", within, lower=0.0)
    mesh = merged_surface(surface)
    body = bodies_of(mesh)
    count = int(body.max()) + 1
    if count > _MOST_BODIES:
        warnings.warn(
            f"the surface has {count} bodies; whether they are closer to each other than the "
            f"tolerance was not examined, as there are more than {_MOST_BODIES}",
            OpenSurfaceWarning,
            stacklevel=2,
        )
    if not 1 < count <= _MOST_BODIES:
        return None
    known = () if overlapping is None else overlapping.pairs
    pairs = bodies_with_near_boxes(mesh, body, within)
    pairs = [(a, b) for a, b in pairs if (a + 1, b + 1) not in known]
    found: list[tuple[float, FloatArray]] = []
    for a, b in pairs[:_MOST_PAIRS]:
        best = min(
            (_nearest(mesh, body == one, body == other, within) for one, other in ((a, b), (b, a))),
            key=lambda candidate: candidate[0],
        )
        if best[0] <= within:
            found.append(best)
    if not found:
        return None
    distance, place = min(found, key=lambda candidate: candidate[0])
    return NearBodies(len(found), distance, tuple(place.tolist()))


def warn_of_surface(surface: SimplexMesh, tolerance: float) -> bool:
    """Warn of a surface whose volume a generator has to guess.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.
    tolerance : float
        Allowed distance of the new boundary, in the unit of the coordinates.

    Returns
    -------
    bool
        Whether a warning says that bodies may be joined.

    Warns
    -----
    OpenSurfaceWarning
        If the surface is open, or has bodies that overlap or are closer to each other than the
        tolerance.
    """
    holes = open_boundary(surface, tolerance)
    if holes is not None:
        warnings.warn(
            f"the surface is open: {holes}; the generator closes or drops what it does not clearly "
            "enclose; see close_holes, or remesh the surface with target='triangles'",
            OpenSurfaceWarning,
            stacklevel=3,
        )
    overlapping = overlapping_bodies(surface)
    if overlapping is not None:
        warnings.warn(
            f"{overlapping}; the generator fills their union; join the bodies before meshing to "
            "keep what is intended",
            OpenSurfaceWarning,
            stacklevel=3,
        )
    near = near_bodies(surface, tolerance, overlapping=overlapping)
    if near is not None:
        warnings.warn(
            f"{near}, less than the tolerance of {tolerance:.3g}: they may be joined; "
            "lower the tolerance to keep them apart",
            OpenSurfaceWarning,
            stacklevel=3,
        )
    return overlapping is not None or near is not None


def _nearest(
    mesh: SimplexMesh,
    one: npt.NDArray[np.bool_],
    other: npt.NDArray[np.bool_],
    within: float,
) -> tuple[float, FloatArray]:
    """Return the smallest distance from samples of one body to another, and the sample."""
    target = mesh.points[mesh.cells[other]]
    low, high = target.min(axis=(0, 1)) - within, target.max(axis=(0, 1)) + within
    corners = mesh.points[mesh.cells[one]]
    middles = 0.5 * (corners + corners[:, [1, 2, 0]])
    samples = np.concatenate([corners, middles, corners.mean(axis=1, keepdims=True)], axis=1)
    samples = np.unique(samples.reshape(-1, 3), axis=0)
    samples = samples[((samples >= low) & (samples <= high)).all(axis=1)]
    if len(samples) == 0:
        return np.inf, np.full(3, np.nan)
    low, high = samples.min(axis=0) - within, samples.max(axis=0) + within
    close = ((target.max(axis=1) >= low) & (target.min(axis=1) <= high)).all(axis=1)
    if not close.any():
        return np.inf, np.full(3, np.nan)
    cells = mesh.cells[other][close]
    nodes, local = np.unique(cells, return_inverse=True)
    part = SimplexMesh(mesh.points[nodes], local.reshape(cells.shape))
    distance = part.locator.nearest(samples)[2]
    first = int(np.argmin(distance))
    return float(distance[first]), samples[first]
