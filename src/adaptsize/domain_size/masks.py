"""Objects in images: their masks, filtered, and the distance to their boundary."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array, describe, refusal, refuse_where, warn_caller
from adaptsize._messages import Message
from adaptsize.background import CartesianGrid
from adaptsize.background.grid import span_of
from adaptsize.background.image import Image
from adaptsize.errors import InputWarning, OptionError
from adaptsize.options.sizes import ImageOptions
from adaptsize.typing import BoolArray, FloatArray

#: Margin around the objects in pixels, for finite differences and kinks of the distance.
MARGIN = 6


@dataclass(frozen=True, eq=False, repr=False)
class Mask:
    """The labels of pixels, on a grid cropped to the objects with a margin.

    Where objects reach the border of the image, the grid extends beyond it, and the labels there
    are those at the border.  So the border cuts the objects and does not bound them.
    """

    grid: CartesianGrid
    """Nodes are the centres of the pixels."""
    labels: npt.NDArray[Any]
    """Of the grid's shape, 0 outside the objects."""
    has_labels: bool
    """False if the image only distinguishes inside and outside, 1 and 0."""
    lower: FloatArray
    """Lowest coordinates of the pixels of the image, float64[dim]."""
    upper: FloatArray
    """Highest coordinates of the pixels of the image, float64[dim]."""

    @property
    def image_part(self) -> tuple[slice, ...]:
        """The part of the grid in the image."""
        shape = np.round((self.upper - self.lower) / self.grid.spacing).astype(int)
        start = np.round((self.grid.lower - self.lower) / self.grid.spacing - 0.5).astype(int)
        stop = np.minimum(np.array(self.grid.shape), shape - start)
        return tuple(slice(a, b) for a, b in zip(np.maximum(-start, 0), stop, strict=True))

    @property
    def in_image(self) -> BoolArray:
        """Which pixels belong to the image, of the grid's shape."""
        found = np.zeros(self.grid.shape, np.bool_)
        found[self.image_part] = True
        return found

    def measures(self) -> dict[int, float]:
        """Return the area or volume of the pixels of each label."""
        names, counts = np.unique(self.labels[self.image_part], return_counts=True)
        pixel = float(np.prod(self.grid.spacing))
        return {int(a): pixel * int(n) for a, n in zip(names, counts, strict=True) if a != 0}


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
        made = Image.of("image", values, 1.0 if spacing is None else spacing)
    # Gradient limiting accepts coordinates up to 1e60; an image has below 1e10 pixels per axis.
    far = (made.spacing < 1e-50) | (made.spacing > 1e50)
    wanted = "must be from 1e-50 to 1e+50: choose another unit of length"
    refuse_where("spacing", far, made.spacing, wanted, OptionError)
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
        raise OptionError(Message("{label} or {threshold} must be given, got both: {}", given))
    if threshold is not None:
        return _cut(image, values > threshold, f"above {threshold:g}", None)
    if values.dtype.kind == "f":
        kind, low, high = values.dtype, values.min(), values.max()
        text = (
            "image must hold labels (bool or integers), got {} from {:g} to {:g}; pass {threshold}"
        )
        raise ValueError(Message(text, kind, low, high))
    if label is not None:
        chosen = _is_labelled(values, label)
        is_named = bool(values[chosen].any())  # label 0 alone is what is outside otherwise
        if is_named and not values[chosen].all():
            raise refusal("label", f"must not hold 0, the outside, with others, got {label}")
        return _cut(image, chosen, f"of label {label}", values if is_named else None)
    _refuse_photo(values)
    inside = values != 0
    several = values.dtype.kind != "b" and values[inside].size > 0 and np.ptp(values[inside]) > 0
    return _cut(image, inside, "that is not 0", values if several else None)


def _is_labelled(values: npt.NDArray[Any], label: int | Sequence[int]) -> BoolArray:
    wanted = np.atleast_1d(np.asarray(label))
    if wanted.dtype.kind not in "iu" or wanted.ndim != 1 or wanted.size == 0:
        raise refusal("label", f"must be an integer or several, got {describe(label)}")
    present = np.unique(values)
    missing = wanted[~np.isin(wanted, present)]
    if missing.size:
        listed = ", ".join(str(int(k)) for k in present[:12])
        more = ", ..." if present.size > 12 else ""
        raise refusal("label", f"must be one of {listed}{more}, got {int(missing[0])}")
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
        text = (
            "image must be a mask or hold labels, got {} different values that change from pixel "
            "to pixel, as in a photo: segment it first, or pass {threshold} or {label}"
        )
        raise ValueError(Message(text, n_values))


