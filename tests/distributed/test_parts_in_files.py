"""Distributed meshes in files: VTKHDF, PVTU, and files of one piece."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_ranks import SimulatedCommunicator
from vtkmodules.util.numpy_support import vtk_to_numpy

from adaptsize import SimplexMesh, read, write
from adaptsize.background.migration import NODE_NUMBERS
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.files import read_parts, write_parts
from adaptsize.errors import MeshFileError


def _gathered(path, n_ranks):
    """Return the mesh in a file, and the numbers of cells of the parts."""
    parts = SimulatedCommunicator.run(n_ranks, lambda comm: _with_whole(read_parts(path, comm)))
    return parts[0][1], [part.n_cells for part, _ in parts]


def _with_whole(part):
    return part, part.gather()


def _cube(n):
    axes = np.meshgrid(*[np.linspace(0.0, 1.0, n)] * 3, indexing="ij")
    from scipy.spatial import Delaunay

    rng = np.random.default_rng(31407)
    points = np.stack(axes, axis=-1).reshape(-1, 3) + 0.02 * rng.random((n**3, 3))
    mesh = SimplexMesh(points, Delaunay(points).simplices)
    x = points[mesh.cells].mean(axis=1)
    boundary = mesh.boundary()
    facets = boundary.nodes[boundary.mesh.cells][:40]
    return SimplexMesh(
        points,
        mesh.cells,
        cell_tags=1 + (x[:, 0] > 0.5),
        tagged_facets=facets,
        facet_tags=np.full(len(facets), 7),
        cell_data={"u": x[:, 1]},
    )


@pytest.mark.parametrize(("n_written", "n_read"), [(2, 4), (4, 2), (3, 1)])
def test_one_file_of_all_ranks_is_read_as_written(tmp_path, n_written, n_read, monkeypatch):
    mesh = replace(_cube(4), tag_names={(3, 1): "ä b", (2, 7): "skin"})
    path = tmp_path / "mesh.vtkhdf"
    write(tmp_path / "whole.vtu", mesh)

    def save(comm):
        part = read_parts(tmp_path / "whole.vtu", comm)
        return write_parts(path, part, fields={"h0": part.points[:, 2] + 1.0})

    with monkeypatch.context() as patch:
        patch.delattr(PartitionedMesh, "gather")  # no rank holds the whole mesh
        assert SimulatedCommunicator.run(n_written, save) == [path] * n_written
    assert sorted(file.name for file in tmp_path.iterdir()) == ["mesh.vtkhdf", "whole.vtu"]
    whole, n_cells = _gathered(path, n_read)
    assert sum(n > 0 for n in n_cells) == min(n_read, n_written)
    for found in (whole, read(path)):
        assert np.array_equal(found.points, mesh.points)  # the numbers of nodes are kept
        assert {tuple(cell) for cell in np.sort(found.cells).tolist()} == {
            tuple(cell) for cell in np.sort(mesh.cells).tolist()
        }
        centres = found.points[found.cells].mean(axis=1)
        assert np.array_equal(found.cell_tags, 1 + (centres[:, 0] > 0.5))
        assert found.cell_data["u"] == pytest.approx(centres[:, 1], abs=1e-15)
        assert np.array_equal(found.point_data["h0"], found.points[:, 2] + 1.0)
        assert {tuple(sorted(f)) for f in found.tagged_facets.tolist()} == {
            tuple(sorted(f)) for f in mesh.tagged_facets.tolist()
        }
        assert found.tag_names == mesh.tag_names


def test_the_reader_of_vtk_finds_the_parts_of_all_ranks(tmp_path):
    from vtkmodules.vtkIOHDF import vtkHDFReader

    write(tmp_path / "whole.vtu", _cube(3))
    path = tmp_path / "mesh.vtkhdf"
    parts = SimulatedCommunicator.run(4, lambda comm: _written(path, tmp_path / "whole.vtu", comm))
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.Update()
    found = reader.GetOutputDataObject(0)
    assert found.GetNumberOfPartitions() == 4
    for rank, part in enumerate(parts):
        own = found.GetPartition(rank)
        assert np.array_equal(vtk_to_numpy(own.GetPoints().GetData()), part.points)
        ids = vtk_to_numpy(own.GetPointData().GetArray(NODE_NUMBERS))
        assert np.array_equal(ids, part.global_ids)
        assert own.GetNumberOfCells() == part.n_cells + len(part.mesh.tagged_facets)


def _written(path, source, comm):
    part = read_parts(source, comm)
    write_parts(path, part)
    return part


def test_a_file_in_turn_is_written_completely_or_not_at_all(tmp_path, monkeypatch):
    write(tmp_path / "whole.vtu", _cube(3))
    path = tmp_path / "mesh.vtkhdf"
    path.write_text("old")

    def save(comm):
        part = read_parts(tmp_path / "whole.vtu", comm)
        write_parts(path, part, fields={"a/b" if comm.rank == 1 else "ab": np.ones(part.n_points)})

    with pytest.raises(ValueError, match=r"rank 1: .*cannot hold the name 'a/b'"):
        SimulatedCommunicator.run(2, save)
    assert path.read_text() == "old"
    with pytest.raises(ValueError, match="no directory"):
        SimulatedCommunicator.run(2, lambda c: _written(tmp_path / "x" / path.name,
                                                        tmp_path / "whole.vtu", c))  # fmt: skip
    assert sorted(file.name for file in tmp_path.iterdir()) == ["mesh.vtkhdf", "whole.vtu"]


def _list_pieces(path, names, arrays=""):
    pieces = "".join(f'<Piece Source="{name}"/>' for name in names)
    path.write_text(
        '<VTKFile type="PUnstructuredGrid" version="0.1" byte_order="LittleEndian">'
        f'<PUnstructuredGrid GhostLevel="0">{arrays}<PPoints><PDataArray type="Float64" '
        f'Name="Points" NumberOfComponents="3"/></PPoints>{pieces}</PUnstructuredGrid></VTKFile>'
    )


def test_pieces_without_numbers_are_joined_by_coordinates(tmp_path):
    mesh = _cube(4)
    pieces = []
    for number, own in enumerate(np.array_split(np.arange(mesh.n_cells), 2)):
        nodes, local = np.unique(mesh.cells[own], return_inverse=True)
        piece = SimplexMesh(mesh.points[nodes], local.reshape(-1, 4))
        write(tmp_path / f"p{number}.vtu", piece)
        pieces.append(f"p{number}.vtu")
    _list_pieces(tmp_path / "a.pvtu", pieces)
    whole, _ = _gathered(tmp_path / "a.pvtu", 2)
    assert (whole.n_points, whole.n_cells) == (mesh.n_points, mesh.n_cells)
    assert len(whole.boundary().cells) == len(mesh.boundary().cells)
    piece = tmp_path / "p1.vtu"
    piece.write_bytes(piece.read_bytes()[:-30])
    for do in (read, lambda path: _gathered(path, 2)):
        with pytest.raises(MeshFileError, match=r"names p1\.vtu: is truncated"):
            do(tmp_path / "a.pvtu")


def test_ghost_cells_are_left_out(tmp_path):
    square = SimplexMesh(
        [[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]], cell_data={"vtkGhostType": [0, 1]}
    )
    write(tmp_path / "a.vtu", square, fields={NODE_NUMBERS: np.arange(4)})
    write(
        tmp_path / "b.vtu",
        square.with_data(cell_data={"vtkGhostType": [1, 0]}),
        fields={NODE_NUMBERS: np.arange(4)},
    )
    _list_pieces(
        tmp_path / "m.pvtu",
        ["a.vtu", "b.vtu"],
        f'<PPointData><PDataArray type="Int64" Name="{NODE_NUMBERS}"/></PPointData>'
        '<PCellData><PDataArray type="UInt8" Name="vtkGhostType"/></PCellData>',
    )
    whole, n_cells = _gathered(tmp_path / "m.pvtu", 2)
    assert n_cells == [1, 1]
    assert whole.n_points == 4


def test_gathered_output(tmp_path):
    write(tmp_path / "whole.vtu", _cube(3))

    def save(comm):
        part = read_parts(tmp_path / "whole.vtu", comm)
        write_parts(tmp_path / "out.vtu", part, fields={"h": part.points[:, 0] + 1.0})

    SimulatedCommunicator.run(2, save)
    made = read(tmp_path / "out.vtu")
    assert np.array_equal(made.point_data["h"], made.points[:, 0] + 1.0)
