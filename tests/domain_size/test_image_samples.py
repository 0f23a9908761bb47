"""The images in data/ are what data/README.md says, and the script makes them."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from adaptsize import read_image

DATA = Path(__file__).parents[2] / "data"


def test_objects_are_five_of_one_piece_each():
    image = read_image(DATA / "objects.png")
    assert image.shape == (480, 360)
    assert np.unique(image.values).tolist() == [0, 51, 102, 153, 204, 255]
    pieces, count = ndimage.label(image.values > 0, structure=np.ones((3, 3)))
    assert count == 5
    assert [len(np.unique(image.values[pieces == k])) for k in range(1, 6)] == [1] * 5
    # The spanner, the nut and the key have a hole each.
    assert ndimage.label(image.values == 0)[1] == 4
    coin = np.count_nonzero(image.values == 255)
    assert coin == pytest.approx(np.pi * 24.0**2, rel=0.01)


def test_organs_touch_in_one_face_and_leave_the_border_free():
    image = read_image(DATA / "organs.nii.gz")
    assert image.shape == (128, 128, 128)
    assert image.spacing.tolist() == [1.5, 1.5, 1.5]
    for k in (1, 2):
        assert ndimage.label(image.values == k)[1] == 1
    pairs = np.minimum(image.values[:-1], image.values[1:]) * (
        image.values[:-1] != image.values[1:]
    )
    faces = ndimage.label((pairs > 0) & (image.values[:-1] + image.values[1:] == 3))[1]
    assert faces >= 1
    inner = image.values[1:-1, 1:-1, 1:-1]
    assert np.count_nonzero(inner) == np.count_nonzero(image.values)


@pytest.mark.parametrize("name", ["objects.png", "organs.nii.gz"])
def test_the_script_makes_the_files(tmp_path, name):
    script = runpy.run_path(str(DATA / "make_images.py"))
    script["SAMPLES"][name](tmp_path / name)
    np.testing.assert_array_equal(
        read_image(tmp_path / name).values, read_image(DATA / name).values
    )
    assert (DATA / name).stat().st_size < 20_000
