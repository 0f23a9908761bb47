"""Meshes on whose nodes the sources between the given nodes are known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from adaptsize._checks import as_sizes
from adaptsize.background import SimplexMesh
from adaptsize.background.bisection import Resolved, SizeAt, resolved
from adaptsize.domain_size import tuning
from adaptsize.domain_size.request import Request
from adaptsize.sizes.cones import lowest_of
from adaptsize.sizes.sources import KNOWN, CurveSource, PointSource, SizeOfPoint, Source
from adaptsize.typing import FloatArray

#: Longest edge of a cell over the size in it.  There are no nodes at points and on curves, and the
#: sizes at the nodes beside them are larger by g times the distance.
_USUAL, _AT_THIN = 2.0, 0.5
_THIN = (PointSource, CurveSource)


def with_sources_resolved(mesh: SimplexMesh, request: Request) -> Resolved | None:
    """Return a mesh divided at the sources that are small compared with its cells.

    Of the known sources none is missed.  Nor is a size of a function, or of one that is given as
    upper bound, if its gradient is at most g; else it may be, since they are evaluated at corners,
    middles of edges and centroids only.  Sources of other classes act on the nodes that there are.

    Returns
    -------
    Resolved or None
        None if no cell had to be divided.
    """
    room = mesh.n_points + min(
        tuning.MOST_NODES_OF_SOURCES, tuning.SHARE_OF_NODES * request.max_elements
    )
    found = None
    for size, is_proved, factor in _sizes_of(mesh, request):
        start = mesh if found is None else found.mesh
        finer = resolved(
            start, size, g=request.g, is_proved=is_proved, factor=factor, max_points=room
        )
        found = finer if found is None else finer.after(found)
    return None if found is None or found.mesh.n_points == mesh.n_points else found


def _sizes_of(mesh: SimplexMesh, request: Request) -> Iterator[tuple[SizeAt, bool, float]]:
    """Yield sizes between the nodes, whether they are graded, and the edges allowed over them."""
    known = [source for source in request.sources if isinstance(source, KNOWN)]
    thin = [source for source in known if isinstance(source, _THIN)]
    others = [source for source in known if not isinstance(source, _THIN)]
    for group, factor in ((thin, _AT_THIN), (others, _USUAL)):
        lowest = lowest_of(group, mesh, request.g)
        if lowest is not None:
            yield lowest, True, factor
    for name, function in _functions(request):
        yield partial(_checked, function, name), False, _USUAL


def _functions(request: Request) -> Iterator[tuple[str, SizeOfPoint]]:
    """Yield the functions of points among the sources and the upper bound, with their names."""
    for number, source in enumerate(request.sources):
        if not isinstance(source, Source):
            yield f"sources[{number}](points)", source
    if callable(request.h0):
        yield "h0", request.h0


def _checked(function: SizeOfPoint, name: str, points: FloatArray) -> FloatArray:
    return as_sizes(name, function(points), (len(points),))
