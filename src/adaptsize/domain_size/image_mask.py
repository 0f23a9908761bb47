"""The objects in an image: which pixels are inside, and the distance to their boundary."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_plain_array, describe, refuse_where
from adaptsize.background import CartesianGrid
from adaptsize.background.image import Image
from adaptsize.errors import ImageWarning
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

#: Margin around the objects in pixels, for finite differences and kinks of the distance.
MARGIN = 6
#: Standard deviation of the low-pass filter, in pixels.
SMOOTHING = 2.0
_SMOOTHEST = 1000.0
# Objects less deep than this, in pixels, are too thin for a useful distance function.
_LEAST_DEPTH = 0.9
# In a mask, neighbouring pixels differ only at boundaries.  A larger share means a photo.
_BUSY = 0.25
_MOST_NAMES = 12
# Gradient limiting accepts coordinates up to 1e60; an image has fewer than 1e10 pixels per axis.
_SPACINGS = (1e-50, 1e50)


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


def as_image(image: Image | npt.ArrayLike, spacing: npt.ArrayLike | None = None) -> Image:
    """Return an array as an Image, or an Image with another spacing."""
    if isinstance(image, Image):
        same = image if spacing is None else Image(image.values, spacing, image.origin)
        return _in_range(same)
    values = as_plain_array("image", image)
    if values.ndim == 3 and values.shape[2] in (3, 4) and min(values.shape[:2]) > 16:
        raise ValueError(
            f"image must have one number per pixel, got an array of shape {values.shape}, which "
            "looks like colours: segment it first (pass a volume of so few planes as a "
            "background.Image)"
        )
    try:
        made = Image(values, 1.0 if spacing is None else spacing)
    except ValueError as error:
        raise ValueError(str(error).replace("values must", "image must", 1)) from error
    return _in_range(made)


def _in_range(image: Image) -> Image:
    """Return the image if squares of its spacing stay in the range of float64."""
    steps = image.spacing
    refuse_where(
        "spacing",
        (steps < _SPACINGS[0]) | (steps > _SPACINGS[1]),
        steps,
        f"must be from {_SPACINGS[0]:g} to {_SPACINGS[1]:g}: choose another unit of length",
    )
    return image


def mask_of(
    image: Image,
    *,
    label: int | Sequence[int] | None = None,
    threshold: float | None = None,
) -> Mask:
    """Return the objects in an image.

    Parameters
    ----------
    image : Image
    label : int or sequence of int, optional
        The labels that belong to the objects.  By default all but 0.
    threshold : float, optional
        Alternative to ``label``: pixels with larger values belong to the objects.

    Returns
    -------
    Mask

    Raises
    ------
    ValueError
        If no pixel belongs to the objects, or all do, values are NaN, a label does not occur, or
        neither ``label`` nor ``threshold`` is given for a photo or an image of floats.

    Warns
    -----
    ImageWarning
        If objects reach the border of the image.
    """
    values = image.values
    if values.dtype.kind == "f":
        refuse_where("image", np.isnan(values), values, "must hold no NaN")
    if label is not None and threshold is not None:
        given = f"{describe(label)} and {describe(threshold)}"
        raise ValueError(f"label or threshold must be given, got both: {given}")
    if threshold is not None:
        limit = as_number("threshold", threshold, lower=-np.inf, within=(0.0, np.inf))
        return _cut(image, values > limit, f"above {limit:g}", None)
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
        listed = ", ".join(str(int(k)) for k in present[:_MOST_NAMES])
        more = ", ..." if present.size > _MOST_NAMES else ""
        raise ValueError(f"label must be one of {listed}{more}, got {int(missing[0])}")
    return np.isin(values, wanted)


def _refuse_photo(values: npt.NDArray[Any]) -> None:
    """Refuse values that change from pixel to pixel, as in a photo."""
    if values.dtype.kind == "b":
        return
    before, after = values[:-1], values[1:]
    both = (before != 0) & (after != 0)
    n_changes = int(np.count_nonzero(both & (before != after)))
    share = n_changes / max(1, int(np.count_nonzero(both)))
    n_values = np.unique(values).size
    if share > _BUSY and n_values > 2:
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
    first, last = _bounding_box(inside)
    n_at_border = sum(
        int(np.count_nonzero(np.take(inside, end, axis=d)))
        for d in range(image.dim)
        for end in (0, -1)
    )
    if n_at_border:
        warnings.warn(
            f"objects reach the border of the image at {n_at_border} pixels and are cut off there",
            ImageWarning,
            stacklevel=4,
        )
    part = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    padded = np.pad(inside[part], MARGIN)
    grid = CartesianGrid(
        image.origin + image.spacing * (first - MARGIN), image.spacing, padded.shape
    )
    if labels is not None:
        labels = np.pad(np.where(inside, labels, 0)[part], MARGIN)
    lower = image.origin - 0.5 * image.spacing
    return Mask(grid, padded, labels, lower, lower + image.spacing * inside.shape)


def _bounding_box(inside: BoolArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the first index with pixels inside, and one past the last, along each axis."""
    ends = []
    for d in range(inside.ndim):
        others = tuple(k for k in range(inside.ndim) if k != d)
        ends.append(np.flatnonzero(inside.any(axis=others))[[0, -1]])
    first, last = np.array(ends).T
    return first, last + 1


def distance_to_edge(
    mask: Mask, smoothing: float = SMOOTHING, *, progress: ProgressCallback | bool | None = None
) -> FloatArray:
    """Return the signed distance to the smoothed boundary of the objects, negative inside.

    Parameters
    ----------
    mask : Mask
    smoothing : float
        Standard deviation in pixels, >= 0, of the low-pass filter that is applied to the mask
        before the distance is computed.  A value of 2 removes ripples of the boundary, lines of
        up to 2 pixels and specks of up to 3 x 3 pixels.  Discs keep their pixels.

    Returns
    -------
    ndarray of float64, of the grid's shape

    Raises
    ------
    ValueError
        If smoothing removes all objects.

    Warns
    -----
    ImageWarning
        If smoothing removes some objects.
    """
    kept = _low_pass(
        mask.inside, as_number("smoothing", smoothing, lower=0.0, within=(0.0, _SMOOTHEST))
    )
    _report_lost_objects(mask.inside, kept)
    phi = signed_distance(mask.grid, kept, progress=progress)
    if -float(phi.min()) < _LEAST_DEPTH * float(mask.grid.spacing.min()):
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
        warnings.warn(
            f"smoothing removes {lost.size} of {count} objects, the largest of {lost.max()} pixels",
            ImageWarning,
            stacklevel=4,
        )
