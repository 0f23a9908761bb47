"""Sources of sizes: points, curves, boundaries, boxes, balls, regions and functions."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import wraps
from typing import Any, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_float_array,
    as_number,
    as_points,
    as_sizes,
    describe,
    place_text,
    refuse_where,
    warn_caller,
)
from adaptsize.background import AnyMesh, CartesianGrid, SimplexMesh
from adaptsize.background.interpolation import places_of
from adaptsize.errors import InputWarning, OptionError
from adaptsize.sizes import touched
from adaptsize.sizes.touched import Tags, lower
from adaptsize.typing import FloatArray

SizeOfPoint: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
_Mesh: TypeAlias = AnyMesh | CartesianGrid
#: Longer arrays are shown by their shapes.
LONGEST_TEXT = 200
_S = TypeVar("_S")
_R = TypeVar("_R")


def _about_sources(check: Callable[[_S, int], _R]) -> Callable[[_S, int], _R]:
    """Return a method whose errors are those of the option ``sources``."""

    @wraps(check)
    def checked(source: _S, dim: int) -> _R:
        try:
            return check(source, dim)
        except ValueError as error:
            text = f"{source!r:.99}: {error}"
            raise OptionError(text, ["sources"]) from error

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


class _Rows(Source):
    """A source with a row for each of many points, which its text does not list."""

    def __repr__(self) -> str:
        """Return the call that makes it, with the shapes of long arrays."""
        given = (f"{name}={_short(value)}" for name, value in vars(self).items())
        return f"{type(self).__name__}({', '.join(given)})"


def _keep(source: Any) -> None:
    """Replace arrays and lists of a frozen source by copies: the caller may change his own."""
    for name, value in vars(source).items():
        if isinstance(value, np.ndarray | list):
            object.__setattr__(source, name, copy.deepcopy(value))


def _short(value: Any) -> str:
    """Return a value, or the shape of an array whose text is long."""
    text = repr(value)
    return text if len(text) <= LONGEST_TEXT else f"<array of shape {np.shape(value)}>"


@dataclass(frozen=True, eq=False, repr=False)
class PointSource(_Rows):
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
        """Refuse sizes that are not positive, and keep what is given."""
        _keep(self)
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


@dataclass(frozen=True, eq=False, repr=False)
class CurveSource(_Rows):
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
        """Refuse sizes that are not positive, and keep what is given."""
        _keep(self)
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
        """Refuse sizes that are not positive, and keep what is given."""
        _keep(self)
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
        """Refuse sizes that are not positive, and keep what is given."""
        _keep(self)
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
        """Refuse sizes that are not positive, and keep what is given."""
        _keep(self)
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
        """Refuse sizes that are not positive, and keep what is given."""
        _keep(self)
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


#: Those that all ranks search together.
KNOWN = (PointSource, CurveSource, BoundarySource, RegionSource, BoxSource, BallSource)
