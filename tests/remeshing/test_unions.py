"""Bodies that overlap, touch or share faces become one volume without overlapping cells."""

import warnings

import numpy as np
import pytest
from meshes import random_sphere
from scipy.spatial.transform import Rotation
from shapes import CORNERS, CUBE_CELLS, block, joined, moved

from adaptsize import SimplexMesh, check_mesh, remesh, size_function
from adaptsize.errors import BoundaryWarning, OpenSurfaceWarning
from adaptsize.quality.boundary import overlapping_cells
from adaptsize.remeshing.acceptance import warn_of_deviation
from adaptsize.sizes import Enclosed, predict

CUBE = SimplexMesh(CORNERS, CUBE_CELLS)


pytest.importorskip("mmgpy", reason="the meshes are made by Mmg")
pytest.importorskip("netgen", reason="simple surfaces are filled by Netgen")
pytest.importorskip("pytetwild", reason="fTetWild makes unions")


def box(lower, upper):
    return SimplexMesh(lower + CORNERS * np.subtract(upper, lower), CUBE_CELLS)


def turned(surface, seed, scale):
    """Return a surface in another place, and the triangles in another order."""
    rng = np.random.default_rng(seed)
    turn = scale * Rotation.random(random_state=rng).as_matrix()
    points = surface.points @ turn.T + scale * rng.normal(size=3)
    return SimplexMesh(points, rng.permutation(surface.cells))


def flipped(surface, share, seed):
    rows = np.random.default_rng(seed).random(surface.n_cells) < share
    cells = surface.cells.copy()
    cells[rows, :2] = cells[rows, 1::-1]
    return SimplexMesh(surface.points, cells)


CROSSING = {
    "cubes": ([CUBE, moved(CUBE, 0.5)], 1.875, "bodies 1 and 2 overlap"),
    "sides in common planes": ([CUBE, moved(CUBE, [0.5, 0, 0])], 1.5, "bodies 1 and 2 overlap"),
    "a bar through a cube": (
        [CUBE, box([0.3, 0.3, -0.5], [0.7, 0.7, 1.5])], 1.16, "bodies 1 and 2 overlap",
    ),
    "three in a row": (
        [CUBE, moved(CUBE, [0.7, 0.2, 0.2]), moved(CUBE, [1.4, 0, 0])],
        3.0 - 2 * 0.3 * 0.8 * 0.8, "bodies 1 and 2, 2 and 3 overlap",
    ),
    "on a part of a face": (
        [CUBE, box([1, 0.3, 0.2], [2, 1.4, 1.1])], 1.99, "joined where they share a part of a face",
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "scale"), list(zip(CROSSING, (1.0, 1e-3, 50.0, 1.0, 2.0), strict=True))
)
def test_bodies_become_their_union(name, scale):
    bodies, volume, text = CROSSING[name]
    surface = turned(joined(*bodies), 5 + len(name), scale)
    with pytest.warns(OpenSurfaceWarning, match=text):
        mesh = remesh(surface, 0.25 * scale)
    assert overlapping_cells(mesh) is None
    allowed = 1e-3 * surface.diagonal * 6.0 * len(bodies) * scale**2
    assert abs(mesh.measures.sum() - volume * scale**3) < allowed
    assert check_mesh(mesh, original=surface).is_met


@pytest.mark.parametrize(
    ("bodies", "volume"),
    [
        ([CUBE, box([0.3, 0.3, 0.3], [0.7, 0.7, 0.7])], 1.0),  # one inside the other
        ([CUBE, moved(CUBE, [1.0, 0.0, 0.0])], 2.0),  # a face in common
    ],
)
def test_facets_inside_of_the_solid_are_left_out_with_a_warning(bodies, volume):
    surface = turned(joined(*bodies), 8, 1.0)
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        mesh = remesh(surface, 0.3)
    assert mesh.measures.sum() == pytest.approx(volume, rel=1e-9)
    assert check_mesh(mesh, original=surface).is_met
    texts = [str(found.message) for found in record if found.category is OpenSurfaceWarning]
    assert len(texts) == 1
    assert " facets have the solid on both sides, the largest at " in texts[0]


def test_flipped_facets_change_neither_sizes_nor_prediction_nor_mesh():
    clean = random_sphere(60, 7213)
    sizes, volumes = [], []
    for share in (0.0, 0.3):
        surface = flipped(clean, share, 12)
        size = size_function(surface, hmin=0.6, hmax=0.6)
        sizes.append(size)
        volumes.append(remesh(surface, size).measures.sum())
    one, other = sizes
    assert np.array_equal(one.values, other.values)
    assert other.report.n_elements == pytest.approx(one.report.n_elements, rel=1e-9)
    assert volumes[1] == pytest.approx(volumes[0], rel=5e-3)


def test_flipped_facets_of_a_part_with_a_cavity_do_not_change_the_prediction():
    core = moved(random_sphere(200, 41), 0.0, scale=0.5)
    hollow = joined(random_sphere(300, 42), flipped(core, 1.0, 0))
    numbers = [
        predict(Enclosed(flipped(hollow, share, 3)), lambda x: np.full(len(x), 0.2)).cells
        for share in (0.0, 0.2, 1.0)
    ]
    assert numbers == pytest.approx([numbers[0]] * 3, rel=1e-12)


def test_cells_that_overlap_are_warned_of():
    cubes = joined(block(2), moved(block(2), 0.7))
    with pytest.warns(BoundaryWarning, match="cells overlap others, by a volume of 0.027, one at"):
        warn_of_deviation(cubes, cubes, 1e-3)
