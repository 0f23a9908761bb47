"""The smallest of the sizes from several sources at each node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from hashlib import sha256
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_float_array, as_sizes, as_slope
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize.background import AnyMesh, CartesianGrid, Octree, PartitionedMesh, SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.ranks import SingleRank
from adaptsize.sizes.sources import KNOWN, SizeOfPoint, Source, SourcesLike, as_sources
from adaptsize.typing import FloatArray


@recorded("size_from_sources")
def size_from_sources(
    background: AnyMesh | CartesianGrid | Octree,
    sources: SourcesLike,
    *,
    g: float = GRADIENT_LIMIT,
) -> FloatArray:
    r"""Return the smallest of the sizes from several sources at each node.

    A source between the nodes acts on the nodes of the cells that it touches.  A node at the
    distance d from the source gets

    .. math:: h_0 = \mathrm{size} + g\,d,

    which is the size that a gradient limit g allows there.

    Parameters
    ----------
    background : SimplexMesh, PartitionedMesh, CartesianGrid or Octree
        Cells of a grid are its boxes, those of an octree the simplices of ``octree.mesh``.
    sources : source, callable, or several of them
        `PointSource`, `CurveSource`, `BoundarySource`, `RegionSource`, `BoxSource`, `BallSource`,
        or functions that take points, float64[n, dim], and return n sizes (``inf``: no bound).
    g : float, default 0.25
        Slope from a source to the nodes around it, 0 to 1e30, no unit.  Use the
        gradient limit that is used afterwards.  A smaller value makes the cells at the source
        finer than necessary, a larger one coarser than requested.

    Returns
    -------
    ndarray of float64, of ``background.nodal_shape``
        Sizes; ``inf`` at nodes that no source touches, and at inactive nodes of a grid.

    Raises
    ------
    ValueError
        If a size is not positive, a point has another dimension than the background, a tag
        does not occur (the message lists those that do), tags are used on a grid, or ``g`` is
        negative.

    See Also
    --------
    limit_gradient : the next step, which propagates the sizes into the mesh.

    Notes
    -----
    Distances are straight, but only nodes of cells that a source touches are set, so no source
    acts across a gap in the mesh.  The cost is O(log n) per point, O(n) per box or ball, and
    O(log n) per cell that a curve passes.  Cells that a curve only clips at a corner may be
    missed, but not their neighbours along the curve.

    On a grid no search is needed.  The cost is O(1) per point, per box that a curve passes,
    and per node of a box or ball.  Functions are called for active nodes
    only, up to a million at a time.  A point or curve where no node is active acts on the
    nearest active node.

    On a mesh in parts, all ranks must give the same sources.  Each rank searches its own cells,
    and ranks exchange the distances of points and of samples of curves from their parts, one
    number each (two reductions for points and boxes, and for each halving of the longest segment
    of a curve), and at the end the sizes at shared nodes.  Sources of classes of your own get the
    mesh of each rank, and must set the nodes of each cell by this cell alone.

    Examples
    --------
    A point that is 0.5 away from two nodes, and a size at the boundary on the left:

    >>> from adaptsize import BoundarySource, PointSource
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]],
    ...                    tagged_facets=[[0, 3]], facet_tags=[7])
    >>> size_from_sources(mesh, PointSource([0.5, 0.0], 0.01), g=0.2).round(3)
    array([0.11 , 0.11 , 0.234,   inf])
    >>> size_from_sources(mesh, [PointSource([0.5, 0.0], 0.01), BoundarySource(0.1, tags=7)],
    ...                   g=0.2).round(3)
    array([0.1  , 0.11 , 0.234, 0.1  ])

    On a grid the result has its shape:

    >>> grid = CartesianGrid([0.0, 0.0], spacing=1.0, shape=(3, 2))
    >>> size_from_sources(grid, PointSource([0.5, 0.0], 0.01), g=0.2).round(3)
    array([[0.11 , 0.234],
           [0.11 , 0.234],
           [  inf,   inf]])
    """
    background = as_mesh("background", background, PartitionedMesh, CartesianGrid, Octree)
    on = background.mesh if isinstance(background, Octree) else background
    h0 = np.full(background.nodal_shape, np.inf)
    ranks = SingleRank() if isinstance(on, CartesianGrid) else on.ranks
    several, slope = ranks.agree(lambda: (as_sources(sources), as_slope("g", g)))
    if ranks.size > 1:
        digests = {f"sources[{k}]": _digest(source) for k, source in enumerate(several)}
        ranks.require_equal(sources=len(several), g=slope)
        ranks.require_equal(**digests)
    for number, source in enumerate(several):
        if isinstance(source, KNOWN):
            source.lower_sizes(on, slope, h0)
        else:
            local = on.mesh if isinstance(on, PartitionedMesh) else on
            ranks.agree(partial(_lower_by, source, number, local, slope, h0))
    return h0 if isinstance(on, CartesianGrid) else on.shared.merge(h0, np.minimum)


def _lower_by(
    source: Source | SizeOfPoint,
    number: int,
    mesh: SimplexMesh | CartesianGrid | None,
    g: float,
    h0: FloatArray,
) -> None:
    """Lower sizes (In/Out: h0) by a function, or by a source of another class."""
    if mesh is None:
        return
    if isinstance(source, Source):
        source.lower_sizes(mesh, g, h0)
        return
    name = f"sources[{number}](points)"
    given: npt.ArrayLike
    if isinstance(mesh, CartesianGrid):
        given = _at_active_nodes(mesh, source, name)
    else:
        given = source(mesh.points)
    np.minimum(h0, as_sizes(name, given, h0.shape), out=h0)


def _at_active_nodes(
    grid: CartesianGrid, function: Callable[[FloatArray], npt.ArrayLike], name: str
) -> FloatArray:
    """Return the values of a function at active nodes, and inf at other nodes."""
    values = np.full(grid.shape, np.inf)
    for slab, points in grid.slabs():
        wanted = np.ones(len(points), np.bool_)
        if grid.active is not None:
            wanted = grid.active[slab].ravel()
        here = points[wanted]
        part = values[slab].reshape(-1)  # a view: slabs are contiguous
        part[wanted] = as_float_array(name, function(here), (len(here),))
    return values


def _digest(source: Any) -> str:
    """Return the class of a source, with the values of those that all ranks search together."""
    name = type(source).__name__
    if not isinstance(source, KNOWN):
        return name
    found = sha256()
    for field in fields(source):
        value = getattr(source, field.name)
        if isinstance(value, SimplexMesh):
            found.update(value.points.tobytes() + value.cells.tobytes())
            continue
        try:
            found.update(as_float_array(field.name, value).tobytes())
        except ValueError:
            found.update(repr(value).encode())
    return f"{name} {found.hexdigest()[:8]}"
