"""Damaged, truncated and foreign files: read completely, or refused with one clear line."""

import contextlib
import os
import sys

import meshio
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from stl_files import ASCII_STL, binary_stl

from adaptsize import SimplexMesh, read, read_image, read_size, write
from adaptsize.errors import MeshFileError

# 13 nodes: the last number of a file may lose a digit and still be that of a node.
POINTS = np.vstack([np.eye(4, 3), [[2, i, 1.5] for i in range(9)]])
FACES = [[0, 1, 2], [0, 1, 3], [1, 4, 5], [9, 10, 12]]
TETRAHEDRA = [[0, 1, 2, 3], [1, 2, 3, 4], [4, 6, 7, 8], [4, 10, 11, 12]]

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="pipes with a path")


PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header"
)
NASTRAN = (
    b"BEGIN BULK\nGRID           1              0.      0.      0.\n"
    b"GRID           2%8s      1.      0.      0.\n"
    b"GRID           3              0.      1.      0.\n"
    b"CTRIA3         1       1       1       2       3\nENDDATA\n"
)
QUAD = "QUAD\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n4 0 1 2 3\n"
BAD_FILES = {
    "empty.stl": (b"", "is empty"),
    "garbage.stl": (b"this is not a mesh\n" * 20, "neither a text STL file nor a binary"),
    "none.stl": (binary_stl([]), "no cells|no points"),
    "cut.stl": (
        binary_stl(np.ones((9, 3, 3)))[:-60],
        r"truncated binary STL file \(promises 9 triangles\)",
    ),
    "cut_word.stl": (ASCII_STL[:200].encode(), "no endsolid"),
    "blah.stl": (ASCII_STL.replace("1.0e0 1 1", "1 blah 1").encode(), "not three numbers .*'blah'"),
    "corner.stl": (ASCII_STL.replace("1.0e0 1 1", "1").encode(), "not three numbers"),
    "nan.stl": (ASCII_STL.replace("1.0e0 1 1", "nan 1 1").encode(), "point 3 is not finite"),
    "system.bdf": (NASTRAN % b"       1", r"coordinate systems \(CP of GRID\)"),
    "free.bdf": (
        (NASTRAN % b"").replace(b"GRID    ", b"GRID,4,12,0.,0.,0.\nGRID    ", 1),
        "CP of GRID",
    ),
    "include.bdf": (b"INCLUDE 'a.bdf'\n" + NASTRAN % b"", "has INCLUDE"),
    "points.ply": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        b"property float z\nend_header\n0 0 0\n",
        "holds no faces",
    ),
    "same.stl": (binary_stl(np.ones((3, 3, 3))), "contain a node twice"),
    "nan.off": (b"OFF\n3 1 0\n0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n", "point 1 is not finite"),
    "index.off": (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", r"has nodes \[0, 1, 3\]"),
    "negative.off": (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", r"has nodes \[0, 1, -1\]"),
    "points.obj": (b"v 0 0 0\nv 1 0 0\n", "no cells"),
    "few.off": (
        QUAD.replace("QUAD", "OFF # by hand\n4 2 0").encode(),
        "promises 2 faces, holds 1",
    ),
    "few.ply": (
        QUAD.replace("QUAD", PLY).encode(),
        r"truncated \(promises 2 face records, holds 1\)",
    ),
    "garbage.ply": (b"ply\nformat nonsense\n", "cannot be read"),
    "no_points.su2": (b"NDIME= 2\nNELEM= 1\n5 0 1 2\n", "holds no points"),
    "comment.su2": (b"NDIME= 2\n% NPOIN= 3\nNELEM= 1\n5 0 1 2\n", "holds no points"),
    "garbage.vtu": (b"<VTKFile><unclosed></VTKFile>", "cannot be read"),
    "garbage.msh": (b"$MeshFormat\n9.9 0 8\n$EndMeshFormat\n", "cannot be read"),
    "no_end.mesh": (b"MeshVersionFormatted 2\nDimension 3\nVertices\n5\n0 0 0", "no End"),
    "garbage.meshb": (b"\x01\x00\x00\x00\x09", "truncated"),
    "parts.msh": (
        b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PartitionedEntities\n$EndPartitionedEntities\n",
        "has partitions of Gmsh.*unpartition",
    ),
    "other.msh": (b"(1 (an Ansys file))", "MeshFormat"),
    "square.wkt": (b"TIN (((0 0 0, 1 0 0, 0 1 0, 0 0 0", r"knows \(\.wkt\).*meshio convert"),
    "tecplot.dat": (b"TITLE = x\n", r"knows \(\.dat\)"),
    "labels.png": (b"anything", "holds an image, not a mesh; mesh_image or 'adaptsize image'"),
    "notes.txt": (b"hello", r"suffix that no reader knows \(\.txt\)"),
    "nosuffix": (b"hello", "suffix that no reader knows"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_bad_files_give_one_line_that_names_the_file_and_no_noise(tmp_path, capfd, name):
    content, wanted = BAD_FILES[name]
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(MeshFileError, match=wanted) as caught:
        read(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    assert capfd.readouterr() == ("", "")


def test_missing_files_and_directories_are_refused(tmp_path):
    with pytest.raises(MeshFileError, match=r"absent\.stl: No such file"):
        read(tmp_path / "absent.stl")
    with pytest.raises(MeshFileError, match="is a directory"):
        read(tmp_path)


# ---------------------------------------------------------------- cut at every byte


def by_meshio(file_format, cells="triangle", fields=False, **options):
    """Return a function that writes the file that all cuts are made from."""

    def make(file):
        of_type = {"triangle": FACES, "tetra": TETRAHEDRA}[cells]
        point_data = {"h": POINTS[:, 1]} if fields else None
        cell_data = {"rank": [np.arange(4.0)]} if fields else None
        mesh = meshio.Mesh(POINTS, [(cells, of_type)], point_data=point_data, cell_data=cell_data)
        with contextlib.redirect_stdout(None), contextlib.redirect_stderr(None):
            meshio.write(file, mesh, file_format=file_format, **options)

    return make


def by_write(file):
    write(file, SimplexMesh(POINTS, TETRAHEDRA, point_data={"h": POINTS[:, 1] + 0.25}))


def by_trimesh(file):
    import trimesh

    trimesh.Trimesh(POINTS, FACES, process=False).export(file)


def stl_text(file):
    file.write_text(ASCII_STL)


def stl_binary(file):
    file.write_bytes(binary_stl(POINTS[FACES]))


WHOLE_FILES = {
    "a.off": by_meshio("off"),
    "text.ply": by_meshio("ply", fields=True, binary=False),
    "binary.ply": by_meshio("ply", fields=True),
    "text.stl": stl_text,
    "binary.stl": stl_binary,
    "a.su2": by_meshio("su2", "tetra"),
    "text.vtk": by_meshio("vtk42", fields=True, binary=False),
    "cells.vtk": by_meshio("vtk42", "tetra", binary=False),
    "binary.vtk": by_meshio("vtk42", "tetra", fields=True),
    "new.vtk": by_meshio("vtk51", "tetra", fields=True, binary=False),
    "text.vtu": by_meshio("vtu", binary=False),
    "binary.vtu": by_meshio("vtu", fields=True),
    "text2.msh": by_meshio("gmsh22", binary=False),
    "binary2.msh": by_meshio("gmsh22", "tetra"),
    "text4.msh": by_meshio("gmsh", "tetra", binary=False),
    "binary4.msh": by_meshio("gmsh"),
    "a.mesh": by_meshio("medit", "tetra"),
    "a.meshb": by_meshio("medit"),
    "a.xdmf": by_write,
    "a.bdf": by_meshio("nastran"),
    "a.glb": by_trimesh,
}


@pytest.mark.parametrize("name", WHOLE_FILES)
@pytest.mark.filterwarnings("ignore::adaptsize.errors.InputWarning")
def test_a_file_cut_at_any_byte_is_refused_or_read_completely(tmp_path, name):
    file = tmp_path / name
    WHOLE_FILES[name](file)
    content, whole = file.read_bytes(), read(file)
    n_complete = 0
    start = len(content) - 250  # to save time: each byte of the end, some of the rest
    for n in [*range(0, start, 13), *range(max(start, 0), len(content))]:
        file.write_bytes(content[:n])
        try:
            part = read(file)
        except MeshFileError as error:
            assert len(str(error)) < 400, n  # noqa: PT017 - most cuts raise
            continue
        n_complete += 1
        assert_array_equal(part.points, whole.points)
        assert_array_equal(part.cells, whole.cells)
        fields = {field: len(values) for field, values in part.point_data.items()}
        assert fields in ({}, {field: whole.n_points for field in whole.point_data}), n
    assert n_complete < 30  # the end mark, and sections after the mesh


@pytest.mark.parametrize(
    "name", ["a.off", "text.stl", "a.su2", "text.vtk", "text2.msh", "a.mesh", "a.bdf"]
)
def test_a_text_may_begin_with_a_byte_order_mark_and_have_line_ends_of_windows(tmp_path, name):
    file = tmp_path / name
    WHOLE_FILES[name](file)
    whole, content = read(file, keep_slits=True), file.read_bytes()  # some nodes hang
    file.write_bytes(b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"))
    found = read(file, keep_slits=True)
    assert_array_equal(found.points, whole.points)
    assert_array_equal(found.cells, whole.cells)


def test_the_type_of_the_last_cell_is_not_completed(tmp_path):
    file, quad = tmp_path / "a.vtk", meshio.Mesh(POINTS, [("quad", np.array([[0, 1, 2, 3]]))])
    meshio.write(file, quad, file_format="vtk42")
    content = file.read_bytes().rstrip(b"\n")
    file.write_bytes(content[:-1])  # with a line break instead, it is a tetrahedron
    with pytest.raises(MeshFileError, match=r"truncated|cannot be read"):
        read(file)


def test_an_open_second_solid_is_refused(tmp_path):
    facet = ASCII_STL[ASCII_STL.index("facet") : ASCII_STL.index("endsolid")]
    (tmp_path / "a.stl").write_text(f"{ASCII_STL}solid second\n{facet}")
    with pytest.raises(MeshFileError, match="no endsolid"):
        read(tmp_path / "a.stl")


@pytest.mark.parametrize(
    ("name", "last_line"), [("a.obj", "f 2 3 1"), ("a.inp", "4, 2, 3, 1"), ("a.off", "3 2 3 1")]
)
def test_a_last_number_that_may_lack_digits_is_refused(tmp_path, name, last_line):
    file = tmp_path / name
    by_meshio({"a.obj": "obj", "a.inp": "abaqus", "a.off": "off"}[name])(file)
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:-1], last_line]))
    with pytest.raises(MeshFileError, match=r"ends inside a line, after '1', .*add a line break"):
        read(file)
    file.write_text("\n".join([*lines[:-1], last_line, ""]))
    assert read(file).n_cells == 4
    file.write_text("\n".join([*lines[:-1], last_line[:-1] + "4"]))  # there is no node 40
    assert read(file).n_cells == 4


# ---------------------------------------------------------------- other faults


@posix_only
@pytest.mark.parametrize("reader", [read, read_size, read_image])
@pytest.mark.parametrize("suffix", [".stl", ".vti", ".png"])
def test_pipes_are_refused_at_once(tmp_path, reader, suffix):
    pipe = tmp_path / f"pipe{suffix}"
    os.mkfifo(pipe)  # opening it would wait for a writer
    with pytest.raises(MeshFileError, match="is a device or a pipe"):
        reader(pipe)


@pytest.mark.parametrize(
    "content",
    [
        b"solid x\nvertex 1 2 x" + b" " * 10**6 + b"x\n",
        b"solid x\n" + b"\n" * 10**6 + b"vertex 1 2 3\n" * 3 + b"endfacet\n",
        b"solid x\n" + b"vertex 1 2 3\n" * 10**5 + b"vertex " + b"1" * 10**6 + b" 1 1\n",
        b"solid x\n" * 10**5 + b"vertex 1 2 3\n" * 3 + b"endfacet\n",
    ],
    ids=["spaces", "empty lines", "long word", "many solids"],
)
def test_no_text_makes_the_stl_reader_slow(tmp_path, content):
    # With the square of the length, this would take until the time limit of the tests.
    (tmp_path / "a.stl").write_bytes(content)
    with pytest.raises(MeshFileError, match=r"STL|vertices|promises|points"):
        read(tmp_path / "a.stl")
