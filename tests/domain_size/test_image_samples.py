"""The images in data/ are what data/README.md says, and the script makes them."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from adaptsize import read_image

DATA = Path(__file__).parents[2] / "data"


@pytest.mark.parametrize("name", ["objects.png", "organs.nii.gz"])
def test_the_script_makes_the_files(tmp_path, name):
    script = runpy.run_path(str(DATA / "make_images.py"))
    script["SAMPLES"][name](tmp_path / name)
    np.testing.assert_array_equal(
        read_image(tmp_path / name).values, read_image(DATA / name).values
    )
    assert (DATA / name).stat().st_size < 20_000
