"""Parts anywhere and of any size: generators see them around the origin, with a diagonal of 1."""

import numpy as np
import pytest
from meshes import jittered_square, random_sphere
from numpy.testing import assert_allclose, assert_array_equal
from shapes import block, two_region_block

from adaptsize import SimplexMesh, remesh
from adaptsize.remeshing.preparation import Frame


def moved(mesh, scale=1.0, offset=0.0):
    return SimplexMesh(mesh.points * scale + offset, mesh.cells, cell_tags=mesh.cell_tags)


def test_a_frame_puts_a_part_around_the_origin_and_back():
    mesh = moved(random_sphere(80, 2101), 3e-7, 0.25)
    frame = Frame.around(mesh)
    own = frame.mesh(mesh)
    assert_allclose(own.diagonal, 1.0, rtol=1e-12)
    assert np.abs(own.points).max() <= 0.5 + 1e-9
    assert_array_equal(frame.restored(own, mesh).points, mesh.points)  # those that did not move
    nudged = SimplexMesh(own.points + 1e-3, own.cells)
    assert_allclose(frame.restored(nudged, mesh).points, mesh.points + 1e-3 * mesh.diagonal)
    own_size = frame.size(lambda x: 0.1 * mesh.diagonal + 0.0 * x[:, 0])
    assert_allclose(own_size(own.points), 0.1, rtol=1e-12)


@pytest.mark.parametrize("exponent", [-30, 30])
def test_units_do_not_change_the_mesh(exponent):
    pytest.importorskip("mmgpy")
    mesh = jittered_square(12, 2102)
    new = remesh(mesh, 0.05 * mesh.diagonal, backend="mmg")
    scale = 2.0**exponent
    other = remesh(moved(mesh, scale), 0.05 * scale * mesh.diagonal, backend="mmg")
    assert_array_equal(other.cells, new.cells)
    assert_allclose(other.points, scale * new.points, rtol=1e-12, atol=1e-15 * scale)


@pytest.mark.parametrize("backend", ["mmg", "tetwild"])
def test_a_part_far_from_the_origin_keeps_its_volume(backend):
    if backend == "mmg":
        pytest.importorskip("mmgpy")
    part = block(3) if backend == "mmg" else block(3).boundary().mesh
    far = moved(part, 1.0, 1e6)
    new = remesh(far, 0.3, backend=backend, tolerance=5e-3)
    assert new.measures.sum() == pytest.approx(1.0, rel=0.01)
    assert (new.points >= 1e6 - 0.01).all()
    assert (new.points <= 1e6 + 1.01).all()


def test_corners_and_required_facets_stay_bit_by_bit_far_from_the_origin():
    pytest.importorskip("mmgpy")
    part = moved(two_region_block(3), 1e-3, 12.3)
    facets = part.facets[part.facet_cell_counts == 1][:4]
    new = remesh(part, 3e-4, backend="mmg", required_facets=facets)
    rows = {tuple(x) for x in new.points.tolist()}
    assert all(tuple(x) in rows for x in part.points[np.unique(facets)].tolist())
