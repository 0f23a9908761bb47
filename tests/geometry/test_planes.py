"""Surfaces in a plane of space: which are, and what they become."""

import numpy as np
import pytest
from command_line import call
from hypothesis import given
from hypothesis import strategies as st
from meshes import random_square

from adaptsize import SimplexMesh, read, remesh, write
from adaptsize.geometry.planes import is_in_plane


def plate(seed):
    """A flat surface anywhere in space, and its normal times its size."""
    rng, flat = np.random.default_rng(seed), random_square(30, seed)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    scale = 10.0 ** rng.uniform(-3, 3)
    points = scale * (np.pad(flat.points, ((0, 0), (0, 1))) @ turn + rng.standard_normal(3))
    return SimplexMesh(points, flat.cells), scale * turn[2]


@given(st.integers(0, 2**32 - 1))
def test_a_surface_is_flat_up_to_rounding_only(seed):
    mesh, normal = plate(seed)
    rng = np.random.default_rng(seed)
    assert is_in_plane(mesh)
    for noise, is_flat in ((1e-10, True), (1e-6, False)):
        moved = mesh.points + noise * rng.choice([-1, 1], (mesh.n_points, 1)) * normal
        assert is_in_plane(mesh.moved(moved)) is is_flat
    bent = mesh.points.copy()
    bent[rng.integers(mesh.n_points)] += 1e-3 * normal
    assert not is_in_plane(mesh.moved(bent))


def test_a_flat_surface_is_remeshed_in_its_plane(tmp_path, capsys):
    pytest.importorskip("mmgpy")
    mesh, normal = plate(91)
    size = 0.2 * np.linalg.norm(normal)
    new = remesh(mesh, size)
    assert (new.cell_dim, new.dim) == (2, 3)
    assert new.measures.sum() == pytest.approx(mesh.measures.sum(), rel=1e-9)
    assert np.ptp(new.points @ normal) < 1e-9 * mesh.diagonal * np.linalg.norm(normal)
    write(tmp_path / "a.vtu", mesh)
    words = ["-o", tmp_path / "b.vtu", "--hmax", size]
    assert call("remesh", tmp_path / "a.vtu", *words) == 0
    assert "the surface lies in a plane: it is remeshed there" in capsys.readouterr().err
    assert read(tmp_path / "b.vtu").measures.sum() == pytest.approx(mesh.measures.sum(), rel=1e-9)
