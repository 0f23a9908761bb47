"""Sizes that sources allow at any point, straight through space: lower bounds of limited sizes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import singledispatch
from typing import Any

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import cut_out
from adaptsize.background.topology import compacted
from adaptsize.limiting.exact.field import field_of_cells
from adaptsize.sizes.sources import (
    BallSource,
    BoundarySource,
    BoxSource,
    CurveSource,
    PointSource,
    RegionSource,
)
from adaptsize.sizes.touched import rows_with_tags
from adaptsize.typing import FloatArray, IntArray

#: Takes points, float64[n, dim], and returns sizes, float64[n].
Cone = Callable[[FloatArray], FloatArray]
#: Points up to which the distances from all of them are computed.
_FEW = 64
_NO_CELLS = np.empty((0, 2), np.int32)


def lowest_of(sources: Sequence[Any], mesh: SimplexMesh, g: float) -> Cone | None:
    r"""Return the smallest size that any of the known sources allows at points.

    The size of a source with the set S is

    .. math:: \min_{y \in S} \, (\mathrm{size}(y) + g \, |x - y|),

    whatever lies between x and y.  Sizes that are limited inside a domain, where paths are longer,
    are nowhere smaller.

    Parameters
    ----------
    sources : sequence of sources
        Functions, and sources of classes of the caller's own, are ignored.
    mesh : SimplexMesh
        Whose boundary, tags and cells the sources refer to.
    g : float
        Gradient limit.

    Returns
    -------
    callable or None
        None if there is no known source.
    """
    cones = [cone_of(source, mesh, g) for source in sources]
    known = [cone for cone in cones if cone is not None]
    if not known:
        return None
    return lambda points: np.minimum.reduce([cone(points) for cone in known])


@singledispatch
def cone_of(source: Any, mesh: SimplexMesh, g: float) -> Cone | None:
    """Return the size that one source allows at points, or None if that is not known.

    See `lowest_of`.
    """
    return None


@cone_of.register
def _(source: PointSource, mesh: SimplexMesh, g: float) -> Cone:
    places, sizes = source.rows(mesh.dim)
    return _around(places, _NO_CELLS, sizes, g)


@cone_of.register
def _(source: CurveSource, mesh: SimplexMesh, g: float) -> Cone:
    curve = source.segments(mesh.dim)
    return _around(curve.points, curve.cells, source.rows(mesh.dim)[1], g)


@cone_of.register
def _(source: BoundarySource, mesh: SimplexMesh, g: float) -> Cone:
    if source.tags is None:
        facets = mesh.facets[mesh.facet_cell_counts == 1]
    else:
        rows, chosen = rows_with_tags(mesh, "facet", source.tags)
        facets = rows[chosen]
    return _around_facets(mesh, facets, source.size, g)


@cone_of.register
def _(source: RegionSource, mesh: SimplexMesh, g: float) -> Cone:
    cells, inside = rows_with_tags(mesh, "cell", source.tags)
    region = cut_out(mesh.points, cells[inside])[0]
    around = _around_facets(region, region.facets[region.facet_cell_counts == 1], source.size, g)

    def cone(points: FloatArray) -> FloatArray:
        is_in = inside[mesh.locator.nearest(points)[0]]
        return np.where(is_in, source.size, around(points))

    return cone


@cone_of.register
def _(source: BoxSource, mesh: SimplexMesh, g: float) -> Cone:
    low, high = source.corners(mesh.dim)
    return lambda points: (
        source.size + g * np.linalg.norm(points - np.clip(points, low, high), axis=1)
    )


@cone_of.register
def _(source: BallSource, mesh: SimplexMesh, g: float) -> Cone:
    centre = source.middle(mesh.dim)

    def cone(points: FloatArray) -> FloatArray:
        away = np.linalg.norm(points - centre, axis=1) - source.radius
        return np.asarray(source.size + g * np.maximum(away, 0.0))

    return cone


def _around_facets(mesh: SimplexMesh, facets: IntArray, size: float, g: float) -> Cone:
    """Return the cone of one size on facets: points, segments or triangles."""
    nodes, local = compacted(facets)
    cells = local if local.shape[1] > 1 else _NO_CELLS
    return _around(mesh.points[nodes], cells, np.full(len(nodes), size), g)


def _around(places: FloatArray, cells: IntArray, sizes: FloatArray, g: float) -> Cone:
    """Return the cone of sizes at points, and of linear ones on segments or triangles of them."""
    if len(places) == 0:
        return lambda points: np.full(len(points), np.inf)
    if len(places) > _FEW or len(cells):
        return _by_tree(places, cells, sizes, g)

    def cone(points: FloatArray) -> FloatArray:
        least = np.full(len(points), np.inf)
        for place, size in zip(places, sizes, strict=True):
            np.minimum(least, size + g * np.linalg.norm(points - place, axis=1), out=least)
        return least

    return cone


def _by_tree(places: FloatArray, cells: IntArray, sizes: FloatArray, g: float) -> Cone:
    def in_plane(points: FloatArray) -> FloatArray:  # a line lies in a plane
        return points if points.shape[1] > 1 else np.column_stack([points, 0.0 * points])

    field = field_of_cells(in_plane(places), cells, sizes, g)
    return lambda points: field.evaluate(in_plane(points), np.full(len(points), np.inf))
