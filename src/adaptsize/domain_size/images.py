"""Meshes of the objects in an image, with labels as regions: `mesh_image`."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import check_type
from adaptsize._defaults import REFUSED_ABOVE
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.image import Image
from adaptsize.background.topology import regions_beside
from adaptsize.domain_size.budget import within_budget
from adaptsize.domain_size.masks import Mask
from adaptsize.domain_size.of_image import ImageDomain
from adaptsize.domain_size.request import Request
from adaptsize.options import (
    DistanceOptions,
    ImageMeshOptions,
    SizeFunctionOptions,
    checked,
    options_of,
    with_options,
)
from adaptsize.options.sizes import ImageOptions
from adaptsize.remeshing.distmesh.from_distance import mesh_of_domain
from adaptsize.remeshing.distmesh.labelled import LabelledDomain, distance_to_outside
from adaptsize.remeshing.distmesh.report import warn_of_faults
from adaptsize.sizes.sources import SourcesLike
from adaptsize.typing import FloatArray, LongArray, ProgressCallback, Unpack


@recorded("mesh_image")
@with_options(ImageMeshOptions)
def mesh_image(
    image: Image | npt.ArrayLike,
    size: SizeFunction | None = None,
    *,
    sources: SourcesLike | None = (),
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
        As in `size_function` and `mesh_from_distance`.

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
        domain = ImageDomain.of(image, given, report)
        mask, defaults = domain.mask, checked(DistanceOptions, {})
        if size is None:
            options_of_sizes = {**checked(SizeFunctionOptions, {}), **given}
            request = Request.of(cast(SizeFunctionOptions, options_of_sizes), sources, None, report)
            size = within_budget(domain, request)
        labelled = _labelled(domain, size)
        mesh, made = mesh_of_domain(
            labelled,
            labelled.corners(),
            seed=given["seed"],
            max_iter=defaults["max_iter"],
            max_elements=max(given["max_elements"] or 0.0, REFUSED_ABOVE),
            report=report,
        )
        mesh = _with_tagged_facets(_with_labels(mesh, domain), mask)
    warn_of_faults(replace(made, domain_measure=sum(mask.measures().values())))
    return mesh.with_data(point_data={"h": size(mesh.points)})


def _labelled(domain: ImageDomain, size: SizeFunction) -> LabelledDomain:
    """Return the domain for the mesh generator, with the measures of the labels."""
    mask, fields = domain.mask, domain.fields
    return LabelledDomain(
        distance_to_outside(fields),
        size,
        np.maximum(mask.lower, mask.grid.lower),
        np.minimum(mask.upper, mask.grid.upper),
        fields=fields,
        measures=mask.measures(),
    )


def _with_labels(mesh: SimplexMesh, domain: ImageDomain) -> SimplexMesh:
    """Return a mesh with the labels of the regions instead of their numbers."""
    if mesh.cell_tags is None or not domain.mask.has_labels:
        return SimplexMesh(mesh.points, mesh.cells)
    tags = np.array(domain.fields.names, np.int32)[mesh.cell_tags]
    return SimplexMesh(mesh.points, mesh.cells, cell_tags=tags)


def _with_tagged_facets(mesh: SimplexMesh, mask: Mask) -> SimplexMesh:
    """Tag the skin of each region, the interfaces, and where objects leave the image."""
    regions = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
    low, high = regions_beside(mesh.cell_facets, regions, len(mesh.facets))
    is_outer = mesh.facet_cell_counts == 1
    kept = is_outer | (low != high)
    facets = mesh.facets[kept]
    # The second region is -1 at the boundary, and otherwise the larger one.
    sides = np.column_stack([low, np.where(is_outer, -1, high)])[kept].astype(np.int32)
    border = _borders(mesh.points[facets], mask)
    border[(sides[:, 1] >= 0)] = -1
    keys = np.column_stack([np.where(border[:, None] >= 0, -1, sides), border])
    kinds, tags = np.unique(keys, axis=0, return_inverse=True)
    dim = mesh.cell_dim - 1
    names = {(dim, k + 1): _name(*map(int, kind)) for k, kind in enumerate(kinds)}
    return SimplexMesh(
        mesh.points,
        mesh.cells,
        cell_tags=mesh.cell_tags,
        tagged_facets=facets,
        facet_tags=(tags.reshape(-1) + 1).astype(np.int32),
        tag_names=names,
    )


def _borders(corners: FloatArray, mask: Mask) -> LongArray:
    """Return for each facet the border of the image on which it lies, 2 d + side, or -1."""
    found = np.full(len(corners), -1, np.int64)
    for d in range(corners.shape[2]):
        for side, plane in enumerate((mask.lower[d], mask.upper[d])):
            near = np.abs(corners[:, :, d] - plane).max(axis=1) < 1e-6 * mask.grid.spacing[d]
            found[near & (found < 0)] = 2 * d + side
    return found


def _name(region: int, other: int, border: int) -> str:
    if border >= 0:
        return f"image border, {'xyz'[border // 2]} {('low', 'high')[border % 2]}"
    if other >= 0:
        return f"interface of {region} and {other}"
    return f"boundary of {region}" if region > 0 else "boundary"
