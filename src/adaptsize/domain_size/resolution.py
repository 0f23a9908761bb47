"""Meshes on whose nodes the sources between the given nodes are known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from adaptsize._checks import as_sizes
from adaptsize.background import SimplexMesh
from adaptsize.background.bisection import Resolved, SizeAt, resolved
from adaptsize.domain_size.request import Request
from adaptsize.sizes.cones import lowest_of
from adaptsize.sizes.sources import KNOWN, BallSource, BoxSource, RegionSource, SizeOfPoint, Source
from adaptsize.typing import FloatArray

#: Nodes that sources may add to a mesh, and their share of the elements allowed.  Before a mesh
#: generator adapts it, a resolved mesh has a quarter to an eighth of the nodes of the new one.
_MOST_NODES = 400_000
_SHARE = 0.25
#: Longest edge of a cell over the size in it.  Nodes inside boxes, balls and regions have their
#: size.  At a point, a curve or a boundary, sizes at the nodes beside it are larger.
_AT_SOLID, _AT_THIN = 2.0, 1.0
_SOLID = (BallSource, BoxSource, RegionSource)


def with_sources_resolved(mesh: SimplexMesh, request: Request) -> Resolved | None:
    """Return a mesh divided at the sources that are small compared with its cells.

    Of the known sources none is missed.  Functions, and the function that is given as upper bound,
    are evaluated at corners, middles of edges and centroids only.  Sources of other classes act on
    the nodes that there are.

    Returns
    -------
    Resolved or None
        None if no cell had to be divided.
    """
    room = mesh.n_points + min(_MOST_NODES, _SHARE * request.max_elements)
    found = None
    for size, g, factor in _sizes_of(mesh, request):
        start = mesh if found is None else found.mesh
        finer = resolved(start, size, g=g, factor=factor, max_points=room)
        found = finer if found is None else finer.after(found)
    return None if found is None or found.mesh.n_points == mesh.n_points else found


def _sizes_of(mesh: SimplexMesh, request: Request) -> Iterator[tuple[SizeAt, float | None, float]]:
    """Yield sizes between the nodes, their gradient limit, and the edges allowed over them."""
    known = [source for source in request.sources if isinstance(source, KNOWN)]
    solid = [source for source in known if isinstance(source, _SOLID)]
    thin = [source for source in known if not isinstance(source, _SOLID)]
    for group, factor in ((thin, _AT_THIN), (solid, _AT_SOLID)):
        lowest = lowest_of(group, mesh, request.g)
        if lowest is not None:
            yield lowest, request.g, factor
    for name, function in _functions(request):
        yield partial(_checked, function, name), None, _AT_SOLID


def _functions(request: Request) -> Iterator[tuple[str, SizeOfPoint]]:
    """Yield the functions of points among the sources and the upper bound, with their names."""
    for number, source in enumerate(request.sources):
        if not isinstance(source, Source):
            yield f"sources[{number}](points)", source
    if callable(request.h0):
        yield "h0", request.h0


def _checked(function: SizeOfPoint, name: str, points: FloatArray) -> FloatArray:
    return as_sizes(name, function(points), (len(points),))
