"""Sizes from points, curves, boundaries, boxes, balls, regions and functions."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import partial, wraps
from hashlib import sha256
from typing import Any, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_float_array,
    as_number,
    as_points,
    as_sizes,
    as_slope,
    describe,
    place_text,
    refuse_where,
    warn_caller,
)
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize.background import AnyMesh, CartesianGrid, Octree, PartitionedMesh, SimplexMesh
from adaptsize.background.interpolation import places_of
from adaptsize.background.simplex import as_mesh
from adaptsize.errors import InputWarning, OptionError
from adaptsize.ranks import SingleRank
from adaptsize.sizes import touched
from adaptsize.sizes.touched import Tags, lower
from adaptsize.typing import FloatArray

SizeOfPoint: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
_Mesh: TypeAlias = AnyMesh | CartesianGrid
_S = TypeVar("_S")
_R = TypeVar("_R")


def _about_sources(check: Callable[[_S, int], _R]) -> Callable[[_S, int], _R]:
    """Return a method whose errors are those of the option ``sources``."""

    @wraps(check)
    def checked(source: _S, dim: int) -> _R:
        try:
            return check(source, dim)
        except ValueError as error:
            raise OptionError(str(error), ["sources"]) from error

    return checked


@runtime_checkable
class Source(Protocol):
    """A source that prescribes sizes at some nodes of a mesh or grid."""

    def lower_sizes(self, mesh: SimplexMesh | CartesianGrid, g: float, h0: FloatArray) -> None:
        """Lower the nodal sizes ``h0`` (In/Out) to those of the source.

        ``h0`` has the nodal shape of ``mesh``.  An octree is passed as its mesh.
        """


#: What functions take as sources: one, or several.
SourcesLike: TypeAlias = Source | SizeOfPoint | Iterable[Source | SizeOfPoint]


def as_sources(value: Any) -> list[Source | SizeOfPoint]:
    """Return one source or function, or several, as a list.

    Raises
    ------
    ValueError
        If there is something else.
    """
    try:
        several = list(value) if isinstance(value, Iterable) else [value]
    except TypeError as error:  # an array without an axis
        raise ValueError(f"sources must be a list of them, got {describe(value)}") from error
    for number, source in enumerate(several):
        if not (isinstance(source, Source) or callable(source)):
            raise ValueError(
                f"sources[{number}] must be a source or a function, got {describe(source)}"
            )
    return several


@dataclass(frozen=True, eq=False)
class PointSource(Source):
    """Sizes at points, which need not be nodes.

    The nodes of the cell around a point x get at most ``size + g |x_i - x|``, those of all cells
    around it if it lies between cells.  For a point outside the mesh, the nodes of the closest
    cells do.

    Parameters
    ----------
    points : array_like of float, shape (n, dim) or (dim,)
    size : float or array_like of float, shape (n,)
        Positive.
    """

    points: npt.ArrayLike
    size: npt.ArrayLike

    def __post_init__(self) -> None:
        """Refuse sizes that are not positive."""
        _positive(self.size)

    def lower_sizes(self, mesh: _Mesh, g: float, h0: FloatArray) -> None:
        """Lower ``h0`` (In/Out) at the nodes of the cells around the points."""
        points, size = self.rows(mesh.dim)
        at = touched.cells_around(mesh, points)
        # No point lies on a curved surface exactly.
        if isinstance(mesh, CartesianGrid) or (mesh.ranks.rank, mesh.cell_dim) == (0, mesh.dim):
            _warn_of_outside(points, at.distances, mesh.diagonal)
        away = np.linalg.norm(places_of(mesh)(at.nodes) - points[at.which], axis=1)
        lower(h0, at.nodes, size[at.which] + g * away)

    @_about_sources
    def rows(self, dim: int) -> tuple[FloatArray, FloatArray]:
        """Return checked positions and sizes, float64[n, dim] and float64[n]."""
        points = as_points(
            "points of a source", np.atleast_2d(as_float_array("points", self.points)), dim
        )
        return points, _sizes_per_row(self.size, len(points))


@dataclass(frozen=True, eq=False)
class CurveSource(Source):
    """Sizes along a curve, which need not follow edges of the mesh.

    The nodes of the cells that it passes through get at most ``size + g d`` with their
    distance d from the curve.

    Parameters
    ----------
    curve : SimplexMesh or array_like of float, shape (n, dim)
        Segments, or the points of one polyline in order (the first again at the end
        if it is closed).
    size : float or array_like of float, shape (n_points,)
        Positive; linear between the points of the curve.
    """

    curve: SimplexMesh | npt.ArrayLike
    size: npt.ArrayLike

    def __post_init__(self) -> None:
        """Refuse sizes that are not positive."""
        _positive(self.size)

    def lower_sizes(self, mesh: _Mesh, g: float, h0: FloatArray) -> None:
        """Lower ``h0`` (In/Out) at the nodes of the cells along the curve."""
        curve = self.segments(mesh.dim)
        size = self.rows(mesh.dim)[1]
        touched.lower_along(mesh, curve, size, g, h0)

    @_about_sources
    def rows(self, dim: int) -> tuple[FloatArray, FloatArray]:
        """Return the checked points of the curve and their sizes, float64[n, dim], float64[n]."""
        curve = self.segments(dim)
        return curve.points, _sizes_per_row(self.size, curve.n_points)

    @_about_sources
    def segments(self, dim: int) -> SimplexMesh:
        """Return the checked curve."""
        return _as_curve(self.curve, dim)


@dataclass(frozen=True, eq=False)
class BoundarySource(Source):
    """A size on the boundary of the mesh, or on tagged facets.

    A closed surface or curve is the boundary of what it encloses: all its nodes get the size.  The
    boundary of a grid is that of its active part: the active nodes next to the outside or to an
    inactive node, including diagonal neighbours.

    Parameters
    ----------
    size : float
        Positive.
    tags : int, str, or sequence of these, optional
        Tags in ``facet_tags`` (grids have none) or their names, in an image labels.  Names may be
        those of faces of a surface.  By default the whole boundary.
    """

    size: float
    tags: Tags | None = None

    def __post_init__(self) -> None:
        """Refuse sizes that are not positive."""
        _one_size(self.size)

    def lower_sizes(self, mesh: _Mesh, g: float, h0: FloatArray) -> None:
        """Lower ``h0`` (In/Out) at the nodes of the facets."""
        if self.tags is None:
            nodes = touched.boundary_nodes(mesh)
        else:
            nodes = touched.tagged_nodes(mesh, "facet", self.tags)
        lower(h0, nodes, self.size)


@dataclass(frozen=True, eq=False)
class RegionSource(Source):
    """A size in all cells with a tag, or all pixels with a label.  Grids have no tags.

    Parameters
    ----------
    tags : int, str, or sequence of these
        Tags in ``cell_tags`` or their names, in an image labels.
    size : float
        Positive.
    """

    tags: Tags
    size: float

    def __post_init__(self) -> None:
        """Refuse sizes that are not positive."""
        _one_size(self.size)

    def lower_sizes(self, mesh: _Mesh, g: float, h0: FloatArray) -> None:
        """Lower ``h0`` (In/Out) at the nodes of the cells."""
        lower(h0, touched.tagged_nodes(mesh, "cell", self.tags), self.size)


@dataclass(frozen=True, eq=False)
class BoxSource(Source):
    """A size in an axis-aligned box.  A box smaller than a cell acts on the cells it intersects.

    Nodes inside get at most ``size``.  The other nodes of cells that intersect the box get at most
    ``size + g d``, where d is their distance from the box.

    Parameters
    ----------
    lower, upper : array_like of float, shape (dim,)
        Opposite corners.
    size : float
        Positive.
    """

    lower: npt.ArrayLike
    upper: npt.ArrayLike
    size: float

    def __post_init__(self) -> None:
        """Refuse sizes that are not positive."""
        _one_size(self.size)

    def lower_sizes(self, mesh: _Mesh, g: float, h0: FloatArray) -> None:
        """Lower ``h0`` (In/Out) at the nodes of the cells that reach into the box."""
        lowest, highest = self.corners(mesh.dim)
        nodes = np.unique(touched.nodes_beside_box(mesh, lowest, highest))
        points = places_of(mesh)(nodes)
        distance = np.linalg.norm(points - np.clip(points, lowest, highest), axis=1)
        lower(h0, nodes, self.size + g * distance)

    @_about_sources
    def corners(self, dim: int) -> tuple[FloatArray, FloatArray]:
        """Return the checked corners, float64[dim] each."""
        lowest, highest = _one_point("lower", self.lower, dim), _one_point("upper", self.upper, dim)
        if (lowest > highest).any():
            raise ValueError(f"lower must be at most upper = {highest}, got {lowest}")
        return lowest, highest


@dataclass(frozen=True, eq=False)
class BallSource(Source):
    """A size in a ball (a disk in the plane).  A small ball acts on the cells it intersects.

    Nodes inside get at most ``size``.  The other nodes of cells that intersect the ball get at
    most ``size + g d``, where d is their distance from the ball.

    Parameters
    ----------
    centre : array_like of float, shape (dim,)
    radius : float
        >= 0.
    size : float
        Positive.
    """

    centre: npt.ArrayLike
    radius: float
    size: float

    def __post_init__(self) -> None:
        """Refuse sizes that are not positive."""
        _one_size(self.size)
        as_number("radius", self.radius, lower=0.0)

    def lower_sizes(self, mesh: _Mesh, g: float, h0: FloatArray) -> None:
        """Lower ``h0`` (In/Out) at the nodes of the cells that reach into the ball."""
        centre = self.middle(mesh.dim)
        nodes = np.unique(touched.nodes_beside_ball(mesh, centre, self.radius))
        distance = np.linalg.norm(places_of(mesh)(nodes) - centre, axis=1) - self.radius
        lower(h0, nodes, self.size + g * np.maximum(distance, 0.0))

    @_about_sources
    def middle(self, dim: int) -> FloatArray:
        """Return the checked centre, float64[dim]."""
        return _one_point("centre", self.centre, dim)


def _warn_of_outside(points: FloatArray, away: FloatArray, diagonal: float) -> None:
    """Warn of point sources that lie outside a flat domain, given their distances from it."""
    outside = away > 1e-9 * diagonal  # more than rounding
    if outside.any():
        first = int(np.argmax(outside))
        more = int(np.count_nonzero(outside)) - 1
        also = f" (and {more} more)" if more else ""
        warn_caller(
            f"the source at {place_text(points[first])} lies {away[first]:.4g} outside the domain"
            f"{also}: it acts only on the nodes of the closest cells, with its distance from them",
            InputWarning,
        )


def _one_point(name: str, value: npt.ArrayLike, dim: int) -> FloatArray:
    point = as_float_array(name, value, (dim,))
    refuse_where(name, ~np.isfinite(point), point, "must be finite")
    return point


def _one_size(value: float) -> float:
    return as_number("size", value, lower=0.0, strict=True)


def _positive(value: npt.ArrayLike) -> FloatArray:
    """Return one positive size, or several."""
    size = as_float_array("size", value)
    return as_sizes("size", size, size.shape)


def _sizes_per_row(value: npt.ArrayLike, n: int) -> FloatArray:
    """Return one positive size for each of n points."""
    size = _positive(value)
    return np.full(n, size) if size.ndim == 0 else as_sizes("size", size, (n,))


def _as_curve(value: SimplexMesh | npt.ArrayLike, dim: int) -> SimplexMesh:
    if isinstance(value, SimplexMesh):
        if value.cell_dim != 1 or value.dim != dim:
            raise ValueError(f"curve must consist of segments in {dim}-D, got {value!r}")
        return value
    points = as_points("curve", value, dim)
    if len(points) < 2:
        raise ValueError(f"curve must have at least 2 points, got {len(points)}")
    first = np.arange(len(points) - 1)
    return SimplexMesh(points, np.column_stack([first, first + 1]))


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


#: Those that all ranks search together.
KNOWN = (PointSource, CurveSource, BoundarySource, RegionSource, BoxSource, BallSource)


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
