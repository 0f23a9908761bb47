"""Pictures and volumes: PNG, TIFF and stacks, NIfTI, NRRD, NumPy.

Each format is read by the standard package of its field: Pillow (pictures), tifffile (all
pixel types, stacks, spacings), nibabel (NIfTI), pynrrd.  For LZW, PackBits and fax compression,
tifffile needs another package of 45 MB.  Pillow, which is required anyway, reads those.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._formats.guards import check_readable, neighbour
from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray

_NAMES_OF_VALUES = ("labels", "label", "mask", "segmentation", "image", "values", "volume")
# Cosine of the angle up to which an axis of an image counts as parallel to an axis of space.
_ALIGNED = 1.0 - 1e-6


class ImageArrays(NamedTuple):
    """What `adaptsize.background.image.Image` is made from, and notes for a warning."""

    values: npt.NDArray[Any]
    spacing: npt.ArrayLike = 1.0
    origin: npt.ArrayLike | None = None
    notes: Sequence[str] = ()


def is_image_file(path: Path) -> bool:
    """Return whether a file is read as an image, from its name."""
    return _suffix(path) in _LOADERS


def load(path: Path, name: str | None) -> ImageArrays:
    """Return the image in a file.

    Raises
    ------
    MeshFileError
        If the format is unknown, the file does not hold a single picture or volume, or its package
        is not installed.
    """
    if not is_image_file(path):
        raise MeshFileError(
            f"is not an image format that can be read; these can: {', '.join(_LOADERS)}"
        )
    try:
        return _LOADERS[_suffix(path)](path, name)
    except ModuleNotFoundError as error:
        raise MeshFileError(
            f"needs the package {error.name} (pip install 'adaptsize[image]')"
        ) from error


def _suffix(path: Path) -> str:
    ends = [part.lower() for part in path.suffixes[-2:]]
    return "".join(ends) if ends[-1:] == [".gz"] else "".join(ends[-1:])


def _load_picture(path: Path, name: str | None) -> ImageArrays:
    from PIL import Image as pillow

    with pillow.open(path) as opened:
        n_frames = getattr(opened, "n_frames", 1)
        notes = [f"only the first of {n_frames} frames is taken"] if n_frames > 1 else []
        return ImageArrays(_upright(_grey(_pixels_of(opened))), notes=notes)


def _pixels_of(opened: Any) -> npt.NDArray[Any]:
    """Return one frame.  For a picture with a palette, the indices are the labels."""
    if opened.mode in ("1", "L", "P", "I", "F", "RGB", "RGBA", "LA") or ";16" in opened.mode:
        return np.asarray(opened)
    return np.asarray(opened.convert("RGBA"))


def _grey(pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return one number per pixel.  Refuse colours, which do not define an inside."""
    if pixels.ndim == 2:
        return pixels
    n_colours = 1 if pixels.shape[-1] <= 2 else 3
    colours, alpha = pixels[..., :n_colours], pixels[..., n_colours:]
    if alpha.size and (alpha != alpha.flat[0]).any():
        raise MeshFileError(
            "has transparent parts, which may or may not belong to the object; "
            "save a mask: one number per pixel, 0 outside"
        )
    if (colours != colours[..., :1]).any():
        raise MeshFileError(
            "has colours; segment it first and save a mask: one number per pixel, 0 outside"
        )
    return np.asarray(colours[..., 0])