def _cut(image: Image, inside: BoolArray, what: str, labels: npt.NDArray[Any] | None) -> Mask:
    """Return the part of an image that contains objects, with a margin."""
    if not inside.any():
        raise ValueError(f"image must have a pixel {what}, got none in {image!r}")
    if inside.all() and (labels is None or np.ptp(labels) == 0):
        raise ValueError(
            f"image must have pixels outside the objects, got none: all of {image!r} {what}; "
            "is it inverted?"
        )
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
    # One more pixel, where there is one: beyond the border of the image, the last one is repeated.
    first, last = span_of(inside).T + np.array([[-1], [2]])
    first, last = np.maximum(first, 0), np.minimum(last, image.shape)
    part = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    own = inside.astype(np.uint8) if labels is None else np.where(inside, labels, 0)
    padded = np.pad(own[part], MARGIN, mode="edge")
    grid = CartesianGrid(
        image.origin + image.spacing * (first - MARGIN), image.spacing, padded.shape
    )
    lower = image.origin - 0.5 * image.spacing
    upper = lower + image.spacing * inside.shape
    return Mask(grid, padded, labels is not None, lower, upper)


def lost_pixels(mask: Mask, smooth: npt.NDArray[Any], gap: FloatArray) -> BoolArray:
    """Return which pixels of labels are farther than two pixels from the filtered labels.

    Filtered objects that are nowhere deeper than half a pixel do not count: they are thinner than
    three pixels.  ``gap`` is twice the depth in pixels.
    """
    from scipy import ndimage

    lost = np.zeros(smooth.shape, np.bool_)
    near = np.ones((3,) * smooth.ndim, np.bool_)
    for name in np.unique(mask.labels[mask.labels != smooth]):
        if name == 0:
            continue
        own = mask.labels == name
        part = tuple(slice(max(a - 3, 0), b + 4) for a, b in span_of(own))
        objects, count = ndimage.label(smooth[part] == name, near)
        deepest = ndimage.maximum(gap[part], objects, np.arange(count + 1))
        is_kept = np.append(False, np.asarray(deepest)[1:] >= 1.0)
        kept = ndimage.binary_dilation(is_kept[objects], near, iterations=2)
        lost[part] |= own[part] & ~kept
    return lost & mask.in_image


def report_lost(in_image: BoolArray, before: npt.NDArray[Any], after: npt.NDArray[Any]) -> None:
    """Report objects, and parts of labels, that a filter of the labels has removed.

    ``after`` has other labels at the pixels of these.

    Raises
    ------
    ValueError
        If no object is left.

    Warns
    -----
    InputWarning
        If some objects are lost, or more than 2 % of a label.
    """
    from scipy import ndimage

    lost = in_image & (before != after)
    if not lost.any():
        return
    sizes_lost, total, parts = [], 0, []
    names = np.unique(before[before != 0])
    for name in names:
        own = before == name
        objects, count = ndimage.label(own, structure=np.ones((3,) * own.ndim))
        sizes = np.bincount(objects.ravel(), minlength=count + 1)
        left = sizes - np.bincount(objects[lost], minlength=count + 1)
        sizes_lost += sizes[1:][left[1:] == 0].tolist()
        total += count
        share = np.count_nonzero(own & lost) / np.count_nonzero(own)
        if share > 0.02 and left[1:].any():
            parts.append(f"{share:.1%} of {f'label {name}' if len(names) > 1 else 'the pixels'}")
    if len(sizes_lost) == total:
        what = f"{total} objects" if total > 1 else "one object"
        raise ValueError(
            Message(
                "image must show objects at least 4 pixels across, got {} of at most {} pixels, "
                "which {smoothing} removes",
                *(what, max(sizes_lost)),
            )
        )
    if sizes_lost:
        warn_caller(
            Message(
                "{smoothing} removes {} of {} objects, the largest of {} pixels",
                *(len(sizes_lost), total, max(sizes_lost)),
            ),
            InputWarning,
        )
    elif parts:
        warn_caller(
            Message(
                "{smoothing} removes thin parts: {}; less smoothing keeps them", ", ".join(parts)
            ),
            InputWarning,
        )
