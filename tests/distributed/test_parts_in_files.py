"""Distributed meshes in files: PVTU, partitioned meshes of Gmsh, and files of one piece."""

from pathlib import Path

import numpy as np
import pytest
from simulated_ranks import SimulatedCommunicator

from adaptsize import SimplexMesh, read, write
from adaptsize.background.migration import NODE_NUMBERS
from adaptsize.distributed.files import read_parts, write_parts
from adaptsize.errors import MeshFileError

DATA = Path(__file__).parent / "data"


def _gathered(path, n_ranks):
    """Return the mesh in a file, and the numbers of cells of the parts."""
    parts = SimulatedCommunicator.run(n_ranks, lambda comm: _with_whole(read_parts(path, comm)))
    return parts[0][1], [part.n_cells for part, _ in parts]


def _with_whole(part):
    return part, part.gather()


@pytest.mark.parametrize("name", ["split.msh", "partitioned.msh"])
@pytest.mark.parametrize("n_ranks", [1, 2, 3])
def test_partitions_of_gmsh(name, n_ranks):
    whole, n_cells = _gathered(DATA / name, n_ranks)
    assert (whole.n_points, whole.n_cells, whole.dim) == (98, 162, 2)
    assert whole.measures.sum() == pytest.approx(1.0, abs=1e-12)
    assert len(whole.boundary().cells) == 32  # no gap between the partitions
    assert (whole.cell_tags == 5).all()
    assert whole.tag_names == {(1, 6): "wall", (2, 5): "plate"}
    # The group "wall" is the side y = 0 of the square.
    on_wall = (whole.points[whole.tagged_facets, 1] < 1e-12).all(axis=1)
    assert on_wall.all()
    assert len(on_wall) == 8
    assert n_cells == {1: [162], 2: [81, 81], 3: [81, 81, 0]}[n_ranks]


def test_one_process_merges_the_partitions_in_a_file():
    mesh, part = read(DATA / "partitioned.msh"), read_parts(DATA / "partitioned.msh").mesh
    for name in ("points", "cells", "cell_tags", "tagged_facets", "facet_tags"):
        assert np.array_equal(getattr(mesh, name), getattr(part, name))
    assert mesh.tag_names == part.tag_names
    assert read(DATA / "split_1.msh").n_cells == 81


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("4.1 0 8", "4 0 8", "must therefore be a text file of version 4.1"),
        ("$EndPartitionedEntities", "", "is truncated"),
        ("$EndElements", "", "is truncated"),
    ],
)
def test_other_and_damaged_partitioned_files_are_one_error(tmp_path, old, new, text):
    path = tmp_path / "a.msh"
    path.write_text((DATA / "partitioned.msh").read_text().replace(old, new))
    with pytest.raises(MeshFileError, match=rf"a\.msh: [^\n]*{text}"):
        read(path)


def test_damaged_partition_is_reported_by_all_ranks(tmp_path):
    text = (DATA / "split_2.msh").read_text()
    (tmp_path / "a_1.msh").write_text((DATA / "split_1.msh").read_text())
    (tmp_path / "a_2.msh").write_text(text[: text.index("$Elements") + 200])
    with pytest.raises(MeshFileError, match=r"rank 1: .*a_2\.msh.*elements"):
        _gathered(tmp_path / "a.msh", 2)


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


@pytest.mark.parametrize("n_read", [1, 2, 5])
def test_pvtu_is_read_as_written(tmp_path, n_read):
    mesh = _cube(4)
    path = tmp_path / "mesh.pvtu"
    write(tmp_path / "whole.vtu", mesh)

    def save(comm):
        part = read_parts(tmp_path / "whole.vtu", comm)
        return write_parts(path, part, fields={"h0": part.points[:, 2] + 1.0})

    files = SimulatedCommunicator.run(3, save)[1]
    assert [file.name for file in files] == ["mesh.pvtu"] + [f"mesh_000{r}.vtu" for r in range(3)]
    whole, _ = _gathered(path, n_read)
    assert (whole.n_points, whole.n_cells) == (mesh.n_points, mesh.n_cells)
    assert np.array_equal(whole.points, mesh.points)  # the numbers of nodes are kept
    centres = whole.points[whole.cells].mean(axis=1)
    assert np.array_equal(whole.cell_tags, 1 + (centres[:, 0] > 0.5))
    assert whole.cell_data["u"] == pytest.approx(centres[:, 1], abs=1e-15)
    assert np.array_equal(whole.point_data["h0"], whole.points[:, 2] + 1.0)
    assert {tuple(sorted(f)) for f in whole.tagged_facets.tolist()} == {
        tuple(sorted(f)) for f in mesh.tagged_facets.tolist()
    }


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
    (tmp_path / "m.pvtu").write_text(
        '<VTKFile><PUnstructuredGrid><Piece Source="a.vtu"/><Piece Source="b.vtu"/>'
        "</PUnstructuredGrid></VTKFile>"
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
