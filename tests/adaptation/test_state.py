"""The state of a loop in a file: what goes on is the same to the last bit."""

import numpy as np
import pytest
from meshes import jittered_cube, jittered_square
from numpy.testing import assert_array_equal

from adaptsize import ElementField, SimplexMesh, adapt
from adaptsize.adaptation import LoopState
from adaptsize.errors import MeshFileError
from adaptsize.remeshing.driver import Remeshed

SEED = 52119


def tagged(mesh):
    rng = np.random.default_rng(SEED)
    facets = mesh.facets[mesh.facet_cell_counts == 1]
    return SimplexMesh(
        mesh.points, mesh.cells, cell_tags=rng.integers(1, 3, mesh.n_cells),
        tagged_facets=facets, facet_tags=rng.integers(1, 4, len(facets)),
        tag_names={(mesh.cell_dim, 1): "left/right", (mesh.cell_dim - 1, 3): "Wände"},
        point_data={"a/b": rng.normal(size=(mesh.n_points, 2))},
        cell_data={"rank": np.arange(mesh.n_cells)},
    )  # fmt: skip


def assert_same(one, other):
    for name in ("points", "cells", "cell_tags", "tagged_facets", "facet_tags"):
        assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.tag_names == other.tag_names
    for kind in ("point_data", "cell_data"):
        held, found = getattr(one, kind), getattr(other, kind)
        assert list(held) == list(found)
        for name, values in held.items():
            assert_array_equal(found[name], values)
            assert found[name].dtype == values.dtype


def test_mesh_and_fields_come_back(tmp_path):
    mesh = tagged(jittered_square(5, SEED))
    values = np.exp(1j * ElementField.nodes(mesh, 2))
    fields = {
        "b": np.arange(mesh.n_points),
        "a/b": ElementField(values, 2),
        "q": ElementField.at_points(
            np.tile(np.eye(2), (mesh.n_cells, 1, 1, 1)), [[1 / 3, 1 / 3]], [0.5], log=True
        ),
    }
    LoopState(mesh, fields, {"c": mesh.measures > 1.0}).write(tmp_path / "s")
    found = LoopState.read(tmp_path / "s")
    assert [path.name for path in tmp_path.iterdir()] == ["s"]
    assert_same(mesh, found.mesh)
    assert set(found.fields) == set(fields)
    assert_array_equal(found.fields["b"], fields["b"])
    assert_array_equal(found.fields["a/b"].values, values)
    assert (found.fields["a/b"].order, found.fields["a/b"].continuous) == (2, True)
    assert (found.fields["q"].log, found.fields["q"].values.shape) == (
        True,
        (mesh.n_cells, 1, 2, 2),
    )
    assert_array_equal(found.cell_fields["c"], mesh.measures > 1.0)


def test_a_loop_goes_on_with_its_first_mesh(tmp_path, monkeypatch):
    first, second = (tagged(jittered_cube(n, SEED, half_width=1.0)) for n in (3, 4))
    monkeypatch.setattr(
        "adaptsize.adaptation.new_mesh.trial", lambda *a, **k: Remeshed(second, None)
    )
    monkeypatch.setattr("adaptsize.remeshing.protocol.find_spec", lambda package: True)
    options = {"h0": 0.6, "enough": 1.1, "backend": "mmg", "boundary_tolerance": 0.3}
    result = adapt(first, fields={"x": first.points}, **options)
    LoopState(result.mesh, result.fields).write(tmp_path / "loop.npz")
    found = LoopState.read(tmp_path / "loop.npz")
    assert_same(result.mesh, found.mesh)
    assert_array_equal(found.fields["x"], result.fields["x"])
    assert_same(adapt(found.mesh, **options).original, first)
    unknown = SimplexMesh(result.mesh.points, result.mesh.cells)
    assert adapt(unknown, **options).original is unknown


def test_what_a_file_cannot_keep_is_refused(tmp_path):
    mesh = jittered_square(4, SEED)
    for field in (lambda x: x, ElementField(lambda x: x)):
        with pytest.raises(ValueError, match=r"fields\['u'\] must be values, which a file keeps"):
            LoopState(mesh, {"u": field}).write(tmp_path / "s")
    assert not list(tmp_path.iterdir())
    (tmp_path / "s").write_bytes(b"no state")
    with pytest.raises(MeshFileError, match="is not the state of an adaptive loop"):
        LoopState.read(tmp_path / "s")
    np.savez(tmp_path / "other.npz", points=mesh.points)
    with pytest.raises(MeshFileError, match="is not the state of an adaptive loop"):
        LoopState.read(tmp_path / "other.npz")
    with pytest.raises(MeshFileError, match=r"none\.npz: No such file"):
        LoopState.read(tmp_path / "none.npz")
    with pytest.raises(MeshFileError, match="there is no directory"):
        LoopState(mesh).write(tmp_path / "none" / "s")


def test_damaged_files_raise_one_error(tmp_path):
    mesh = tagged(jittered_square(3, SEED))
    path, rng = tmp_path / "s.npz", np.random.default_rng(SEED)
    LoopState(mesh, {"u": ElementField(mesh.points)}).write(path)
    whole = path.read_bytes()
    with np.load(path) as held:
        content = dict(held)
    for name, value in (
        ("layout", np.array(["x"])),
        ("mesh/tag_names", np.array("[[1, 2]]")),
        ("mesh/tag_names", np.array("3")),
        ("mesh/cells", np.array(3)),
    ):
        np.savez(path, **{**content, name: value})
        with pytest.raises(MeshFileError, match="is not the state of an adaptive loop"):
            LoopState.read(path)
    n_refused = 0
    for _ in range(300):
        data = bytearray(whole)
        data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        path.write_bytes(data[: rng.integers(len(data))] if rng.random() < 0.2 else data)
        try:
            LoopState.read(path)
        except MeshFileError:
            n_refused += 1
    assert n_refused > 200
