"""Pictures of what controls the sizes."""

import numpy as np
import pytest
from meshes import random_square

from adaptsize import CartesianGrid, size_function
from adaptsize.domain_size.report import limit_bounds

pytest.importorskip("pyvista", reason="draws")


def colours_of(image):
    """The frequent colours that are not grey."""
    pixels, counts = np.unique(image.reshape(-1, 3), axis=0, return_counts=True)
    coloured = np.ptp(pixels.astype(int), axis=1) > 40
    return pixels[coloured & (counts > 0.005 * image.shape[0] * image.shape[1])]


def test_each_cause_of_a_mesh_has_a_colour(tmp_path):
    from adaptsize.plot import plot_causes

    mesh = random_square(300, seed=77)
    x = mesh.points[:, 0]
    bounds = {
        "left": np.where(x < -0.9, 0.05, np.inf),
        "right": np.where(x > 0.9, 0.05, np.inf),
    }
    _, report = limit_bounds(mesh, bounds, 0.5, hmin=0.01, hmax=0.3)
    image = plot_causes(report, path=tmp_path / "causes.png", width=320)
    assert image.shape[1:] == (320, 3)
    assert len(colours_of(image)) >= 3
    assert (tmp_path / "causes.png").exists()


def test_what_is_outside_a_grid_is_left_out(tmp_path):
    from adaptsize.plot import plot_causes

    grid = CartesianGrid([-2.0, -2.0], 0.1, (41, 41))
    _, report = size_function(
        lambda x: np.linalg.norm(x, axis=1) - 1.0, background=grid, hmax=9.0, full_output=True
    )
    image = plot_causes(report, width=320)
    # Drawn is the disc, which fills its box but for the corners: white or grey.
    rows = image[:, : int(0.7 * 320)]
    coloured = np.ptp(rows.astype(int), axis=2) > 40
    high, wide = (np.flatnonzero(coloured.any(axis=d)) for d in (1, 0))
    box = (np.ptp(high) + 1) * (np.ptp(wide) + 1)
    assert 0.6 < coloured.sum() / box < 0.95
