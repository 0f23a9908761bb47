"""Meshes of the objects in an image, with labels as regions: `mesh_image`."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import check_type
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.image import Image
from adaptsize.background.topology import marked, regions_beside
from adaptsize.domain_size.budget import within_budget
from adaptsize.domain_size.by_domain import LevelSet
from adaptsize.domain_size.masks import Mask, distance_to_edge, mask_of
from adaptsize.domain_size.request import Request
from adaptsize.options import ImageMeshOptions, ImageOptions, checked, options_of, with_options
from adaptsize.quality.elements import radius_ratios
from adaptsize.remeshing.distmesh.from_distance import mesh_from_distance
from adaptsize.typing import FloatArray, IntArray, LongArray, ProgressCallback, Unpack


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

        def distance(points: FloatArray) -> FloatArray:
            inside, away = mask.grid.locator.interpolate(phi, points)
            return inside + away

        mesh = mesh_from_distance(
            distance,
            size,
            mask.grid.lower,
            mask.grid.upper,
            seed=given["seed"],
            progress=report,
        )
        mesh = with_regions(mesh, mask)
    return mesh.with_data(point_data={"h": size(mesh.points)})


# Nodes of an interface move onto it in so many steps.
_STEPS = 4


class Labels:
    """Smoothed labels of an image, extended beyond the objects by the nearest label.

    Parameters
    ----------
    mask : Mask
        With ``labels``.
    """

    def __init__(self, mask: Mask) -> None:
        from scipy import ndimage

        assert mask.labels is not None
        self.grid: CartesianGrid = mask.grid.with_active(None)
        nearest = ndimage.distance_transform_edt(
            mask.labels == 0,
            sampling=mask.grid.spacing,
            return_distances=False,
            return_indices=True,
        )
        extended = mask.labels[tuple(nearest)]
        self.names = [int(name) for name in np.unique(extended)]
        # With a deviation of one pixel, labels that touch have no steps between them.
        self._fields = {
            name: ndimage.gaussian_filter((extended == name).astype(np.float64), 1.0)
            for name in self.names
        }

    def share(self, name: int, points: FloatArray) -> FloatArray:
        """Return the smoothed indicator of a label at points, between 0 and 1."""
        return self.grid.locator.interpolate(self._fields[name], points)[0]

    def at(self, points: FloatArray) -> IntArray:
        """Return the label with the largest share at each point."""
        shares = np.stack([self.share(name, points) for name in self.names])
        found: IntArray = np.array(self.names, np.int32)[shares.argmax(axis=0)]
        return found

    def step_to_interface(self, a: int, b: int, points: FloatArray) -> FloatArray:
        """Return Newton's step from points to the interface between two labels."""
        eps = 0.5 * self.grid.spacing  # half a pixel
        value = self.share(a, points) - self.share(b, points)
        slope = np.empty_like(points)
        for d in range(points.shape[1]):
            move = np.zeros(points.shape[1])
            move[d] = eps[d]
            ahead, behind = points + move, points - move
            rise = self.share(a, ahead) - self.share(b, ahead)
            rise -= self.share(a, behind) - self.share(b, behind)
            slope[:, d] = rise / (2.0 * eps[d])
        square = (slope**2).sum(axis=1)
        # Where the image says nothing, nodes stay.
        known = square > (0.05 / self.grid.spacing.max()) ** 2
        return np.where(known, -value / np.where(known, square, 1.0), 0.0)[:, None] * slope


def with_regions(mesh: SimplexMesh, mask: Mask) -> SimplexMesh:
    """Return a mesh with the labels as regions, smooth interfaces, and tagged facets."""
    if mask.labels is not None:
        labels = Labels(mask)
        tags = labels.at(mesh.points[mesh.cells].mean(axis=1))
        mesh = SimplexMesh(mesh.points, mesh.cells, cell_tags=tags)
        mesh = _with_smooth_interfaces(mesh, labels)
    return _with_tagged_facets(mesh, mask)


def _with_smooth_interfaces(mesh: SimplexMesh, labels: Labels) -> SimplexMesh:
    """Return the mesh with the nodes between two regions moved onto their interface."""
    assert mesh.cell_tags is not None
    n = mesh.n_points
    on_skin = marked(mesh.boundary().nodes, n)
    touches = {name: marked(mesh.cells[mesh.cell_tags == name], n) for name in labels.names}
    several = sum(mask.astype(int) for mask in touches.values()) > 2
    reach = np.full(n, np.inf)
    np.minimum.at(reach, mesh.edges, mesh.edge_lengths[:, None])
    points = mesh.points.copy()
    ratios = radius_ratios(mesh)
    for _ in range(_STEPS):
        moved = points.copy()
        for a, b in combinations(labels.names, 2):
            nodes = np.flatnonzero(touches[a] & touches[b] & ~several & ~on_skin)
            step = labels.step_to_interface(a, b, points[nodes])
            length = np.linalg.norm(step, axis=1)
            most = 0.25 * reach[nodes]  # of the shortest edge at the node
            moved[nodes] += step * np.minimum(1.0, most / np.maximum(length, 1e-300))[:, None]
        points = _without_bad_cells(mesh, points, moved, ratios)
    return SimplexMesh(points, mesh.cells, cell_tags=mesh.cell_tags)


def _without_bad_cells(
    mesh: SimplexMesh, before: FloatArray, after: FloatArray, ratios: FloatArray
) -> FloatArray:
    """Return the moved nodes; those of cells that would become bad stay where they were."""
    after = after.copy()
    while True:
        tried = SimplexMesh(after, mesh.cells)
        now = np.where(tried.signed_measures > 0.0, radius_ratios(tried), -1.0)
        # Moves may not make a cell worse than this radius ratio and than it was.
        bad = (now < 0.2) & (now < ratios)
        back = np.unique(mesh.cells[bad])
        back = back[(after[back] != before[back]).any(axis=1)]
        if len(back) == 0:
            return after
        after[back] = before[back]


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
    # The border of an object that leaves the image lies half a pixel beyond the last centre.
    found = np.full(len(corners), -1, np.int64)
    for d in range(corners.shape[2]):
        for side, plane in enumerate((mask.lower[d], mask.upper[d])):
            near = np.abs(corners[:, :, d] - plane).max(axis=1) < 0.75 * mask.grid.spacing[d]
            found[near & (found < 0)] = 2 * d + side
    return found


def _name(region: int, other: int, border: int) -> str:
    if border >= 0:
        return f"image border, {'xyz'[border // 2]} {('low', 'high')[border % 2]}"
    if other >= 0:
        return f"interface of {region} and {other}"
    return f"boundary of {region}" if region > 0 else "boundary"
