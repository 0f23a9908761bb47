"""Meshes of Medit and Mmg, text and binary, in all versions of the format."""

import signal

import numpy as np
import pytest
from meshes import jittered_cube, random_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import SimplexMesh, read, write
from adaptsize.errors import MeshFileError


def meshb(mesh, refs, version, order="<", last=None):
    """A binary file as Mmg writes it: positions of the next sections, more keywords, and an end."""
    real, integer, position = {
        1: ("f4", "i4", "i4"), 2: ("f8", "i4", "i4"), 3: ("f8", "i4", "i8"), 4: ("f8", "i8", "i8"),
    }[version]  # fmt: skip
    kind = {2: 6, 3: 8}[mesh.dim]
    sections = [
        (4, [(row, real) for row in mesh.points], np.zeros(mesh.n_points, int)),
        (13, [([k], integer) for k in (1, 2)], None),  # corners
        (kind, [(row + 1, integer) for row in mesh.cells], refs),
        (60, [(np.ones(mesh.dim), real)], None),  # normals
    ]
    content = np.array([1, version], f"{order}i4").tobytes()

    def add(keyword, body):
        nonlocal content
        following = len(content) + 4 + np.dtype(position).itemsize + len(body)
        content += np.array([keyword], f"{order}i4").tobytes()
        content += np.array([following], order + position).tobytes() + body

    add(3, np.array([mesh.dim], f"{order}i4").tobytes())
    for keyword, rows, own in sections:
        body = np.array([len(rows)], order + integer).tobytes()
        for k, (row, of) in enumerate(rows):
            body += np.asarray(row).astype(order + of).tobytes()
            body += b"" if own is None else np.array([own[k]], order + integer).tobytes()
        add(keyword, body)
    end = len(content) + 4 + np.dtype(position).itemsize if last is None else last
    return (
        content
        + np.array([54], f"{order}i4").tobytes()
        + np.array([end], order + position).tobytes()
    )


@pytest.mark.parametrize("version", [1, 2, 3, 4])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("dim", [2, 3])
def test_binary_meshes_of_all_versions(tmp_path, version, order, dim):
    mesh = random_square(20, 5201) if dim == 2 else jittered_cube(3, 5202)
    refs = np.random.default_rng(5203).integers(1, 5, mesh.n_cells)
    (tmp_path / "a.meshb").write_bytes(meshb(mesh, refs, version, order))
    back = read(tmp_path / "a.meshb")
    assert_allclose(back.points, mesh.points, rtol=1e-6 if version == 1 else 0)
    assert_array_equal(back.cells, mesh.cells)
    assert_array_equal(back.cell_tags, refs)
    content = (tmp_path / "a.meshb").read_bytes()
    for n in range(8, len(content), 97):
        (tmp_path / "a.meshb").write_bytes(content[:n])
        with pytest.raises(MeshFileError, match="is truncated"):
            read(tmp_path / "a.meshb")


@pytest.mark.parametrize("last", [0, None])
def test_the_position_after_the_end_is_that_of_the_file_or_0(tmp_path, last):
    mesh = random_square(20, 5204)
    (tmp_path / "a.meshb").write_bytes(meshb(mesh, np.ones(mesh.n_cells, int), 2, last=last))
    assert read(tmp_path / "a.meshb").n_cells == mesh.n_cells


@pytest.fixture
def _interrupts_are_kept():
    """Install Python's handler again: Mmg in this process lets SIGINT end it."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_interrupts_are_kept")
@pytest.mark.parametrize("suffix", [".mesh", ".meshb"])
def test_what_mmg_writes_is_read(tmp_path, suffix):
    mmgpy = pytest.importorskip("mmgpy")
    cube = jittered_cube(3, 5205)
    refs = np.repeat([1, 2], [30, cube.n_cells - 30])
    write(tmp_path / "a.mesh", SimplexMesh(cube.points, cube.cells, cell_tags=refs))
    made = mmgpy.MmgMesh3D(str(tmp_path / "a.mesh"))
    made.remesh(hmax=40.0, verbose=-1)
    made.save(str(tmp_path / f"b{suffix}"))
    back = read(tmp_path / f"b{suffix}")
    assert_allclose(back.points, made.get_vertices(), rtol=1e-12)
    assert_array_equal(back.cells, made.get_tetrahedra())
    assert_array_equal(back.cell_tags, made.get_tetrahedra_with_refs()[1])
    assert set(back.cell_tags) == {1, 2}


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("Triangles 1", "Triangles 2", r"truncated \(promises 2 triangles, holds 1\)"),
        ("0 1 0", "0 x 0", "a word in Vertices that is no number"),
        ("Vertices 3", "Vertices", "no points"),
        ("End", "", "no End"),
        ("Dimension 2", "Dimension", "no number after Dimension"),
    ],
)
def test_damaged_text_is_one_line(tmp_path, old, new, reason):
    text = (
        "MeshVersionFormatted 2 # of a person\nDimension 2\nVertices 3\n0 0 0\n1 0 0\n0 1 0\n"
        "Triangles 1\n1 2 3 4\nEnd\n"
    )
    (tmp_path / "a.mesh").write_text(text)
    assert_array_equal(read(tmp_path / "a.mesh").cell_tags, [4])
    (tmp_path / "a.mesh").write_text(text.replace(old, new))
    with pytest.raises(MeshFileError, match=reason):
        read(tmp_path / "a.mesh")
