"""SizeFunction: nodal sizes on a background, callable at any point."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from adaptsize._calls import inherit_origin, recorded
from adaptsize._checks import (
    as_float_array,
    as_limits,
    as_number,
    as_points,
    as_sizes,
    as_slope,
    check_type,
    describe,
    one_of,
    place_text,
    refuse_where,
    warn_caller,
)
from adaptsize._pickling import ReadOnlyState
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.background.interpolation import nodes_in_domain
from adaptsize.background.simplex import as_mesh, as_own
from adaptsize.errors import InputWarning, OutsideError
from adaptsize.typing import Background, FloatArray, Unpack

if TYPE_CHECKING:
    from adaptsize._size_report import SizeReport
    from adaptsize.domain_size.cost import Cost
    from adaptsize.domain_size.parts import Parts
    from adaptsize.domain_size.sparse import SparseSize
    from adaptsize.limiting.exact.field import ExactField
    from adaptsize.limiting.inside import InnerSizes, SolidField
    from adaptsize.limiting.sources import SizeSources
    from adaptsize.options import ScaledPictureOptions
    from adaptsize.plot.pictures import Picture
    from adaptsize.sizes.time_step import Coefficient

# Points this far outside, relative to the diagonal of the background, count as inside.
_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class SizeFunction(ReadOnlyState):
    """A size function: requested edge lengths on a background, defined everywhere.

    Between the nodes the sizes are interpolated: linearly on simplices (an octree is divided
    into simplices), multilinearly on grids.  Called with points of shape (n, dim), it
    returns n sizes, so it can be passed to mesh generators that take a function.

    Parameters
    ----------
    background : SimplexMesh, CartesianGrid or Octree
        Carries the nodes.
    values : array_like of float, of ``background.nodal_shape``
        Requested edge length at each node, in the unit of the coordinates: positive, inf
        where there is no bound.  Copied and read-only.
    outside : {"nearest", "error"}
        Treatment of points outside the background: take the value at the closest
        point of the background, or raise an OutsideError.  Points within 1e-9 times the
        diagonal count as inside.
    sources : SizeSources, optional
        ``info.sources`` of the `limit_gradient` call that computed ``values``.  Points inside
        then get their size directly from the sources, without interpolation error.  Size
        functions derived from this one by `clip`, `minimum` or `on` interpolate again.
    g : float, optional
        Gradient with which the size grows off a background that does not fill its space,
        such as a surface.  At a point x the size is the minimum of ``h(y) + g |x - y|`` over all
        points y of the background, and at most ``hmax``.  In the solid that a surface encloses,
        only points y that x sees count: the line between them must not leave the solid.  If the
        best y of all is hidden, the size is that from the seen ones around the closest point of
        the surface.  Without g, the size off such a background is that at the closest point.
    hmax : float, default inf
        Upper limit of the sizes off the background.  Requires g.
    report : SizeReport, optional
        What controls the sizes; set by `size_function`.
    inner : InnerSizes, optional
        The solid that a surface encloses, and sources inside it; set by `size_function`.

    Raises
    ------
    ValueError
        If ``background`` is of another kind, ``values`` has another shape, a value is not
        positive or is NaN (the message names the first one), ``outside`` is unknown, ``sources``
        belong to a background with other nodes or cells, or ``g`` is given for a background that
        fills its space.

    Notes
    -----
    A point strictly between a node with inf and a finite node gets inf.  Nodes with
    weight zero are ignored, so a finite node keeps its value.  Inactive nodes of a grid
    are ignored too; the size is inf where no active node remains.

    Location costs O(log n) per point in meshes and octrees; see `SimplexLocator`.  On grids
    it costs a few operations per point.

    Examples
    --------
    >>> from adaptsize import SimplexMesh
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> size = SizeFunction(square, [0.1, 0.2, 0.3, 0.2])
    >>> size([[0.5, 0.5], [0.5, 0.0], [2.0, 0.0]])
    array([0.2 , 0.15, 0.2 ])
    >>> size.clip(hmax=0.15).values
    array([0.1 , 0.15, 0.15, 0.15])

    On a grid the values have its shape:

    >>> from adaptsize import CartesianGrid
    >>> grid = CartesianGrid([0, 0], spacing=1.0, shape=(2, 2))
    >>> SizeFunction(grid, [[0.1, 0.2], [0.2, 0.5]])([[0.5, 0.5]])
    array([0.25])
    """

    background: Background
    values: FloatArray
    _: KW_ONLY
    outside: Literal["nearest", "error"] = "nearest"
    sources: SizeSources | None = None
    g: float | None = None
    hmax: float = np.inf
    report: SizeReport | None = None
    inner: InnerSizes | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "background", as_own(self.background))
        if not hasattr(self.background, "nodal_shape"):
            raise ValueError(
                "background must be a SimplexMesh, a CartesianGrid or an Octree, "
                f"got {describe(self.background)}"
            )
        values = as_sizes("values", self.values, self.background.nodal_shape).copy()
        values.flags.writeable = False
        inherit_origin(values, self.values)
        object.__setattr__(self, "values", values)  # bypasses the frozen dataclass
        one_of("outside", self.outside, ("nearest", "error"))
        hmax = as_number("hmax", self.hmax, lower=0.0, strict=True, allow_inf=True)
        object.__setattr__(self, "hmax", hmax)
        if self.g is not None:
            object.__setattr__(self, "g", as_slope("g", self.g))
            background = self.background
            is_thin = isinstance(background, SimplexMesh) and background.cell_dim < background.dim
            if not is_thin or self.outside == "error":
                raise ValueError(
                    "g is for sizes on surfaces and lines that continue off them, "
                    f"got g = {self.g:g} with outside={self.outside!r} on {self.background!r}"
                )
        elif hmax != np.inf:
            raise ValueError(f"hmax needs g, got hmax = {hmax:g} alone")
        if self.sources is None:
            return
        from adaptsize.limiting.sources import SizeSources, is_same

        check_type("sources", self.sources, SizeSources)
        if not is_same(self.sources.background, self.background):
            raise ValueError(
                f"sources must be those of the background, {self.background!r}, "
                f"got {self.sources!r} on {self.sources.background!r}"
            )

    def __repr__(self) -> str:
        """Return the range of the sizes and the background."""
        finite = self.values[np.isfinite(self.values)]
        sizes = "no finite size"
        if len(finite):
            sizes = f"sizes {finite.min():.4g} to {finite.max():.4g}"
            n_free = self.values.size - finite.size
            sizes += f", {n_free} nodes inf" if n_free else ""
        return f"SizeFunction({sizes}, on {self.background!r})"

    def plot(
        self, *, label: str = "mesh size h", **options: Unpack[ScaledPictureOptions]
    ) -> Picture:
        """Show the sizes in a window, or as a picture where no window can open.

        A window opens where there is a display, unless a ``path`` is given.  Notebooks show
        pictures.

        Parameters
        ----------
        label, **options
            As for `plot_size`.  ``window=False`` only draws, as that does; so does the environment
            variable ``PYVISTA_OFF_SCREEN=true``.

        Returns
        -------
        Picture
            ndarray of uint8, shape (height, width, 4): red, green, blue, opacity.

        Raises
        ------
        ValueError
            If an argument is bad.

        Examples
        --------
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
        >>> SizeFunction(mesh, [0.1, 0.2, 0.3, 0.2]).plot()  # doctest: +SKIP
        """
        from adaptsize.plot.pictures import plot

        return plot(self, label=label, **options)

    def _repr_html_(self) -> str:
        """Return a table and, of up to a million cells, a picture where this machine can draw."""
        from adaptsize.plot.notebook import html_of

        return html_of(self)

    def sparse(self, g: float | None = None) -> SparseSize:
        """Return the same sizes as a few points from which they grow.

        Of the nodes and point sources, those are kept whose size is not allowed by another one.

        Parameters
        ----------
        g : float, optional
            The gradient limit, if this is not from `size_function`.

        Returns
        -------
        SparseSize

        Raises
        ------
        ValueError
            If g is not known.

        Notes
        -----
        At the nodes of a convex domain, the sizes are the same up to rounding.  Between them, the
        result is the largest function of gradient g with these nodal values; it is the limited size
        itself if that grows from nodes and point sources only.  In other domains distances are
        straight here, so that sizes at nodes are never larger, but smaller across slits and gaps.
        The work is that of limiting.

        Examples
        --------
        >>> from adaptsize import PointSource, SimplexMesh, size_function
        >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
        >>> size = size_function(square, sources=PointSource([0.3, 0.4], 0.01), hmax=0.2)
        >>> sparse = size.sparse()
        >>> sparse
        SparseSize(1 points, g = 0.25, hmax = 0.2)
        >>> bool(np.allclose(sparse(size.background.points), size.values, rtol=1e-12))
        True
        """
        from adaptsize.domain_size.sparse import sparse_size

        return sparse_size(self, g)

    def cost(self, *, degree: int = 1, components: int = 1, speed: float = 1.0) -> Cost:
        """Return what a finite element method costs on a mesh with these sizes.

        Parameters
        ----------
        degree : int
            Polynomial degree of Lagrange elements, 1 to 20.
        components : int
            Number of components of the solution, such as 3 of a displacement.
        speed : float
            Largest speed of a signal, in units of length per time.

        Returns
        -------
        Cost

        Raises
        ------
        ValueError
            If there is no report, or an option is out of range.

        Notes
        -----
        The numbers of nodes, edges, faces and cells follow from the predicted cells and boundary
        facets by Euler's formula.  The unknowns and the nonzeros of the matrix are those of a
        conforming mesh with these numbers, exactly.  For grids, octrees and images the facets of
        the boundary are not known and count as none.  An explicit method is stable up to a multiple
        of the time step that depends on the method and the degree.

        Examples
        --------
        >>> from adaptsize import SimplexMesh, size_function
        >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
        >>> size = size_function(square, hmax=0.01, hmin=0.01)
        >>> print(f"{size.cost(degree=2).n_unknowns:.2g}")
        4.7e+04
        """
        from adaptsize.domain_size.cost import cost

        return cost(self, degree=degree, components=components, speed=speed)

    def time_step(
        self,
        *,
        velocity: Coefficient | None = None,
        diffusivity: Coefficient | None = None,
        courant: float = 1.0,
    ) -> float:
        r"""Return the largest time step of an explicit scheme on a mesh of these sizes.

        .. math::
            \Delta t = C \min_i \min\left(\frac{h_i}{|v_i|}, \frac{h_i^2}{2 d \kappa_i}\right)

        Parameters
        ----------
        velocity : float, array_like or callable, optional
            Speed, or vectors: a number, values at the nodes of the background, shape (n,) or
            (n, dim), of grids also of their shape, or a function of points that returns them.
        diffusivity : float, array_like or callable, optional
            Of diffusion, in squared lengths per time; shape (n,).
        courant : float, default 1.0
            C, which depends on the scheme.

        Returns
        -------
        float
            inf if nothing moves.

        Raises
        ------
        ValueError
            If neither or something invalid is given, or a size is inf; if values at the nodes are
            given for sizes with sources between them.

        Notes
        -----
        The minimum is that over the nodes of cells (active ones of grids), point sources, and
        samples of the sources inside a solid.

        Examples
        --------
        >>> grid = CartesianGrid([0.0, 0.0], 0.5, (3, 3))
        >>> size = SizeFunction(grid, np.full((3, 3), 0.1))
        >>> round(size.time_step(velocity=[2.0, 0.0]), 9), round(size.time_step(diffusivity=1.0), 9)
        (0.05, 0.0025)
        """
        from adaptsize.domain_size.sparse import extra_points
        from adaptsize.sizes.time_step import SizesAtPlaces, time_step

        background = self.background
        nodes = np.asarray(background.points).reshape(-1, background.dim)
        used = nodes_in_domain(background)
        h = np.minimum(np.ravel(self.values), self.hmax)
        if self._field is not None:  # sizes at nodes may exceed those that others allow there
            h[used] = self(nodes[used])
        refuse_where("size", used & np.isinf(h), h, "must be finite")
        inner = () if self.inner is None else self.inner.sources
        between = np.concatenate([extra_points(self)[0], *(source.samples for source in inner)])
        sizes = np.concatenate([h[used], self(between)])
        at = SizesAtPlaces(
            sizes, np.concatenate([nodes[used], between]), used.reshape(background.nodal_shape)
        )
        return time_step(at, velocity, diffusivity, courant)

    def parts(self, *, speed: float = 1.0) -> Parts:
        """Return the width, curvature, size and cost of each region and face of a domain.

        Regions are those of ``cell_tags`` of a mesh of full dimension.  Faces are those of
        ``tagged_facets`` there, and of ``cell_tags`` of a surface.  If there are no tags, faces are
        those of `SimplexMesh.tag_faces`, in the plane the lines between corners.

        Parameters
        ----------
        speed : float
            As in `SizeFunction.cost`.

        Returns
        -------
        tuple of Part
            Regions first, then faces, by tag.  It is shown as a table.

        Raises
        ------
        ValueError
            If there is no report, or the sizes are on a grid or an octree.

        Notes
        -----
        Widths, separations and radii are those that bound the size, so they are known where these
        bounds are active.  A node on several faces counts for each; sizes that grow from it count
        for the smallest of them.

        Examples
        --------
        >>> from adaptsize import SimplexMesh, size_function
        >>> corners, facets = [[0, 0], [4, 0], [4, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]]
        >>> strip = SimplexMesh(corners, [[0, 1, 2], [0, 2, 3]], tagged_facets=facets,
        ...                     facet_tags=[1, 1, 1, 2], tag_names={(1, 2): "inlet"})
        >>> [(part.name, part.measure) for part in size_function(strip).parts()]
        [('face 1', 9.0), ('inlet', 1.0)]
        """
        from adaptsize.domain_size.parts import parts

        return parts(self, speed=speed)

    def __call__(self, points: npt.ArrayLike) -> FloatArray:
        """Return the requested size at each point.

        Parameters
        ----------
        points : array_like of float, shape (n, dim)
            Any n, including 0.

        Returns
        -------
        ndarray of float64, shape (n,)

        Raises
        ------
        OutsideError
            If a point lies outside and ``outside="error"``.
        ValueError
            If ``points`` has another shape or a coordinate is not finite.
        """
        where = as_float_array("points", points)
        dim = self.background.dim
        if where.ndim == 1 and where.shape == (dim,):
            raise ValueError(
                f"points must have shape (n, {dim}), got {where.shape}; "
                f"a single point is an array of shape (1, {dim})"
            )
        where = as_points("points", where, dim)
        if self._field is not None:
            return self._field.evaluate(where, np.full(len(where), self.hmax))
        if self.sources is not None:
            return self._from_sources(where, self.sources)
        sizes: FloatArray
        sizes, distances = self.background.locator.interpolate(self.values, where)
        if self.outside == "error":
            self._refuse_outside(where, distances)
        elif distances.max(initial=0.0) > 10.0 * self.background.diagonal:
            self._warn_outside(where, distances)
        return sizes

    @cached_property
    def _field(self) -> ExactField | SolidField | None:
        """The sizes that the sizes on a surface or a line allow around it, if they have a g."""
        background = self.background
        if self.g is None or not isinstance(background, SimplexMesh):
            return None
        from adaptsize.limiting.exact.field import field_of_cells
        from adaptsize.limiting.inside import InnerSizes, SolidField

        if (background.cell_dim, background.dim) != (2, 3):
            return field_of_cells(background.points, background.cells, self.values, self.g)
        inner = InnerSizes.of(background) if self.inner is None else self.inner
        return SolidField(background, self.values, self.g, inner)

    def _from_sources(self, points: FloatArray, sources: SizeSources) -> FloatArray:
        """Return sizes without interpolation, except at points outside the background."""
        around, weights, distances = sources.background.locator.weights(points)
        if self.outside == "error":
            self._refuse_outside(points, distances)
        outside = distances > _TOLERANCE * self.background.diagonal
        sizes = sources.at(points, around, weights)
        if outside.any():
            sizes[outside] = self.background.locator.interpolate(self.values, points[outside])[0]
        return sizes

    def _warn_outside(self, points: FloatArray, distances: FloatArray) -> None:
        """Warn once of points so far away that their unit may be another one."""
        if self.__dict__.setdefault("_has_warned", False):
            return
        self.__dict__["_has_warned"] = True
        far = int(np.argmax(distances))
        warn_caller(
            f"point {far}, {place_text(points[far])}, is {distances[far]:.4g} outside of the "
            "background; it gets the size at the closest point of it (outside='error' refuses it)",
            InputWarning,
        )

    def _refuse_outside(self, points: FloatArray, distances: FloatArray) -> None:
        outside = distances > _TOLERANCE * self.background.diagonal
        if not outside.any():
            return
        first = int(np.argmax(outside))
        count = int(np.count_nonzero(outside))
        more = f" (and {count - 1} more)" if count > 1 else ""
        raise OutsideError(
            f"points must lie in the background, got points[{first}] = "
            f"{place_text(points[first])} at a distance of {distances[first]:.4g} from it{more}"
        )

    @recorded("SizeFunction.minimum")
    def minimum(self, other: SizeFunction) -> SizeFunction:
        """Return the smaller of two size functions at the nodes of this background.

        The minimum is taken at the nodes.  A small size of ``other`` between the nodes of this
        background is missed.  Call this method on the function with the finer background.

        Parameters
        ----------
        other : SizeFunction
            On the same background, or on another one of the same dimension.  The latter is
            evaluated at the nodes of this one, with its own rule for points outside.
        """
        check_type("other", other, SizeFunction)
        values = other.values
        if other.background is not self.background:
            values = _at_nodes(other, self.background)
        hmax = self.hmax if self.g is None else min(self.hmax, other.hmax)
        smaller = np.minimum(self.values, values)
        inner = None if self.inner is None else replace(self.inner, aims=None)
        return replace(self, values=smaller, sources=None, hmax=hmax, report=None, inner=inner)

    @recorded("SizeFunction.clip")
    def clip(self, hmin: float | None = None, hmax: float | None = None) -> SizeFunction:
        """Return the size function with its nodal values clipped to two bounds.

        Raising sizes to ``hmin`` never increases a gradient.  Lowering sizes to ``hmax``
        increases it only where inf becomes finite.

        Parameters
        ----------
        hmin, hmax : float, optional
            Positive, ``hmin <= hmax``.

        Raises
        ------
        ValueError
            If a bound is not positive, or ``hmin > hmax``.
        """
        lower, upper = as_limits(hmin, hmax, allow_inf=True)
        hmax = self.hmax if self.g is None else float(np.clip(self.hmax, lower, upper))
        values = np.clip(self.values, lower, upper)
        inner = None if self.inner is None else self.inner.clipped(lower, upper)
        return replace(self, values=values, sources=None, hmax=hmax, report=None, inner=inner)

    @recorded("SizeFunction.on")
    def on(self, background: Background) -> SizeFunction:
        """Return the size function sampled at the nodes of another background.

        Parameters
        ----------
        background : SimplexMesh, CartesianGrid or Octree
            Of the same dimension.  ``outside`` determines the values at its nodes outside
            this background.
        """
        background = as_mesh("background", background, CartesianGrid, Octree)
        values = _at_nodes(self, background)
        return SizeFunction(background, values, outside=self.outside)


def _at_nodes(size: SizeFunction, background: Background) -> FloatArray:
    """Return the sizes at the nodes of a background, of its nodal shape."""
    if isinstance(background, CartesianGrid):  # all nodes may not fit into memory at once
        return background.sample(size)
    return size(background.points).reshape(background.nodal_shape)
