"""The complete size function of a domain: ``size_function``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import (
    as_float_array,
    as_plain_array,
    check_type,
    checked_before,
    describe,
    refusal,
)
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import AnyBackground, CartesianGrid, Octree, SimplexMesh
from adaptsize.background.image import Image
from adaptsize.background.octree import as_box
from adaptsize.background.simplex import as_own
from adaptsize.domain_size.budget import within_budget
from adaptsize.domain_size.by_domain import LevelSet, SizedDomain, mesh_domain
from adaptsize.domain_size.implicit import ImplicitDomain, octree_around
from adaptsize.domain_size.of_image import ImageDomain
from adaptsize.domain_size.on_surface import warn_of_left_out
from adaptsize.domain_size.prescribed import Implicit
from adaptsize.domain_size.request import Request
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.geometry.implicit_surface import checked as checked_function
from adaptsize.options import SizeFunctionOptions, checked, with_options
from adaptsize.options.checking import refuse_unused
from adaptsize.sizes.sources import SourcesLike
from adaptsize.typing import ProgressCallback, Unpack

Domain: TypeAlias = (
    SimplexMesh | Implicit | Image | npt.ArrayLike | tuple[CartesianGrid, npt.ArrayLike]
)


@recorded("size_function")
@with_options(SizeFunctionOptions)
def size_function(
    domain: Domain,
    *,
    background: AnyBackground | Literal["auto"] | None = None,
    box: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    sources: SourcesLike | None = (),
    h0: npt.ArrayLike | Implicit | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[SizeFunctionOptions],
) -> SizeFunction:
    r"""Return the size function of a domain, with gradient limiting.

    The least of the bounds by curvature, width and separation and of the prescribed ones is
    limited to :math:`|\nabla h| \le g`: equations (18) and (19) of P.-O. Persson, Engineering with
    Computers 22 (2006) 95-109.

    Parameters
    ----------
    domain : SimplexMesh, callable, Image, array, or tuple (CartesianGrid, array)
        A mesh of tetrahedra, or of triangles in the plane; a closed polyline, or a surface, which
        is repaired, and made smooth where rough within ``tolerance``; an implicit function
        f(points[n, dim]) -> [n], negative inside; an image, labels or mask; a grid and distances.
    background : SimplexMesh, CartesianGrid, Octree, "auto" or None
        Carries the sizes.  By default the mesh itself; of a surface a copy, refined where its
        triangles are long; of a closed polyline, a level set or an image a grid; of a callable an
        octree in ``box``, refined until sizes between its nodes are right within 5 %.
    box : tuple (lower, upper), optional
        Corners of a box around the domain, for callables without ``background``.
    sources : as in `size_from_sources`
        Prescribed sizes: points, curves, boxes, boundary tags, callables ...
    h0 : array_like of float, SizeFunction or callable, optional
        Further upper bounds: values at the nodes of the background (of ``domain`` by default), or
        a function of points, as it must be for callables without ``background``.
    progress : callable or bool, optional
        Called with a text and the fraction completed.  True shows a progress bar on a terminal.
    **options

    Returns
    -------
    SizeFunction
        Defined everywhere.  Outside the domain it continues with the sizes at the boundary, and
        grows from a surface by ``g`` up to ``hmax``.  Its ``report`` is a `SizeReport`: which cause
        controls how much, the parameters chosen, and the predicted number of elements.

    Raises
    ------
    ValueError
        If the domain is of another kind, needs a box or a grid, is empty or fills the grid, if an
        image is a photo or has no objects, or if an option is out of range.
    TooManyElementsError
        If the boundary within the tolerance, or given parameters, need more elements than allowed.

    Warns
    -----
    ResolutionWarning, InputWarning, OpenSurfaceWarning
        If the parameters do not allow the number of elements, an octree would need too many leaves,
        a source lies outside, a surface was repaired, facets are inside of bodies, or objects lost.

    Notes
    -----
    To stay within ``max_elements``, or to predict ``elements`` or ``nodes`` of a mesh or surface
    within 2 %, sizes and numbers of elements that are not given are changed, never the tolerance.

    On a given octree, or a mesh of more than the domain, sizes propagate also through the outside.

    Examples
    --------
    >>> def disc(x):
    ...     return (x**2).sum(axis=1) ** 0.5 - 1.0
    >>> box = [-1.1, -1.1], [1.1, 1.1]
    >>> size = size_function(disc, box=box, elements_per_radian=2, elements_across=0, g=0.1, hmax=2)
    >>> size([[1.0, 0.0], [0.0, 0.0]]).round(2)
    array([0.5, 0.6])
    """
    if isinstance(background, str) and background == "auto":
        background = None
    if background is not None:
        check_type("background", background, SimplexMesh, CartesianGrid, Octree)

    def find(request: Request) -> SizeFunction:
        own = as_own(domain)
        refuse_unused(_kind_of(own), options, " ".join(describe(own).split()))
        with checked_before():
            return within_budget(_as_domain(own, background, box, request), request)

    return sizes_of(find, sources=sources, h0=h0, progress=progress, **options)


def sizes_of(
    find: Callable[[Request], SizeFunction],
    *,
    sources: SourcesLike | None = (),
    h0: npt.ArrayLike | Implicit | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[SizeFunctionOptions],
) -> SizeFunction:
    """Return the sizes that a function finds for a request, whose options are checked."""
    given = checked(SizeFunctionOptions, options)
    with reporting(progress) as listener:
        return find(Request.of(given, sources, h0, listener))


def _kind_of(domain: object) -> str:
    """Return the kind of a domain, one of `DOMAINS`."""
    if isinstance(domain, SimplexMesh):
        return "meshes"
    return "implicit functions" if callable(domain) or isinstance(domain, tuple) else "images"


def _as_domain(
    domain: Domain, background: AnyBackground | None, box: Any, request: Request
) -> SizedDomain:
    """Return the domain as one of the supported kinds."""
    if box is not None and (background is not None or not callable(domain)):
        got = describe(domain if background is None else background)
        raise refusal("box", f"applies to functions without a background, got it with {got}")
    if isinstance(domain, SimplexMesh):
        if domain.dim == 3 and domain.cell_dim == 2:
            warn_of_left_out(domain)
        angle, tolerance = request.crease_angle, request.tolerance
        return mesh_domain(domain, background, angle, tolerance=tolerance)
    if callable(domain):
        return _implicit_domain(domain, background, box, request.progress)
    if background is not None and not isinstance(background, CartesianGrid):
        raise ValueError(
            "background must be a CartesianGrid for a domain that is not a mesh or a function, "
            f"got {background!r}"
        )
    if isinstance(domain, tuple) and len(domain) == 2 and isinstance(domain[0], CartesianGrid):
        grid, phi = domain
        if background not in (None, grid):
            raise ValueError(f"background must be that of phi, {grid!r}, got {background!r}")
        return LevelSet(grid, as_float_array("phi", phi, grid.shape))
    if background is not None:
        raise ValueError(f"background must be None for an image, got {background!r}")
    if not isinstance(domain, Image) and as_plain_array("domain", domain).dtype.kind not in "biuf":
        raise ValueError(
            "domain must be a SimplexMesh, a callable, an Image or an array of numbers, or a tuple "
            f"(CartesianGrid, distances), got {describe(domain)}"
        )
    return ImageDomain.of(domain, request.options, request.progress)


def _implicit_domain(
    function: Implicit, background: AnyBackground | None, box: Any, report: ProgressCallback
) -> SizedDomain:
    """Return the domain where a function is negative."""
    if background is None:
        if box is None:
            raise ValueError(
                "box must be given with a callable domain: (lower, upper), or a background"
            )
        if not isinstance(box, tuple | list) or len(box) != 2:
            raise ValueError(f"box must be a pair (lower, upper), got {describe(box)}")
        lower, upper = as_box(*box)
        values_at = checked_function(function)
        return ImplicitDomain(values_at, octree_around(values_at, lower, upper))
    if isinstance(background, CartesianGrid):
        return LevelSet(background, signed_distance(background, function, progress=report))
    if isinstance(background, Octree):
        return ImplicitDomain(checked_function(function), background, is_fixed=True)
    raise ValueError(
        f"background must be a CartesianGrid or an Octree for a function, got {background!r}"
    )
