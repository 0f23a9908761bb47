"""Make the sample images of this folder, each the same on every run.

Needs, for this script only: ``pip install pillow nibabel``.

    python data/make_images.py               # every file, beside this script
    python data/make_images.py objects.png --into /tmp
"""

import argparse
import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

SEED = 20060295


# --- objects.png ------------------------------------------------------------------


def make_objects(path: Path) -> None:
    """Write a mask of 480 x 360 pixels: what is left of a photo when its background is removed.

    Grey values 51, 102, 153, 204 and 255 for a spanner, a nut, a key, a leaf and a coin.  Edges
    are ragged by about a pixel, as those of a segmentation are.
    """
    from PIL import Image

    rows, columns = 360, 480
    y, x = np.mgrid[rows - 1 : -1 : -1, 0:columns].astype(np.float64)
    rng = np.random.default_rng(SEED)
    ragged = 0.5 * rng.standard_normal((rows, columns))
    labels = np.zeros((rows, columns), np.uint8)
    for value, shape in zip((51, 102, 153, 204, 255), OBJECTS, strict=True):
        labels[shape(x, y) + ragged < 0.0] = value
    _drop_specks(labels)
    Image.fromarray(labels).save(path, optimize=True)


def _drop_specks(labels: npt.NDArray[np.uint8]) -> None:
    """Keep the largest piece of each object, and fill holes of a few pixels, as one does."""
    from scipy import ndimage

    for value in np.unique(labels[labels > 0]):
        pieces, _ = ndimage.label(labels == value)
        largest = np.bincount(pieces[pieces > 0]).argmax()
        labels[(pieces > 0) & (pieces != largest)] = 0
    outside, count = ndimage.label(labels == 0)
    for piece in np.flatnonzero(np.bincount(outside.ravel(), minlength=count + 1) < 20):
        near = ndimage.binary_dilation(outside == piece)
        labels[outside == piece] = labels[near].max()


def _turned(
    x: FloatArray, y: FloatArray, centre: tuple[float, float], degrees: float
) -> tuple[FloatArray, FloatArray]:
    a = np.deg2rad(degrees)
    u, v = x - centre[0], y - centre[1]
    return np.cos(a) * u + np.sin(a) * v, np.cos(a) * v - np.sin(a) * u


def _bar(u: FloatArray, v: FloatArray, low: float, high: float, half: float) -> FloatArray:
    """Signed distance, or nearly, to the box low < u < high, -half < v < half."""
    return np.maximum(np.abs(u - 0.5 * (low + high)) - 0.5 * (high - low), np.abs(v) - half)


def _disc(u: FloatArray, v: FloatArray, a: float, b: float, radius: float) -> FloatArray:
    return np.hypot(u - a, v - b) - radius


def _blend(one: FloatArray, other: FloatArray, width: float) -> FloatArray:
    """Union of two shapes with a fillet of about ``width``."""
    share = np.clip(0.5 + 0.5 * (other - one) / width, 0.0, 1.0)
    return other * (1.0 - share) + one * share - width * share * (1.0 - share)


def _spanner(x: FloatArray, y: FloatArray) -> FloatArray:
    u, v = _turned(x, y, (170.0, 235.0), 28.0)
    body = _blend(_bar(u, v, -95.0, 95.0, 11.0), _disc(u, v, -105.0, 0.0, 30.0), 14.0)
    body = _blend(body, _disc(u, v, 105.0, 0.0, 36.0), 14.0)
    jaw = _bar(*_turned(u, v, (112.0, 0.0), 15.0), -6.0, 60.0, 15.0)
    return np.maximum(np.maximum(body, -_disc(u, v, -105.0, 0.0, 17.0)), -jaw)


def _nut(x: FloatArray, y: FloatArray) -> FloatArray:
    u, v = _turned(x, y, (385.0, 270.0), 10.0)
    sides = [np.cos(a) * u + np.sin(a) * v - 46.0 for a in np.arange(6) * np.pi / 3.0]
    return np.maximum(np.maximum.reduce(sides), -_disc(u, v, 0.0, 0.0, 27.0))


