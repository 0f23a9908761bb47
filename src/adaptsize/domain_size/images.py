"""Size functions and meshes of the objects in an image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, overload

import numpy.typing as npt

from adaptsize._checks import as_flag, check_type
from adaptsize._defaults import GRADIENT_LIMIT, MAX_ELEMENTS
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.image import Image
from adaptsize.domain_size.budget import within_budget
from adaptsize.domain_size.by_domain import mask_domain
from adaptsize.domain_size.image_mask import SMOOTHING, as_image, distance_to_edge, mask_of
from adaptsize.domain_size.image_regions import with_regions
from adaptsize.domain_size.report import SizeReport
from adaptsize.domain_size.request import as_request
from adaptsize.remeshing.distmesh.from_distance import mesh_from_distance
from adaptsize.typing import FloatArray, ProgressCallback

_DEFAULTS = (GRADIENT_LIMIT, MAX_ELEMENTS)


@overload
def size_function_from_image(
    image: Image | npt.ArrayLike,
    spacing: npt.ArrayLike | None = ...,
    *,
    label: int | Sequence[int] | None = ...,
    threshold: float | None = ...,
    smoothing: float = ...,
    elements_per_radian: float | None = ...,
    elements_across: float | None = ...,
    g: float = ...,
    hmin: float | None = ...,
    hmax: float | None = ...,
    sources: Any = ...,
    max_elements: float = ...,
    full_output: Literal[False] = ...,
    progress: ProgressCallback | bool | None = ...,
) -> SizeFunction: ...
@overload
def size_function_from_image(
    image: Image | npt.ArrayLike,
    spacing: npt.ArrayLike | None = ...,
    *,
    label: int | Sequence[int] | None = ...,
    threshold: float | None = ...,
    smoothing: float = ...,
    elements_per_radian: float | None = ...,
    elements_across: float | None = ...,
    g: float = ...,
    hmin: float | None = ...,
    hmax: float | None = ...,
    sources: Any = ...,
    max_elements: float = ...,
    full_output: Literal[True],
    progress: ProgressCallback | bool | None = ...,
) -> tuple[SizeFunction, SizeReport]: ...
def size_function_from_image(
    image: Image | npt.ArrayLike,
    spacing: npt.ArrayLike | None = None,
    *,
    label: int | Sequence[int] | None = None,
    threshold: float | None = None,
    smoothing: float = SMOOTHING,
    elements_per_radian: float | None = None,
    elements_across: float | None = None,
    g: float = GRADIENT_LIMIT,
    hmin: float | None = None,
    hmax: float | None = None,
    sources: Any = (),
    max_elements: float = MAX_ELEMENTS,
    full_output: bool = False,
    progress: ProgressCallback | bool | None = None,
) -> SizeFunction | tuple[SizeFunction, SizeReport]:
    """Return the size function of the objects in an image.

    As in [1]_, the mask is smoothed, and its signed distance is computed.  The distance gives the
    curvature of the boundary and the local feature size.  The smaller of the two sizes is limited
    on the grid of the pixels: exactly in 2-D, and by fast marching of second order in 3-D.

    Parameters
    ----------
    image : Image or array_like, 2-D or 3-D
        A mask or labels, axis 0 along x, as returned by `read_image`.
    spacing : float or array_like of float, shape (dim,), optional
        Size of a pixel, 1e-50 to 1e50.  By default that of an Image, and 1 for arrays.
    label : int or sequence of int, optional
        The labels that belong to the objects.  By default all but 0.
    threshold : float, optional
        Alternative to ``label``: pixels with larger values belong to the objects.
    smoothing : float, default 2
        Standard deviation of the low-pass filter in pixels, >= 0.  A value of 2 removes ripples
        of the boundary, lines of up to 2 pixels, and specks of up to 3 x 3 pixels.
    elements_per_radian, elements_across, g, sources, max_elements, full_output, progress
        As in `size_function`.
    hmin, hmax : float, optional
        Limits of the size.  By default, ``hmin`` is two pixels, or 1/1000 of the diagonal of the
        objects if that is larger, and ``hmax`` is 1/20 of the diagonal.

    Returns
    -------
    size : SizeFunction
        On a grid of the pixels around the objects.  Outside the objects it continues with the
        sizes at their boundary.
    report : SizeReport
        Only with ``full_output``.

    Raises
    ------
    ValueError
        If no pixel belongs to the objects, or all do, the objects are too small, a value is NaN,
        a label does not occur, the image has colours or changes from pixel to pixel like
        a photo, or an option is out of range.

    Warns
    -----
    ImageWarning
        If objects reach the border of the image, or if smoothing removes objects.

    Notes
    -----
    Corners of objects are rounded with a radius of about ``smoothing``.  Objects less than one or
    two pixels apart merge.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109, section 7.2.

    Examples
    --------
    A disc with a radius of 20 pixels of size 0.1, three elements per radian:

    >>> import numpy as np
    >>> x, y = np.mgrid[-30:31, -30:31]
    >>> size = size_function_from_image(
    ...     np.hypot(x, y) < 20, 0.1, elements_per_radian=3, elements_across=0, hmax=1
    ... )
    >>> h = size([[5.0, 3.0], [3.0, 5.0]])  # on the edge: 2 / 3, seen through pixels
    >>> bool(np.all((0.6 < h) & (h < 0.75)))
    True
    """
    full_output = as_flag("full_output", full_output)
    with reporting(progress) as report:
        mask = mask_of(as_image(image, spacing), label=label, threshold=threshold)
        phi = distance_to_edge(mask, smoothing, progress=report)
        request = as_request(
            elements_per_radian=elements_per_radian,
            elements_across=elements_across,
            g=g,
            hmin=hmin,
            hmax=hmax,
            sources=sources,
            max_elements=max_elements,
            report=report,
        )
        size, found = within_budget(mask_domain(mask, phi), request)
    return (size, found) if full_output else size


def mesh_image(
    image: Image | npt.ArrayLike,
    spacing: npt.ArrayLike | None = None,
    *,
    label: int | Sequence[int] | None = None,
    threshold: float | None = None,
    smoothing: float = SMOOTHING,
    size: SizeFunction | None = None,
    elements_per_radian: float | None = None,
    elements_across: float | None = None,
    g: float = GRADIENT_LIMIT,
    hmin: float | None = None,
    hmax: float | None = None,
    sources: Any = (),
    max_elements: float = MAX_ELEMENTS,
    seed: int = 2004,
    progress: ProgressCallback | bool | None = None,
) -> SimplexMesh:
    """Return a mesh of the objects in an image.

    A picture gives triangles, a volume gives tetrahedra.  The sizes come from
    `size_function_from_image`, unless ``size`` is given, and the mesh from `mesh_from_distance`.

    Parameters
    ----------
    image, spacing, label, threshold, smoothing
        As in `size_function_from_image`.
    size : SizeFunction, optional
        Requested sizes, for instance those of `size_function_from_image` that you have inspected.
    elements_per_radian, elements_across, g, hmin, hmax, sources, max_elements
        As in `size_function_from_image`.  Refused with ``size``.
    seed : int
        Seed of the random initial points.
    progress : callable or bool, optional
        Called with a text and the fraction completed.  True shows a progress bar on a terminal.

    Returns
    -------
    SimplexMesh
        The nodal field ``h`` holds the sizes.  If the image has several labels, they are the cell
        tags.  Where objects of two labels touch, nodes are moved onto the interface.  The facets
        of the boundary and of interfaces are tagged, with names such as ``"boundary of 2"``,
        ``"interface of 2 and 5"`` and ``"image border, x low"``, where an object is cut off.

    Raises
    ------
    ValueError
        As in `size_function_from_image`.
    TooManyElementsError
        If the given parameters require more elements than `mesh_from_distance` allows.

    Warns
    -----
    ImageWarning
        If objects reach the border of the image, or if smoothing removes objects.
    ConvergenceWarning, ResolutionWarning
        As in `mesh_from_distance`.

    Examples
    --------
    >>> import numpy as np
    >>> x, y = np.mgrid[-30:31, -30:31]
    >>> mesh = mesh_image(np.hypot(x, y) < 20, 0.1)
    >>> bool(abs(mesh.measures.sum() - 4 * np.pi) < 0.3)
    True
    """
    if size is not None:
        check_type("size", size, SizeFunction)
        given = (elements_per_radian, elements_across, hmin, hmax)
        if any(value is not None for value in given) or (g, max_elements) != _DEFAULTS or sources:
            raise ValueError(
                "size must be given without elements_per_radian, elements_across, g, hmin, hmax, "
                "sources and max_elements, from which sizes are computed"
            )
    with reporting(progress) as report:
        mask = mask_of(as_image(image, spacing), label=label, threshold=threshold)
        phi = distance_to_edge(mask, smoothing, progress=report)
        request = as_request(
            elements_per_radian=elements_per_radian,
            elements_across=elements_across,
            g=g,
            hmin=hmin,
            hmax=hmax,
            sources=sources,
            max_elements=max_elements,
            report=report,
        )
        if size is None:
            size, _ = within_budget(mask_domain(mask, phi), request)
        mesh = mesh_from_distance(
            DistanceOnGrid(mask.grid, phi),
            size,
            mask.grid.lower,
            mask.grid.upper,
            seed=seed,
            progress=report,
        )
        mesh = with_regions(mesh, mask)
    return mesh.with_data(point_data={"h": size(mesh.points)})


class DistanceOnGrid:
    """The interpolant of a nodal distance, as a callable for mesh generators."""

    def __init__(self, grid: CartesianGrid, phi: FloatArray) -> None:
        self._locator, self._phi = grid.locator, phi

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the distance at points.  Outside the grid, the distance to the grid is added."""
        inside, away = self._locator.interpolate(self._phi, points)
        return inside + away
