"""Pictures and volumes from files: what is where, how large, and what is refused."""

import struct
import sys
import zlib

import nibabel
import nrrd
import numpy as np
import pytest
import tifffile
from PIL import Image as Pillow

from adaptsize._formats import raster
from adaptsize.errors import InputWarning, MeshFileError
from adaptsize.io import read_image


def corner(shape=(7, 5), dtype=np.uint8):
    """Rows from the top of a picture that is 0 but for its lower left pixel and the one above."""
    rows = np.zeros(shape[::-1], dtype)
    rows[-1, 0], rows[-2, 0] = 3, 2
    return rows


def test_pictures_have_x_to_the_right_and_y_upwards(tmp_path):
    Pillow.fromarray(corner()).save(tmp_path / "mask.png")
    image = read_image(tmp_path / "mask.png")
    assert image.shape == (7, 5)
    assert (image.values[0, 0], image.values[0, 1], image.values[1, 0]) == (3, 2, 0)
    assert image.spacing.tolist() == [1.0, 1.0]
    assert image.origin.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "packbits", "tiff_adobe_deflate"])
def test_compressed_tiffs_are_the_same_picture_or_stack(tmp_path, monkeypatch, compression):
    monkeypatch.setitem(sys.modules, "imagecodecs", None)  # a package that need not be there
    Pillow.fromarray(corner()).save(tmp_path / "mask.tif", compression=compression)
    np.testing.assert_array_equal(read_image(tmp_path / "mask.tif").values, corner()[::-1].T)
    first, *others = (Pillow.fromarray(page) for page in volume().T)
    options = {"save_all": True, "append_images": others, "compression": compression}
    first.save(tmp_path / "stack.tif", **options)
    np.testing.assert_array_equal(read_image(tmp_path / "stack.tif").values, volume())


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.int64, np.float32, np.float64])
def test_tiffs_keep_their_kind_of_pixels(tmp_path, dtype):
    is_float = np.dtype(dtype).kind == "f"
    pixels = corner(dtype=dtype) / 2 if is_float else corner(dtype=dtype)
    tifffile.imwrite(tmp_path / "mask.tiff", pixels.astype(dtype))
    image = read_image(tmp_path / "mask.tiff")
    assert image.values.dtype == dtype
    np.testing.assert_array_equal(image.values, pixels[::-1].T)


def test_the_indices_of_a_palette_are_the_labels(tmp_path):
    picture = Pillow.fromarray(corner()).convert("P")
    picture.putpalette([0, 0, 0, 200, 30, 30, 30, 200, 30, 30, 30, 200])
    picture.putdata(corner().ravel().tolist())
    picture.save(tmp_path / "labels.png")
    np.testing.assert_array_equal(read_image(tmp_path / "labels.png").values, corner()[::-1].T)


@pytest.mark.parametrize(
    ("n_channels", "place", "message"),
    [
        (3, (2, 3, 0), r"other\.png: has colours; segment it first"),
        (4, (0, 0, 3), "transparent parts"),
    ],
)
def test_grey_stored_as_colours_is_grey_and_colours_are_refused(
    tmp_path, n_channels, place, message
):
    rows = np.repeat(corner()[..., None], n_channels, axis=2)
    rows[..., 3:] = 255  # opaque
    Pillow.fromarray(rows).save(tmp_path / "grey.png")
    np.testing.assert_array_equal(read_image(tmp_path / "grey.png").values, corner()[::-1].T)
    rows[place] = 10
    Pillow.fromarray(rows).save(tmp_path / "other.png")
    with pytest.raises(MeshFileError, match=message):
        read_image(tmp_path / "other.png")


def volume():
    values = np.zeros((4, 5, 6), np.uint8)
    values[1, 2, 3], values[3, 0, 0] = 7, 2
    return values


IMAGEJ = {
    "imagej": True,
    "resolution": (1 / 0.5, 1 / 0.25),  # pixels per unit
    "metadata": {"spacing": 3.0, "unit": "um", "axes": "ZYX"},
}
SIZES = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeZ": 3.0}
OME = {"photometric": "minisblack", "metadata": {"axes": "ZYX"} | SIZES}


@pytest.mark.parametrize(("name", "options"), [("stack.tif", IMAGEJ), ("stack.ome.tif", OME)])
def test_stacks_have_x_y_and_the_page_as_z_with_their_spacing(tmp_path, name, options):
    tifffile.imwrite(tmp_path / name, volume().T, **options)
    image = read_image(tmp_path / name)
    np.testing.assert_array_equal(image.values, volume())
    np.testing.assert_allclose(image.spacing, [0.5, 0.25, 3.0])


#: Axes of the array along z, -x and y of space.
TURNED = np.array([[0.0, -2.0, 0.0], [0.0, 0.0, 0.5], [3.0, 0.0, 0.0]])
PLACE = np.array([5.0, 1.0, 2.0])


def write_nifti(path, steps):
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = steps, PLACE
    nibabel.save(nibabel.Nifti1Image(volume(), affine), path)


def write_nrrd(path, steps):
    header = {"space": "left-posterior-superior", "space directions": steps.T}
    nrrd.write(str(path), volume(), header | {"space origin": PLACE})


@pytest.mark.parametrize(
    ("name", "write"), [("v.nii", write_nifti), ("v.nii.gz", write_nifti), ("v.nrrd", write_nrrd)]
)
def test_volumes_lie_where_the_file_says_along_the_axes_of_space(tmp_path, name, write):
    write(tmp_path / name, TURNED)
    image = read_image(tmp_path / name)
    np.testing.assert_allclose(image.spacing, [2.0, 0.5, 3.0])
    for value in (7, 2):
        (index,) = np.argwhere(volume() == value)
        (found,) = np.argwhere(image.values == value)
        # Affines are stored in single precision.
        np.testing.assert_allclose(
            image.origin + image.spacing * found, TURNED @ index + PLACE, rtol=1e-6
        )


