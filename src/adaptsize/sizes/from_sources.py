"""`size_from_sources`: the smallest size from several sources."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_sizes, as_slope, check_type
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.sizes import _on_grid
from adaptsize.sizes.sources import SizeOfPoint, Source, as_sources
from adaptsize.typing import FloatArray


def size_from_sources(
    background: SimplexMesh | CartesianGrid | Octree,
    sources: Source | SizeOfPoint | Iterable[Source | SizeOfPoint],
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
    background : SimplexMesh, CartesianGrid or Octree
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

    On a grid no search is needed.  The cost is O(1) per point, per box that a curve passes
    (none is missed), and per node of a box or ball.  Functions are called for active nodes
    only, up to a million at a time.  A point or curve where no node is active acts on the
    nearest active node.

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
    check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    slope = as_slope("g", g)
    on = background.mesh if isinstance(background, Octree) else background
    h0 = np.full(background.nodal_shape, np.inf)
    for number, source in enumerate(as_sources(sources)):
        if isinstance(source, Source):
            source.lower_sizes(on, slope, h0)
        else:
            name = f"sources[{number}](points)"
            given: npt.ArrayLike
            if isinstance(on, CartesianGrid):
                given = _on_grid.at_active_nodes(on, source, name)
            else:
                given = source(on.points)
            np.minimum(h0, as_sizes(name, given, h0.shape), out=h0)
    return h0
