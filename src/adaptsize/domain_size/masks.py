"""Objects in images: their masks, filtered, and the distance to their boundary."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array, describe, refuse_where, warn_caller
from adaptsize.background import CartesianGrid
from adaptsize.background.grid import span_of
from adaptsize.background.image import Image
from adaptsize.errors import InputWarning
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.options import ImageOptions
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

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