@pytest.mark.parametrize(("name", "write"), [("v.nii", write_nifti), ("v.nrrd", write_nrrd)])
def test_volumes_that_are_askew_keep_their_own_axes_with_a_warning(tmp_path, name, write):
    c, s = np.cos(0.3), np.sin(0.3)
    write(tmp_path / name, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) * 1.5)
    with pytest.warns(InputWarning, match="oblique in space"):
        image = read_image(tmp_path / name)
    np.testing.assert_array_equal(image.values, volume())
    np.testing.assert_allclose(image.spacing, 1.5, rtol=1e-6)


def test_whole_numbers_stored_as_floats_are_labels(tmp_path):
    nibabel.save(nibabel.Nifti1Image(volume().astype(np.float32), np.eye(4)), tmp_path / "v.nii")
    assert read_image(tmp_path / "v.nii").values.dtype == np.int32
    half = nibabel.Nifti1Image(volume() * np.float32(0.5), np.eye(4))
    nibabel.save(half, tmp_path / "w.nii")
    assert read_image(tmp_path / "w.nii").values.dtype.kind == "f"
    pixels = volume().astype(np.float32)
    tifffile.imwrite(tmp_path / "t.tif", pixels, photometric="minisblack")
    assert read_image(tmp_path / "t.tif").values.dtype == np.int32


def test_one_slice_is_a_picture_and_a_series_in_time_is_refused(tmp_path):
    nibabel.save(nibabel.Nifti1Image(volume()[:, :, :1], np.eye(4)), tmp_path / "slice.nii")
    assert read_image(tmp_path / "slice.nii").shape == (4, 5)
    series = np.stack([volume(), volume()], axis=3)
    nibabel.save(nibabel.Nifti1Image(series, np.eye(4)), tmp_path / "series.nii")
    with pytest.raises(MeshFileError, match=r"shape \(4, 5, 6, 2\), where one volume is required"):
        read_image(tmp_path / "series.nii")


def test_numpy_arrays_are_taken_as_they_are(tmp_path):
    np.save(tmp_path / "v.npy", volume())
    np.testing.assert_array_equal(read_image(tmp_path / "v.npy").values, volume())
    np.savez(tmp_path / "v.npz", labels=volume(), other=volume() + 1, spacing=[1.0, 2.0, 3.0])
    image = read_image(tmp_path / "v.npz")
    np.testing.assert_array_equal(image.values, volume())
    assert image.spacing.tolist() == [1.0, 2.0, 3.0]
    named = read_image(tmp_path / "v.npz", name="other")
    np.testing.assert_array_equal(named.values, volume() + 1)
    with pytest.raises(MeshFileError, match=r"has no array .mask.*labels, other"):
        read_image(tmp_path / "v.npz", name="mask")
    np.savez(tmp_path / "two.npz", one=volume(), two=volume())
    with pytest.raises(MeshFileError, match="holds 2 arrays that could be an image, pass name="):
        read_image(tmp_path / "two.npz")


@pytest.mark.parametrize(
    "name", ["a.png", "a.tif", "a.nii", "a.nii.gz", "a.nrrd", "a.npy", "a.npz", "a.jpg"]
)
@pytest.mark.parametrize("content", [b"", b"hello" * 50, b"\x89PNG\r\n\x1a\n", b"NRRD0004\n"])
def test_damaged_files_are_one_line_with_their_name(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MeshFileError) as caught:
        read_image(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_a_picture_of_too_many_pixels_is_refused(tmp_path):
    Pillow.fromarray(corner()).save(tmp_path / "a.png")
    content = bytearray((tmp_path / "a.png").read_bytes())
    content[16:24] = struct.pack(">II", 20_000, 20_000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(MeshFileError, match=r"a\.png: .*400000000 pixels"):
        read_image(tmp_path / "a.png")


def test_a_reader_that_is_missing_is_named_with_how_to_get_it(tmp_path, monkeypatch):
    Pillow.fromarray(corner()).save(tmp_path / "mask.tif")
    monkeypatch.setitem(sys.modules, "tifffile", None)
    with pytest.raises(MeshFileError, match=r"tifffile.*adaptsize\[image\]"):
        raster.load(tmp_path / "mask.tif", None)


def test_numbers_of_a_header_are_read_from_its_own_folder_only(tmp_path):
    folder = tmp_path / "given"
    folder.mkdir()
    nrrd.write(str(folder / "v.nhdr"), volume(), detached_header=True)
    assert read_image(folder / "v.nhdr").values.shape == volume().shape
    text = (folder / "v.nhdr").read_text()
    (name,) = [entry.name for entry in folder.iterdir() if entry.name != "v.nhdr"]
    (folder / name).rename(tmp_path / name)
    (folder / "link").symlink_to(tmp_path / name)
    for place in (f"../{name}", tmp_path / name, "link"):
        (folder / "v.nhdr").write_text(text.replace(name, str(place)))
        with pytest.raises(MeshFileError, match=r"v\.nhdr: .* outside of its folder"):
            read_image(folder / "v.nhdr")
    (folder / "v.nhdr").write_text(text)
    with pytest.raises(MeshFileError, match="No such file"):
        read_image(folder / "v.nhdr")


def test_an_archive_of_arrays_with_another_checksum_is_refused(tmp_path):
    file = tmp_path / "a.npz"
    np.savez(file, labels=np.eye(4, dtype=int))
    flipped = bytearray(file.read_bytes())
    flipped[200] ^= 255  # inside the numbers
    file.write_bytes(flipped)
    with pytest.raises(MeshFileError, match=r"a\.npz: .*CRC"):
        read_image(file)
