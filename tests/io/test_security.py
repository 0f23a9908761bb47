"""What SECURITY.md says of files, folders and child processes; bombs are in test_bombs.py."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from mesh_files import SQUARE, TWO_TRIANGLES

from adaptsize import SimplexMesh, distributed, read, read_image, write
from adaptsize.errors import MeshFileError

BLOCKS = (
    '<VTKFile type="vtkMultiBlockDataSet" version="1.0"><vtkMultiBlockDataSet>'
    '<DataSet index="0" file="FILE"/></vtkMultiBlockDataSet></VTKFile>'
)
NUMBERS = (
    '<Xdmf Version="3.0"><Domain><Grid><Geometry GeometryType="XYZ"><DataItem DataType="Float" '
    'Dimensions="4 3" Precision="8" Format="Binary">FILE</DataItem></Geometry><Topology '
    'TopologyType="Triangle" NumberOfElements="1"><DataItem DataType="Int" Dimensions="1 3" '
    'Format="XML" Precision="4">0 1 2</DataItem></Topology></Grid></Domain></Xdmf>'
)
SCENE = json.dumps(
    {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "FILE"}],
    }
)


@pytest.fixture
def folder(tmp_path):
    """A folder in another one, both with files."""
    inner = tmp_path / "from a stranger"
    inner.mkdir()
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    for place in (tmp_path, inner):
        write(place / "own.vtu", mesh)
        mesh.to_meshio().write(place / "own.inp")
        np.pad(np.array(SQUARE, float), ((0, 0), (0, 1))).tofile(place / "own.bin")
    return inner


@pytest.mark.parametrize(
    ("name", "text", "own"),
    [
        ("a.vtm", BLOCKS, "own.vtu"),
        ("a.xdmf", NUMBERS, "own.bin"),
        ("a.inp", "*HEADING\n*INCLUDE, INPUT=FILE\n", "own.inp"),
        ("a.gltf", SCENE, "own.bin"),
    ],
)
def test_files_name_others_of_their_own_folder_only(folder, name, text, own):
    escaped = {"a.vtm": "&#46;&#46;/", "a.gltf": "%2e%2e/"}.get(name, "../")
    for place in ("../", "./../", f"{folder.parent}/", escaped):
        (folder / name).write_text(text.replace("FILE", place + own))
        with pytest.raises(MeshFileError, match=r"own\.\w+', which is outside of its folder"):
            read(folder / name)


def test_files_that_name_their_neighbours_are_read(folder):
    (folder / "a.vtm").write_text(BLOCKS.replace("FILE", "own.vtu"))
    assert read(folder / "a.vtm").n_cells == 2


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
def test_a_pipe_that_a_file_names_is_refused_at_once(folder):
    os.mkfifo(folder / "pipe.vtu")
    (folder / "a.vtm").write_text(BLOCKS.replace("FILE", "pipe.vtu"))
    with pytest.raises(MeshFileError, match=r"'pipe\.vtu', which is a device or a pipe"):
        read(folder / "a.vtm")


def test_children_import_nothing_from_the_working_folder(folder):
    stranger = f"open({os.fspath(folder / 'executed')!r}, 'w').close()\n"
    for name in ("adaptsize", "json", "meshio", "numpy", "tempfile", "trimesh", "vtkmodules"):
        (folder / f"{name}.py").write_text(stranger)
    (folder / "own.msh").write_text("$MeshFormat\n")
    code = (
        "import sys; sys.path.remove(''); import os, adaptsize\n"
        "from adaptsize.plot import with_vtk\n"
        "sys.path.insert(0, os.getcwd()); sys.path.insert(0, '')  # as python -m and notebooks do\n"
        "print(adaptsize.read('own.vtu').n_cells, with_vtk._can_draw('vtkNoSuchWindow'))\n"
        "print(adaptsize.read('own.inp').n_cells)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, check=True, text=True
    )
    assert done.stdout.split() == ["2", "False", "2"]
    assert not (folder / "executed").exists()


def test_input_is_never_unpickled(folder):
    class Bad:
        def __reduce__(self):
            return os.mkdir, (os.fspath(folder / "executed"),)

    np.save(folder / "a.npy", np.array([Bad()], dtype=object))
    np.savez(folder / "b.npz", labels=np.array([Bad()], dtype=object))
    (folder / "c.npy").write_bytes(pickle.dumps(Bad()))
    for name in ("a.npy", "b.npz", "c.npy"):
        with pytest.raises(MeshFileError):
            read_image(folder / name)
    assert not (folder / "executed").exists()


HEAVY = (
    '<Xdmf Version="3.0"><Domain><Grid><Geometry GeometryType="XYZ"><DataItem DataType="Float" '
    'Dimensions="3 3" Precision="8" Format="HDF">a.h5:/VTKHDF/Points</DataItem></Geometry>'
    '<Topology TopologyType="Triangle" NumberOfElements="1"><DataItem DataType="Int" '
    'Dimensions="1 3" Format="XML" Precision="4">0 1 2</DataItem></Topology></Grid></Domain></Xdmf>'
)


@pytest.mark.parametrize("reader", ["a.vtkhdf", "a.xdmf", "parts"])
@pytest.mark.parametrize("kind", ["", "link", "storage", "virtual"])
def test_files_of_hdf5_with_data_in_other_files_are_refused(tmp_path, kind, reader):
    name = "a.h5" if reader == "a.xdmf" else "a.vtkhdf"
    write(tmp_path / "own.vtkhdf", SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]))
    (tmp_path / "own.vtkhdf").rename(tmp_path / name)
    (tmp_path / "a.xdmf").write_text(HEAVY)
    with h5py.File(tmp_path / "secret.h5", "w") as other, h5py.File(tmp_path / name, "r+") as file:
        points = file["VTKHDF/Points"][:]
        other["Points"] = points
        if kind:
            del file["VTKHDF/Points"]
        if kind == "link":
            file["VTKHDF/Points"] = h5py.ExternalLink("secret.h5", "Points")
        elif kind == "storage":
            place = [(os.fspath(tmp_path / "secret.h5"), 0, points.nbytes)]
            file.create_dataset("VTKHDF/Points", points.shape, points.dtype, external=place)
        elif kind == "virtual":
            layout = h5py.VirtualLayout(points.shape, points.dtype)
            layout[:] = h5py.VirtualSource("secret.h5", "Points", points.shape)
            file["VTKHDF"].create_virtual_dataset("Points", layout)
    do = distributed.read_parts if reader == "parts" else read
    path = tmp_path / (name if reader == "parts" else reader)
    if kind:
        with pytest.raises(MeshFileError, match="has data 'VTKHDF/Points' in another file of HDF5"):
            do(path)
    else:
        assert do(path).n_cells == 1


#: Each sentence of SECURITY.md that promises something, and the test of it.
PROMISES = {
    "Those packages run in a child process": "io/test_limited.py::test_an_interrupt_ends_the_child",
    "Its processor time is limited to 5 s": "io/"
    "test_bombs.py::test_a_bomb_ends_within_seconds_and_a_gigabyte",
    "Damaged files are refused with one line": "io/test_damaged_files.py::"
    "test_bad_files_give_one_line_that_names_the_file_and_no_noise",
    "External mesh generators run in child processes with a time limit": "remeshing/"
    "test_isolation.py::test_what_a_generator_has_started_ends_with_it",
    "and in temporary directories of their own": "remeshing/"
    "test_isolation.py::test_output_and_files_stay_in_the_child",
    "No child process imports modules from the working folder": "io/test_security.py::"
    "test_children_import_nothing_from_the_working_folder",
    "These are read only from the folder": "io/"
    "test_security.py::test_files_name_others_of_their_own_folder_only",
    "HDF5 files whose data are in other files are refused": "io/test_security.py::"
    "test_files_of_hdf5_with_data_in_other_files_are_refused",
    "Input files are never unpickled": "io/test_security.py::test_input_is_never_unpickled",
}


def test_each_promise_has_a_test():
    root = Path(__file__).parents[2]
    text = " ".join((root / "SECURITY.md").read_text().split())
    for sentence, place in PROMISES.items():
        assert sentence in text
        file, _, name = place.partition("::")
        assert f"def {name}(" in (root / "tests" / file).read_text()
