"""The size function of an image: bounds from the interfaces of its labels, and from their width."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._causes import CURVATURE, SIZE_OF, WIDTH, Cause
from adaptsize._checks import as_plain_array, refusal
from adaptsize._progress import silent
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.grid import span_of
from adaptsize.background.image import Image
from adaptsize.domain_size.bounds import Bounds
from adaptsize.domain_size.by_domain import diameter_of, limited_on_grid
from adaptsize.domain_size.labels import LabelFields, NearestOnGrid
from adaptsize.domain_size.masks import MARGIN, Mask, lost_pixels, mask_of, report_lost
from adaptsize.domain_size.request import Request
from adaptsize.errors import OptionError
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.limiting import FastMarching
from adaptsize.options.sizes import ImageOptions
from adaptsize.sizes import BoundarySource, RegionSource, size_from_curvature, size_from_feature
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

#: Standard deviation of the filter of labels by default, in pixels.
SMOOTHING = 2.0
#: Labels are filtered again without the parts that are lost, at most so often.
_FILTERED = 5
#: Rounds of averaging of the distance for curvatures.  For a disc of radius 40 pixels with a
#: boundary ragged by half a pixel, the smallest radius found is 8 after 2 rounds and 20 after 24.
#: The ends of bars of radius 3 and 6 keep their radius.
_ROUNDS = 24
#: The filters leave no corners sharper than this, but where three labels meet; degrees.
_CREASE_ANGLE = 120.0
#: Interfaces have no curvature this near to a third label, in pixels: the averaging above carries
#: kinks at the lines where three labels meet so far.  The width bounds shells thinner than that.
_BESIDE = 5.0


class _OfLabel(NamedTuple):
    """A label in the part of the grid around it."""

    part: tuple[slice, ...]
    grid: CartesianGrid
    phi: FloatArray
    """Signed distance to the boundary of the label, negative inside."""
    width: FloatArray
    """inf outside."""


@dataclass(eq=False)
class ImageDomain:
    """The objects in an image.  The interfaces between labels bound the sizes like the boundary.

    The smallest size by default is two pixels: smaller details may not belong to the object.
    Gradient limiting propagates the smallest sizes, so ripples of the boundary must be removed.
    """

    mask: Mask
    """Without the parts that the filter removes."""
    fields: LabelFields
    nearest: NearestOnGrid
    _labels: list[_OfLabel] | None = None
    """Found once: they do not depend on the request."""

    @classmethod
    def of(
        cls, image: Image | npt.ArrayLike, options: ImageOptions, report: ProgressCallback = silent
    ) -> ImageDomain:
        """Return the domain of an image, with checks of its labels."""
        mask = mask_of(image, options)
        report("filtering labels", None)
        smoothing = SMOOTHING if options["smoothing"] is None else options["smoothing"]
        given = mask.labels
        # What is left of thin parts would have fields near zero, that is, ragged boundaries.
        for _ in range(_FILTERED):
            found = cls._filtered(mask, smoothing)
            lost = lost_pixels(mask, found.smooth, found.nearest.gap)
            if not lost.any():
                break
            second = found.names[found.nearest.second]
            other = np.where(found.smooth == mask.labels, second, found.smooth)
            mask = replace(mask, labels=np.where(lost, other, mask.labels))
        report_lost(found.mask.in_image, given, mask.labels)
        return found

    @classmethod
    def _filtered(cls, mask: Mask, smoothing: float) -> ImageDomain:
        fields = LabelFields.of(mask, smoothing)
        return cls(mask, fields, fields.on_grid())

    @cached_property
    def smooth(self) -> npt.NDArray[Any]:
        """The filtered labels, of the grid's shape."""
        return np.asarray(self.names[self.nearest.first])

    @property
    def names(self) -> npt.NDArray[Any]:
        """The labels by number."""
        return np.array(self.fields.names, self.mask.labels.dtype)

    def size_for(self, request: Request) -> SizeFunction:
        """Return the limited sizes, with a report on which cause controls them where."""
        grid, options = self.mask.grid, request.options
        is_inside = self.smooth != 0
        of_labels = self._sizes_of(options["size_of"] or {})  # refused, if at all, before the rest
        sources = [self._source(source) for source in request.sources]
        bounds = self._bounds(request)
        least = 2.0 * float(grid.spacing.max())
        limits = request.limits(diameter_of(grid, is_inside), least)
        if options["hmin"] is None and limits[0] < least:  # prescribed sizes do not lower others
            bounds = {cause: np.maximum(bound, least) for cause, bound in bounds.items()}
        if options["size_of"]:
            for bound in bounds.values():
                bound[np.isfinite(of_labels)] = np.inf
            bounds[SIZE_OF] = of_labels
        fixed = replace(request, options={**options, "size_of": None}, sources=sources)
        # In space, bounds in an image are less accurate than fast marching, and the exact method
        # takes longer than all other steps together.
        scheme = FastMarching(order=2) if grid.dim == 3 else None
        outer = self.distance_to_outside()
        return limited_on_grid(
            outer, Bounds(grid, bounds, limits), fixed, counted=self.mask.in_image, scheme=scheme
        )

    def distance_to_outside(self) -> FloatArray:
        """Return the distance to the boundary of all objects, negative inside."""
        outside = self.fields.outside
        if outside < 0:
            return np.full(self.mask.grid.shape, -self.mask.grid.diagonal)
        return -self.fields.pixel * self.fields.distance_to(outside, self.nearest)

    def _bounds(self, request: Request) -> dict[Cause, FloatArray]:
        """Return the bounds from the shapes of the labels."""
        bounds: dict[Cause, FloatArray] = {}
        shape = self.mask.grid.shape
        if request.per_radian > 0.0:
            curvature = bounds[CURVATURE] = np.full(shape, np.inf)
            smooth = self.nearest.third > _BESIDE
            for part, grid, phi, _ in self._each(request.progress):
                found = size_from_curvature(
                    grid,
                    phi,
                    elements_per_radian=request.per_radian,
                    crease_angle=_CREASE_ANGLE,
                    smoothing=_ROUNDS,
                    g=request.g,
                )
                lower = smooth[part] & (found < curvature[part])
                curvature[part] = np.where(lower, found, curvature[part])
        if request.across > 0.0:
            width = bounds[WIDTH] = np.full(shape, np.inf)
            for part, _, _, own in self._each(request.progress):
                width[part] = np.minimum(width[part], own / request.across)
        return bounds

    def _each(self, report: ProgressCallback) -> list[_OfLabel]:
        """Return the labels of the objects."""
        if self._labels is None:
            numbers = [k for k, name in enumerate(self.fields.names) if name != 0]
            found = [self._of_label(k, report) for k in numbers]
            self._labels = [own for own in found if own is not None]
        return self._labels

    def _of_label(self, k: int, report: ProgressCallback) -> _OfLabel | None:
        own = self.nearest.first == k
        if not own.any():  # removed by the filter
            return None
        around = span_of(own)
        low = np.maximum(around[:, 0] - MARGIN, 0)
        high = np.minimum(around[:, 1] + MARGIN + 1, own.shape)
        part = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        whole = self.mask.grid
        grid = CartesianGrid(whole.origin + whole.spacing * low, whole.spacing, own[part].shape)
        phi = signed_distance(grid, own[part], progress=report)
        width = size_from_feature(grid, phi, elements_across=1.0, progress=report)
        return _OfLabel(part, grid, phi, np.where(own[part], width, np.inf))

    def _sizes_of(self, size_of: Mapping[str, float]) -> FloatArray:
        """Return the prescribed sizes of labels at the nodes, inf where there are none."""
        sizes = np.full(self.mask.grid.shape, np.inf)
        for name, size in size_of.items():
            sizes[self._are_of("size_of", [name.removeprefix("region ")])] = size
        return sizes

    def _source(self, source: Any) -> Any:
        """Return a source by label as one that sets nodes; others as they are."""
        if isinstance(source, RegionSource):
            return _AtNodes(self._are_of("tags", source.tags), source.size)
        if isinstance(source, BoundarySource):
            tags = source.tags
            own = self.smooth != 0 if tags is None else self._are_of("tags", tags)
            own = own & self.mask.in_image
            return _AtNodes(own & _beside(~own), source.size)
        return source

    def _are_of(self, what: str, labels: Any) -> BoolArray:
        """Return which nodes belong to some labels.  Refuse labels that do not occur."""
        present = {str(name): name for name in self.fields.names if name != 0}
        wanted = [str(label) for label in np.atleast_1d(as_plain_array(what, labels)).tolist()]
        for label in wanted:
            if label not in present:
                known = ", ".join(present)
                text = f"must be labels of the image, {known}; got {label!r}"
                if what == "tags":  # of a source
                    raise OptionError(f"{what} {text}", ["sources"])
                raise refusal(what, text)
        return np.isin(self.smooth, [present[label] for label in wanted])


def _beside(chosen: BoolArray) -> BoolArray:
    """Return the pixels that touch chosen ones, with these."""
    from scipy import ndimage

    return np.asarray(ndimage.binary_dilation(chosen, np.ones((3,) * chosen.ndim)))


@dataclass(frozen=True, eq=False)
class _AtNodes:
    """A size at some nodes of a grid."""

    nodes: BoolArray
    size: float

    def lower_sizes(self, mesh: SimplexMesh | CartesianGrid, g: float, h0: FloatArray) -> None:
        """Lower ``h0`` (In/Out) at the nodes."""
        h0[self.nodes] = np.minimum(h0[self.nodes], self.size)
