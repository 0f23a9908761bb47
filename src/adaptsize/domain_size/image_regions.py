"""Objects in images: their filtered masks, and the regions of meshes of labelled images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array, describe, refuse_where, warn_caller
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.grid import span_of
from adaptsize.background.image import Image
from adaptsize.background.topology import regions_beside
from adaptsize.errors import InputWarning
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.options import ImageOptions
from adaptsize.quality.elements import radius_ratios
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray, ProgressCallback

#: Margin around the objects in pixels, for finite differences and kinks of the distance.
_MARGIN = 6


@dataclass(frozen=True, eq=False, repr=False)
class Mask:
    """The pixels that belong to objects, on a grid cropped to them with a margin."""

    grid: CartesianGrid
    """Nodes are the centres of the pixels.  Extends beyond the image if objects reach its border.
    """
    inside: BoolArray
    """Of the grid's shape."""
    labels: npt.NDArray[Any] | None
    """Of the grid's shape, 0 outside; None if the image has only inside and outside."""
    lower: FloatArray
    """Lowest coordinates of the pixels of the image, float64[dim]."""
    upper: FloatArray
    """Highest coordinates of the pixels of the image, float64[dim]."""


def as_image(image: Image | npt.ArrayLike, spacing: npt.ArrayLike | None) -> Image:
    """Return an array as an Image, or an Image with another spacing."""
    if isinstance(image, Image):
        made = image if spacing is None else Image(image.values, spacing, image.origin)
    else:
        values = as_plain_array("image", image)
        if values.ndim == 3 and values.shape[2] in (3, 4) and min(values.shape[:2]) > 16:
            raise ValueError(
                f"image must have one number per pixel, got an array of shape {values.shape}, "
                "which looks like colours: segment it first (pass a volume of so few planes as a "
                "background.Image)"
            )
        try:
            made = Image(values, 1.0 if spacing is None else spacing)
        except ValueError as error:
            raise ValueError(str(error).replace("values must", "image must", 1)) from error
    # Gradient limiting accepts coordinates up to 1e60; an image has below 1e10 pixels per axis.
    far = (made.spacing < 1e-50) | (made.spacing > 1e50)
    wanted = "must be from 1e-50 to 1e+50: choose another unit of length"
    refuse_where("spacing", far, made.spacing, wanted)
    return made


def mask_of(image: Image | npt.ArrayLike, options: ImageOptions) -> Mask:
    """Return the objects in an image.

    Raises
    ------
    ValueError
        If no pixel belongs to the objects, or all do, values are NaN, a label does not occur, or
        neither ``label`` nor ``threshold`` is given for a photo or an image of floats.

    Warns
    -----
    InputWarning
        If objects reach the border of the image.
    """
    image = as_image(image, options["spacing"])
    label, threshold, values = options["label"], options["threshold"], image.values
    if values.dtype.kind == "f":
        refuse_where("image", np.isnan(values), values, "must hold no NaN")
    if label is not None and threshold is not None:
        given = f"{describe(label)} and {describe(threshold)}"
        raise ValueError(f"label or threshold must be given, got both: {given}")
    if threshold is not None:
        return _cut(image, values > threshold, f"above {threshold:g}", None)
    if values.dtype.kind == "f":
        raise ValueError(
            f"image must hold labels (bool or integers), got {values.dtype} from "
            f"{values.min():g} to {values.max():g}; pass threshold="
        )
    if label is not None:
        return _cut(image, _is_labelled(values, label), f"of label {label}", values)
    _refuse_photo(values)
    inside = values != 0
    several = values.dtype.kind != "b" and values[inside].size > 0 and np.ptp(values[inside]) > 0
    return _cut(image, inside, "that is not 0", values if several else None)


def _is_labelled(values: npt.NDArray[Any], label: int | Sequence[int]) -> BoolArray:
    wanted = np.atleast_1d(np.asarray(label))
    if wanted.dtype.kind not in "iu" or wanted.ndim != 1 or wanted.size == 0:
        raise ValueError(f"label must be an integer or several, got {describe(label)}")
    present = np.unique(values)
    missing = wanted[~np.isin(wanted, present)]
    if missing.size:
        listed = ", ".join(str(int(k)) for k in present[:12])
        more = ", ..." if present.size > 12 else ""
        raise ValueError(f"label must be one of {listed}{more}, got {int(missing[0])}")
    return np.isin(values, wanted)


def _refuse_photo(values: npt.NDArray[Any]) -> None:
    """Refuse values that change from pixel to pixel, as in a photo: at more than a quarter."""
    if values.dtype.kind == "b":
        return
    before, after = values[:-1], values[1:]
    both = (before != 0) & (after != 0)
    n_changes = int(np.count_nonzero(both & (before != after)))
    share = n_changes / max(1, int(np.count_nonzero(both)))
    n_values = np.unique(values).size
    if share > 0.25 and n_values > 2:
        raise ValueError(
            f"image must be a mask or hold labels, got {n_values} different values that change "
            "from pixel to pixel, as in a photo: segment it first, or pass threshold= or label="
        )


