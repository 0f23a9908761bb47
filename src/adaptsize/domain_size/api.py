"""The complete size function of a domain: ``size_function``."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, overload

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_flag,
    as_float_array,
    as_plain_array,
    as_points,
    check_type,
    describe,
)
from adaptsize._defaults import CREASE_ANGLE, GRADIENT_LIMIT
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.background.image import Image
from adaptsize.domain_size.budget import within_budget
from adaptsize.domain_size.by_domain import LevelSet, SizedDomain, mask_domain, mesh_domain
from adaptsize.domain_size.first_octree import octree_around
from adaptsize.domain_size.image_mask import as_image, distance_to_edge, mask_of
from adaptsize.domain_size.implicit import ImplicitDomain
from adaptsize.domain_size.report import SizeReport
from adaptsize.domain_size.request import (
    AnyBackground,
    Implicit,
    as_request,
)
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.geometry.implicit_surface import checked
from adaptsize.typing import FloatArray, ProgressCallback

Domain: TypeAlias = (
    SimplexMesh | Implicit | Image | npt.ArrayLike | tuple[CartesianGrid, npt.ArrayLike]
)


@overload
def size_function(
    domain: Domain,
    *,
    background: AnyBackground | Literal["auto"] | None = ...,
    box: tuple[npt.ArrayLike, npt.ArrayLike] | None = ...,
    elements_per_radian: float | None = ...,
    elements_across: float | None = ...,
    elements_between: float | None = ...,
    g: float = ...,
    hmin: float | None = ...,
    hmax: float | None = ...,
    crease_angle: float = ...,
    tolerance: float | None = ...,
    sources: Any = ...,
    h0: npt.ArrayLike | Implicit | None = ...,
    max_elements: float | None = ...,
    elements: float | None = ...,
    nodes: float | None = ...,
    full_output: Literal[False] = ...,
    progress: ProgressCallback | bool | None = ...,
) -> SizeFunction: ...
@overload
def size_function(
    domain: Domain,
    *,
    background: AnyBackground | Literal["auto"] | None = ...,
    box: tuple[npt.ArrayLike, npt.ArrayLike] | None = ...,
    elements_per_radian: float | None = ...,
    elements_across: float | None = ...,
    elements_between: float | None = ...,
    g: float = ...,
    hmin: float | None = ...,
    hmax: float | None = ...,
    crease_angle: float = ...,
    tolerance: float | None = ...,
    sources: Any = ...,
    h0: npt.ArrayLike | Implicit | None = ...,
    max_elements: float | None = ...,
    elements: float | None = ...,
    nodes: float | None = ...,
    full_output: Literal[True],
    progress: ProgressCallback | bool | None = ...,
) -> tuple[SizeFunction, SizeReport]: ...
def size_function(
    domain: Domain,
    *,
    background: AnyBackground | Literal["auto"] | None = None,
    box: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    elements_per_radian: float | None = None,
    elements_across: float | None = None,
    elements_between: float | None = None,
    g: float = GRADIENT_LIMIT,
    hmin: float | None = None,
    hmax: float | None = None,
    crease_angle: float = CREASE_ANGLE,
    tolerance: float | None = None,
    sources: Any = (),
    h0: npt.ArrayLike | Implicit | None = None,
    max_elements: float | None = None,
    elements: float | None = None,
    nodes: float | None = None,
    full_output: bool = False,
    progress: ProgressCallback | bool | None = None,
) -> SizeFunction | tuple[SizeFunction, SizeReport]:
    r"""Return the size function of a domain, with gradient limiting.

    As in [1]_, it combines the bounds from the shape of the domain with the bounds that you
    prescribe:

    .. math:: h_0 = \min(h_\text{curvature}, h_\text{feature}, h_\text{external}), \qquad
        |\nabla h| \le g.

    Parameters
    ----------
    domain : SimplexMesh, callable, Image, array, or tuple (CartesianGrid, array)
        One of:

        * a mesh of tetrahedra, or of triangles in the plane;
        * a surface, or a closed polyline in the plane, which stands for the region it encloses;
        * an implicit function f(points[n, dim]) -> [n], negative inside;
        * an image, or an array of labels or booleans;
        * a grid and the signed distance at its nodes, negative inside.
    background : SimplexMesh, CartesianGrid, Octree, "auto" or None
        Carries the sizes.  The default depends on the domain.  For tetrahedra and triangles in
        the plane it is the mesh itself.  For a surface it is a copy, refined where its
        triangles are long.  For a closed polyline it is a grid around the domain, and for an
        image the grid of its pixels.  For a callable it is an octree in ``box``, refined until
        sizes between its nodes are right within 5 %.  For a level set it must be a grid.
    box : tuple (lower, upper), optional
        Corners of a box around the domain, for callables without ``background``.
    elements_per_radian : float, optional
        Elements per radian of curved boundaries, K of `size_from_curvature`.  In a mesh that
        carries its own sizes, also of curved interfaces: between regions (``cell_tags``), and
        tagged facets inside.  The default is 4.  0 disables this bound, but not that of the
        tolerance.
    elements_across : float, optional
        Elements across narrow regions, 2R of `size_from_feature`.  In a mesh that carries its own
        sizes, each region (``cell_tags``) counts separately.  The default is 2.  0 disables the
        width.  On a surface in space, the sizes are reduced to allow for their growth from the
        surface to the middle of the region.
    elements_between : float, optional
        Elements between features of the boundary that are close and do not meet, n of
        `size_from_separation`: short edges, narrow faces, corners opposite a wall.  The default is
        1, or 0 on rough surfaces, where most faces are single triangles.  0 disables the
        separation.  It has no effect on functions, images and level sets, and on surfaces whose
        bodies overlap.  Separations below the tolerance are raised to it.
    g : float, default 0.25
        Gradient limit, >= 0.
    hmin, hmax : float, optional
        Limits of the size, in the unit of the coordinates.  By default 1/1000 and 1/20 of the
        diameter of the smallest ball around the domain, or of the diagonal of its box for
        functions, images and level sets.  For a level set, the default ``hmin`` is at least one
        spacing.  For an image it is at least two.
    crease_angle : float, default 40
        Angle in degrees above which an edge is a feature edge, see `size_from_curvature`.
    tolerance : float, optional
        Allowed distance of the boundary of a mesh of these sizes from that of the domain, over
        the diameter.  Sizes on boundaries and interfaces of radius r are at most
        2 sqrt(tolerance * diameter * r), if the mesh or the surface itself carries the sizes.
        The default is 1e-3, as in `remesh`.  inf disables this bound.
    sources : as in `size_from_sources`
        Prescribed sizes: points, curves, boxes, boundary tags, callables ...
    h0 : array_like of float, SizeFunction or callable, optional
        Further upper bounds: an array with a value per node of the background (of ``domain``,
        if ``background`` is not given), or a function of points.  For a callable domain without
        ``background`` it must be a function.
    max_elements : float, optional
        Limit on the predicted number of elements, by default 300 000.  To stay within it, those
        of ``elements_per_radian``, ``elements_across`` (both down to 1), ``elements_between``,
        ``hmin``, ``hmax`` and ``tolerance`` that are not given are relaxed.  ``report.tolerance``
        is the one that the sizes require at 95 % of the elements at curved boundaries.  inf
        disables the limit.
    elements : float, optional
        Predicted number of elements, instead of ``max_elements``.  The same parameters are
        relaxed or tightened until the prediction is within 2 %, if the given ones allow that.
        `remesh_to_elements` also allows for what the mesh generator makes of it.
    nodes : float, optional
        The same for the predicted number of nodes.  The domain must be a mesh or a surface.
    full_output : bool
        Whether to return a `SizeReport` too.
    progress : callable or bool, optional
        Called with a text and the fraction completed.  True shows a progress bar on a terminal.

    Returns
    -------
    size : SizeFunction
        Defined everywhere.  Outside the domain it continues with the sizes at the boundary.  For
        a surface in space, its background is the refined copy of the surface, and the size
        grows from there by ``g`` per unit length up to ``hmax``.
    report : SizeReport
        Only with ``full_output``: which cause controls which part and how much of it, the
        parameters chosen, and the predicted number of elements.

    Raises
    ------
    ValueError
        If the domain is of another kind, needs a box or a grid, is empty, fills the grid, or
        an option is out of range.

    Warns
    -----
    ResolutionWarning
        If the given parameters require more than ``max_elements`` elements or do not allow
        ``elements`` or ``nodes``, or if the octree of a callable domain would need more leaves
        than allowed for an error of 5 %.
    OutsideWarning
        If a source lies outside the domain, or off the surface that carries the sizes, so that
        sizes there are larger than requested.

    Notes
    -----
    If the background is a mesh of the domain or a grid, sizes do not propagate from one part of
    the domain to another through the outside, and neither do they for a callable domain.  On
    other backgrounds they do.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109, (18)-(19).

    Examples
    --------
    A disc of radius 1, 2 elements per radian:

    >>> def disc(x):
    ...     return np.linalg.norm(x, axis=1) - 1.0
    >>> size, report = size_function(
    ...     disc, box=([-1.1, -1.1], [1.1, 1.1]), elements_per_radian=2, elements_across=0,
    ...     g=0.1, hmax=2.0, full_output=True,
    ... )
    >>> size([[1.0, 0.0], [0.0, 0.0]]).round(2)
    array([0.5, 0.6])
    >>> report
    SizeReport(curvature 100.0%)
    """
    full_output = as_flag("full_output", full_output)
    if isinstance(background, str) and background == "auto":
        background = None
    if background is not None:
        check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    with reporting(progress) as report:
        request = as_request(
            elements_per_radian=elements_per_radian,
            elements_across=elements_across,
            elements_between=elements_between,
            g=g,
            hmin=hmin,
            hmax=hmax,
            crease_angle=crease_angle,
            sources=sources,
            h0=h0,
            max_elements=max_elements,
            elements=elements,
            nodes=nodes,
            report=report,
            tolerance=tolerance,
        )
        domain_ = _as_domain(domain, background, box, report)
        size, found = within_budget(domain_, request)
    return (size, found) if full_output else size


def _as_domain(
    domain: Domain, background: AnyBackground | None, box: Any, report: ProgressCallback
) -> SizedDomain:
    """Return the domain as one of the supported kinds."""
    if isinstance(domain, SimplexMesh):
        return mesh_domain(domain, background)
    if callable(domain):
        return _implicit_domain(domain, background, box, report)
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
    mask = mask_of(as_image(domain))
    return mask_domain(mask, distance_to_edge(mask, progress=report))


def _implicit_domain(
    function: Implicit, background: AnyBackground | None, box: Any, report: ProgressCallback
) -> SizedDomain:
    """Return the domain where a function is negative."""
    if background is None:
        values_at = checked(function)
        return ImplicitDomain(values_at, octree_around(values_at, *_corners_of(box)))
    if isinstance(background, CartesianGrid):
        return LevelSet(background, signed_distance(background, function, progress=report))
    if isinstance(background, Octree):
        return ImplicitDomain(checked(function), background, is_fixed=True)
    raise ValueError(
        f"background must be a CartesianGrid or an Octree for a function, got {background!r}"
    )


def _corners_of(
    box: tuple[npt.ArrayLike, npt.ArrayLike] | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the checked corners of a box."""
    if box is None:
        raise ValueError(
            "box must be given with a callable domain: (lower, upper), or a background"
        )
    if not isinstance(box, tuple | list) or len(box) != 2:
        raise ValueError(f"box must be a pair (lower, upper), got {describe(box)}")
    ends = [as_float_array(f"box[{number}]", end) for number, end in enumerate(box)]
    if ends[0].shape != ends[1].shape:
        raise ValueError(f"box must be a pair of points, got shapes {[e.shape for e in ends]}")
    lower, upper = as_points("box", np.stack(ends))
    if len(lower) not in (2, 3) or not (upper > lower).all():
        raise ValueError(
            f"box must be (lower, upper) in 2-D or 3-D, lower < upper, got {describe(box)}"
        )
    return lower, upper