def _upright(pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return rows from the top as x to the right and y upwards."""
    return pixels[::-1].T


def _load_tiff(path: Path, name: str | None) -> ImageArrays:
    import tifffile

    with tifffile.TiffFile(path) as file:
        series, n_series = file.series[0], len(file.series)
        notes = [f"only the first of {n_series} series is taken"] if n_series > 1 else []
        spacing = _tiff_spacing(file)
        try:
            pixels = series.asarray()
        except (ImportError, ValueError) as error:  # a compression that needs imagecodecs
            if "imagecodecs" not in str(error):
                raise
            pixels = _tiff_frames(path)
        axes = series.axes
    if pixels.ndim == len(axes) and axes.endswith("S"):
        pixels = _grey(pixels)
    pixels = _whole_numbers(np.squeeze(pixels))
    if pixels.ndim == 2:
        return ImageArrays(_upright(pixels), spacing[:2], notes=notes)
    if pixels.ndim != 3:
        raise MeshFileError(
            f"holds an array of shape {pixels.shape} (axes {axes}), where one picture or one "
            "stack is required"
        )
    # x right, y down, z from page to page: right-handed
    return ImageArrays(pixels.T, spacing, notes=notes)


def _tiff_frames(path: Path) -> npt.NDArray[Any]:
    from PIL import Image as pillow
    from PIL import ImageSequence

    with pillow.open(path) as opened:
        frames = [_grey(_pixels_of(frame)) for frame in ImageSequence.Iterator(opened)]
    return np.stack(frames)


def _tiff_spacing(file: Any) -> FloatArray:
    """Return the pixel size as ImageJ writes it, else as OME does, else 1.

    The resolution in other files is that of the printer, and is ignored.
    """
    spacing = np.ones(3)
    if file.is_imagej:
        page, metadata = file.pages[0], file.imagej_metadata or {}
        for d, tag in enumerate(("XResolution", "YResolution")):
            if tag in page.tags:
                above, below = page.tags[tag].value
                spacing[d] = below / above if above and below else 1.0
        spacing[2] = float(metadata.get("spacing", 1.0)) or 1.0
    elif file.is_ome:
        from xml.etree import ElementTree

        for element in ElementTree.fromstring(file.ome_metadata).iter():
            if element.tag.endswith("}Pixels"):
                given = [element.get(f"PhysicalSize{axis}", "1") for axis in "XYZ"]
                return np.array(given, dtype=np.float64)
    return np.abs(spacing)


def _load_nifti(path: Path, name: str | None) -> ImageArrays:
    import nibabel

    file = nibabel.load(path)
    if not isinstance(file, nibabel.spatialimages.SpatialImage):
        raise MeshFileError("holds no volume")
    values = np.asanyarray(file.dataobj)
    while values.ndim > 3 and values.shape[-1] == 1:
        values = values[..., 0]
    if values.ndim not in (2, 3):
        raise MeshFileError(
            f"holds an array of shape {values.shape}, where one volume is required "
            "(a series in time? take one of its volumes)"
        )
    affine = np.asarray(file.affine, dtype=np.float64)
    return _along_axes(values, affine[:3, : values.ndim], affine[:3, 3])


def _load_nrrd(path: Path, name: str | None) -> ImageArrays:
    import nrrd

    with path.open("rb") as file:
        header = nrrd.read_header(file)
        for key in ("data file", "datafile"):
            check_readable(neighbour(path, str(header.get(key, path.name))))
        values = nrrd.read_data(header, file, str(path), index_order="F")
    steps = np.asarray(header.get("space directions", np.empty((0, 0))), dtype=np.float64)
    origin = np.asarray(header.get("space origin", ()), dtype=np.float64)
    if steps.size:
        is_space = np.isfinite(steps).all(axis=1)
        if not is_space.all():
            raise MeshFileError(
                f"holds {values.shape} values with {int((~is_space).sum())} axes that are not of "
                "space, where one number per pixel is required"
            )
        origin = origin if origin.size else np.zeros(steps.shape[1])
        return _along_axes(values, steps.T, origin)
    given = np.asarray(header.get("spacings", np.ones(values.ndim)), dtype=np.float64)
    spacing = np.where(np.isfinite(given), np.abs(given), 1.0)
    return _image_of(values, spacing, np.zeros(values.ndim))


def _along_axes(values: npt.NDArray[Any], steps: FloatArray, origin: FloatArray) -> ImageArrays:
    """Return an image with the axes of space, after permutation and mirroring.

    ``steps[:, d]`` is the step of axis d in space.  Oblique axes are replaced by the
    closest axes of space, with a note.
    """
    from scipy.optimize import linear_sum_assignment

    lengths = np.linalg.norm(steps, axis=0)
    if not (np.isfinite(lengths) & (lengths > 0.0)).all() or not np.isfinite(origin).all():
        raise MeshFileError(f"has steps of {lengths} from pixel to pixel, where > 0 is required")
    cosines = steps / lengths
    in_space, of_array = linear_sum_assignment(-np.abs(cosines))
    notes = []
    if np.abs(cosines[in_space, of_array]).min() < _ALIGNED:
        notes.append("its axes are oblique in space; coordinates are along its own axes")
    values = np.transpose(values, of_array)
    first = origin[in_space].copy()
    for d, (row, axis) in enumerate(zip(in_space, of_array, strict=True)):
        if cosines[row, axis] < 0.0:
            values = np.flip(values, axis=d)
            first[d] -= lengths[axis] * (values.shape[d] - 1)
    return _image_of(values, lengths[of_array], first, notes)


def _image_of(
    values: npt.NDArray[Any], spacing: FloatArray, origin: FloatArray, notes: Sequence[str] = ()
) -> ImageArrays:
    """Return an image, without its last axis if that has only one pixel."""
    if values.ndim == 3 and values.shape[2] == 1:
        values, spacing, origin = values[:, :, 0], spacing[:2], origin[:2]
    return ImageArrays(_whole_numbers(values), spacing, origin, notes)


def _whole_numbers(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return labels that are stored as floats as integers."""
    if values.dtype.kind == "f" and np.isfinite(values).all():
        is_whole = (values == np.rint(values)).all()
        if is_whole and np.abs(values).max(initial=0.0) <= 2**31 - 1:
            return values.astype(np.int32)
    return values


def _load_npz(path: Path, name: str | None) -> ImageArrays:
    """Load the array of the given name, else the only one that can be an image, or a usual name."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {key: file[key] for key in file.files}
    listed = f"(found: {', '.join(arrays) or 'none'})"
    if name is None:
        fit = [key for key, array in arrays.items() if array.ndim in (2, 3)]
        usual = [key for key in _NAMES_OF_VALUES if key in fit]
        if len(fit) != 1 and not usual:
            raise MeshFileError(
                f"holds {len(fit)} arrays that could be an image, pass name= {listed}"
            )
        name = fit[0] if len(fit) == 1 else usual[0]
    elif name not in arrays:
        raise MeshFileError(f"has no array {name!r} {listed}")
    extra = {key: arrays[key] for key in ("spacing", "origin") if key in arrays}
    return ImageArrays(arrays[name], **extra)


_LOADERS: dict[str, Callable[[Path, str | None], ImageArrays]] = {
    **dict.fromkeys((".png", ".bmp", ".gif", ".jpg", ".jpeg", ".pgm"), _load_picture),
    **dict.fromkeys((".tif", ".tiff"), _load_tiff),
    **dict.fromkeys((".nii", ".nii.gz"), _load_nifti),
    **dict.fromkeys((".nrrd", ".nhdr"), _load_nrrd),
    ".npy": lambda path, name: ImageArrays(np.load(path, allow_pickle=False)),
    ".npz": _load_npz,
}