def _cut(image: Image, inside: BoolArray, what: str, labels: npt.NDArray[Any] | None) -> Mask:
    """Return the part of an image that contains objects, with a margin."""
    if not inside.any():
        raise ValueError(f"image must have a pixel {what}, got none in {image!r}")
    if inside.all():
        raise ValueError(
            f"image must have pixels outside the objects, got none: all of {image!r} {what}; "
            "is it inverted?"
        )
    first, last = span_of(inside).T + np.array([[0], [1]])
    n_at_border = sum(
        int(np.count_nonzero(np.take(inside, end, axis=d)))
        for d in range(image.dim)
        for end in (0, -1)
    )
    if n_at_border:
        warn_caller(
            f"objects reach the border of the image at {n_at_border} pixels and are cut off there",
            InputWarning,
        )
    part = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    padded = np.pad(inside[part], _MARGIN)
    grid = CartesianGrid(
        image.origin + image.spacing * (first - _MARGIN), image.spacing, padded.shape
    )
    if labels is not None:
        labels = np.pad(np.where(inside, labels, 0)[part], _MARGIN)
    lower = image.origin - 0.5 * image.spacing
    return Mask(grid, padded, labels, lower, lower + image.spacing * inside.shape)


def distance_to_edge(
    mask: Mask, smoothing: float | None = None, *, progress: ProgressCallback | None = None
) -> FloatArray:
    """Return the signed distance to the smoothed boundary of the objects, negative inside.

    ``smoothing`` is the standard deviation in pixels of the low-pass filter that is applied to the
    mask before, by default 2.

    Raises
    ------
    ValueError
        If smoothing removes all objects.

    Warns
    -----
    InputWarning
        If smoothing removes some objects.
    """
    kept = _low_pass(mask.inside, 2.0 if smoothing is None else smoothing)
    _report_lost_objects(mask.inside, kept)
    phi = signed_distance(mask.grid, kept, progress=progress)
    # Objects less deep than that are too thin for a useful distance function.
    if -float(phi.min()) < 0.9 * float(mask.grid.spacing.min()):
        raise ValueError(
            "image must show objects at least 4 pixels across, got only thinner ones: "
            f"{int(np.count_nonzero(kept))} pixels after smoothing"
        )
    return phi


def _low_pass(inside: BoolArray, deviation: float) -> BoolArray:
    """Return the pixels that are inside after a filter that preserves curved boundaries.

    The distance to the boundary, in pixels, is filtered by ``2 G - G G`` with a Gaussian G.  The
    second moments of this filter are zero.  A Gaussian alone moves round boundaries inwards.
    """
    from scipy import ndimage

    if deviation == 0.0:
        return inside
    to_edge = ndimage.distance_transform_edt(~inside) - ndimage.distance_transform_edt(inside)
    level = to_edge - np.copysign(0.5, to_edge)
    once = ndimage.gaussian_filter(level, deviation)
    return np.asarray(2.0 * once < ndimage.gaussian_filter(once, deviation))


def _report_lost_objects(before: BoolArray, after: BoolArray) -> None:
    from scipy import ndimage

    objects, count = ndimage.label(before, structure=np.ones((3,) * before.ndim))
    sizes = np.bincount(objects.ravel(), minlength=count + 1)
    left = np.bincount(objects[after], minlength=count + 1)
    lost = sizes[1:][left[1:] == 0]
    if lost.size == count:
        what = f"{count} objects" if count > 1 else "one object"
        raise ValueError(
            f"image must show objects at least 4 pixels across, got {what} of at most "
            f"{lost.max()} pixels, which smoothing removes"
        )
    if lost.size:
        warn_caller(
            f"smoothing removes {lost.size} of {count} objects, the largest of {lost.max()} pixels",
            InputWarning,
        )


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
    on_skin = np.zeros(mesh.n_points, np.bool_)
    on_skin[mesh.boundary().nodes] = True
    touches = {name: _nodes_of(mesh, mesh.cell_tags == name) for name in labels.names}
    several = sum(mask.astype(int) for mask in touches.values()) > 2
    reach = np.full(mesh.n_points, np.inf)
    for end in (0, 1):
        np.minimum.at(reach, mesh.edges[:, end], mesh.edge_lengths)
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


def _nodes_of(mesh: SimplexMesh, cells: BoolArray) -> BoolArray:
    marked = np.zeros(mesh.n_points, np.bool_)
    marked[mesh.cells[cells]] = True
    return marked


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
    facets, sides = _facets_between(mesh, regions)
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


def _facets_between(mesh: SimplexMesh, regions: IntArray) -> tuple[IntArray, IntArray]:
    """Return the facets of the boundary and of interfaces, and the regions beside each.

    The second region is -1 at the boundary, and otherwise the larger one.
    """
    low, high = regions_beside(mesh.cell_facets, regions, len(mesh.facets))
    is_outer = mesh.facet_cell_counts == 1
    kept = is_outer | (low != high)
    sides = np.column_stack([low, np.where(is_outer, -1, high)])[kept].astype(np.int32)
    return mesh.facets[kept], sides


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
