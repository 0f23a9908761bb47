"""Meshes of the objects in an image."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from adaptsize._checks import check_type
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.image import Image
from adaptsize.domain_size.budget import within_budget
from adaptsize.domain_size.by_domain import LevelSet
from adaptsize.domain_size.image_regions import distance_to_edge, mask_of, with_regions
from adaptsize.domain_size.request import Request
from adaptsize.options import ImageMeshOptions, ImageOptions, checked, options_of, with_options
from adaptsize.remeshing.distmesh.from_distance import mesh_from_distance
from adaptsize.typing import FloatArray, ProgressCallback, Unpack


@with_options(ImageMeshOptions)
def mesh_image(
    image: Image | npt.ArrayLike,
    size: SizeFunction | None = None,
    *,
    sources: Any = (),
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[ImageMeshOptions],
) -> SimplexMesh:
    """Return a mesh of the objects in an image.

    A picture gives triangles, a volume gives tetrahedra.  The sizes come from `size_function`,
    unless ``size`` is given, and the mesh from `mesh_from_distance`.

    Parameters
    ----------
    image : Image or array_like, 2-D or 3-D
        A mask or labels, axis 0 along x, as returned by `read_image`.
    size : SizeFunction, optional
        Requested sizes, for instance those of `size_function` that you have inspected.
    sources : as in `size_from_sources`
        Prescribed sizes.
    progress : callable or bool, optional
        Called with a text and the fraction completed.  True shows a progress bar on a terminal.
    **options
        Those of the sizes are refused with ``size``.

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
        As in `size_function`.
    TooManyElementsError
        If the given parameters require more elements than `mesh_from_distance` allows.

    Warns
    -----
    InputWarning
        If objects reach the border of the image, or if smoothing removes objects.
    ConvergenceWarning, ResolutionWarning
        As in `mesh_from_distance`.

    Examples
    --------
    >>> import numpy as np
    >>> x, y = np.mgrid[-30:31, -30:31]
    >>> mesh = mesh_image(np.hypot(x, y) < 20, spacing=0.1)
    >>> bool(abs(mesh.measures.sum() - 4 * np.pi) < 0.3)
    True
    """
    given = checked(ImageMeshOptions, options)
    if size is not None:
        check_type("size", size, SizeFunction)
        idle = [name for name in options if name not in (*options_of(ImageOptions), "seed")]
        if idle or sources:
            listed = ", ".join([*idle, *(["sources"] if sources else [])])
            raise ValueError(f"size must be given without {listed}, from which it is computed")
    with reporting(progress) as report:
        mask = mask_of(image, given)
        phi = distance_to_edge(mask, given["smoothing"], progress=report)
        if size is None:
            request = Request.of(given, sources, report=report)
            size = within_budget(LevelSet(mask.grid, phi, is_image=True), request)
        mesh = mesh_from_distance(
            DistanceOnGrid(mask.grid, phi),
            size,
            mask.grid.lower,
            mask.grid.upper,
            seed=given["seed"],
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
