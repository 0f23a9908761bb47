"""What SECURITY.md says of files, folders and child processes; bombs are in test_bombs.py."""

import json
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from mesh_files import SQUARE, TWO_TRIANGLES

from adaptsize import SimplexMesh, read, read_image, write
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