def _key(x: FloatArray, y: FloatArray) -> FloatArray:
    u, v = _turned(x, y, (70.0, 95.0), -12.0)
    shape = _blend(_disc(u, v, 0.0, 0.0, 34.0), _bar(u, v, 20.0, 165.0, 7.0), 8.0)
    for place, depth in ((120.0, 20.0), (138.0, 14.0), (156.0, 22.0)):
        tooth = np.maximum(np.abs(u - place) - 5.0, np.abs(v + 0.5 * depth) - 0.5 * depth)
        shape = np.minimum(shape, tooth)
    return np.maximum(shape, -_disc(u, v, -10.0, 0.0, 13.0))


def _leaf(x: FloatArray, y: FloatArray) -> FloatArray:
    u, v = _turned(x, y, (345.0, 118.0), 35.0)
    blade = np.maximum(_disc(u, v, 0.0, -62.0, 100.0), _disc(u, v, 0.0, 62.0, 100.0))
    stem = _bar(u, v - 0.0025 * (u + 75.0) ** 2, -112.0, -70.0, 3.0)
    return _blend(blade, stem, 5.0)


def _coin(x: FloatArray, y: FloatArray) -> FloatArray:
    return _disc(x, y, 440.0, 60.0, 24.0)


OBJECTS: tuple[Callable[[FloatArray, FloatArray], FloatArray], ...] = (
    _spanner,
    _nut,
    _key,
    _leaf,
    _coin,
)


# --- organs.nii.gz ----------------------------------------------------------------


def make_organs(path: Path) -> None:
    """Write a volume of 128^3 voxels of 1.5 mm with two organs that touch, labels 1 and 2.

    The larger one has two lobes and a groove between them, like a liver; the other is bent like
    a stomach, ends in a tube, and lies against it.
    """
    import nibabel

    n, spacing = 128, 1.5
    axis = spacing * np.arange(n)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij", sparse=True)
    liver, stomach = _liver(x, y, z), _stomach(x, y, z)
    labels = np.zeros((n, n, n), np.uint8)
    labels[(liver < 0.0) & (liver <= stomach)] = 1
    labels[(stomach < 0.0) & (stomach < liver)] = 2
    image = nibabel.Nifti1Image(labels, np.diag([spacing, spacing, spacing, 1.0]))
    image.header.set_xyzt_units("mm")
    path.write_bytes(gzip.compress(image.to_bytes(), mtime=0))


def _ball(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    centre: tuple[float, float, float],
    axes: tuple[float, float, float],
) -> FloatArray:
    """Distance to an ellipsoid, roughly: exact in sign, and near it for round ones."""
    scaled = [(c - m) / a for c, m, a in zip((x, y, z), centre, axes, strict=True)]
    return (np.sqrt(sum(s * s for s in scaled)) - 1.0) * min(axes)


def _liver(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    right = _ball(x, y, z, (68.0, 98.0, 100.0), (46.0, 58.0, 48.0))
    left = _ball(x, y, z, (112.0, 86.0, 112.0), (48.0, 36.0, 26.0))
    groove = _ball(x, y, z, (94.0, 34.0, 92.0), (9.0, 24.0, 44.0))
    return np.maximum(_blend(right, left, 14.0), -groove)


def _stomach(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    # A bent tube: a thick arc of a circle in the plane y = 96, thinner towards its lower end.
    u, w = x - 120.0, z - 66.0
    angle = np.arctan2(w, u)  # from the top of the arc (45 degrees) down to the tube
    bend = np.clip(angle, np.deg2rad(-135.0), np.deg2rad(45.0))
    along = (np.deg2rad(45.0) - bend) / np.deg2rad(180.0)
    radius = 24.0 - 17.0 * along
    away = np.sqrt(
        (u - 38.0 * np.cos(bend)) ** 2 + (w - 38.0 * np.sin(bend)) ** 2 + (y - 96.0) ** 2
    )
    return away - radius


SAMPLES = {"objects.png": make_objects, "organs.nii.gz": make_organs}


def main() -> None:
    """Make the files named on the command line, or all."""
    parser = argparse.ArgumentParser(description="Make the sample images of adaptsize.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SAMPLES))
    parser.add_argument("--into", type=Path, default=Path(__file__).parent, help="folder")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.names) - set(SAMPLES))
    if unknown:
        parser.error(f"no such sample: {', '.join(unknown)}")
    for name in arguments.names or SAMPLES:
        SAMPLES[name](arguments.into / name)
        print(f"{name}: {(arguments.into / name).stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
