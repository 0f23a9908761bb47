"""Files as other programs write them."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adaptsize import read
from adaptsize.errors import InputWarning, MeshFileError

VTU_PIECE = """<Piece NumberOfPoints="3" NumberOfCells="1"><Points>
<DataArray type="Float64" NumberOfComponents="3" format="ascii">{}</DataArray></Points><Cells>
<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">3</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">{}</DataArray></Cells>
<PointData><DataArray type="Float64" Name="h" format="ascii">1 2 3</DataArray></PointData>
</Piece>"""


def write_vtu_pieces(file, *pieces):
    file.write_text(
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian">'
        f"<UnstructuredGrid>{''.join(pieces)}</UnstructuredGrid></VTKFile>"
    )
    return file


def test_vtk_cells_of_unknown_types_are_refused_not_left_out(tmp_path):
    piece = VTU_PIECE.format("0 0 0 1 0 0 0 1 0", 99)
    with pytest.raises(MeshFileError, match="VTK type 99"):
        read(write_vtu_pieces(tmp_path / "odd.vtu", piece))


def test_gmsh_2_files_repeat_elements_for_each_group_and_the_first_is_kept(tmp_path):
    file = tmp_path / "groups.msh"
    file.write_text(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 1 1 0\n"
        "$EndNodes\n$Elements\n4\n1 2 2 5 1 1 2 3\n2 2 2 6 1 1 2 3\n3 1 2 4 1 1 2\n"
        "4 2 2 6 2 2 4 3\n$EndElements\n"
    )
    with pytest.warns(
        InputWarning, match=r"several physical groups keep the first; left out are 6 \(1\)"
    ):
        mesh = read(file)
    assert_array_equal(mesh.cells, [[0, 1, 2], [1, 3, 2]])
    assert_array_equal(mesh.cell_tags, [5, 6])
    assert_array_equal(mesh.facet_tags, [4])


def test_medit_files_have_required_triangles_and_counts_in_the_line_of_a_keyword(tmp_path):
    file = tmp_path / "a.mesh"
    file.write_text(
        "MeshVersionFormatted 2\nDimension 3\nVertices 4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n"
        "RequiredTriangles\n1\n1\n\nTetrahedra\n1\n1 2 3 4 7\nTriangles 1\n1 2 3 5\n"
        "RequiredEdges 2\n1\n2\nEdges\n1\n1 2 0\nEnd\n"
    )
    mesh = read(file)
    assert_array_equal(mesh.cell_tags, [7])
    assert_array_equal(mesh.facet_tags, [5])


def test_su2_markers_keep_their_names_and_numbers(tmp_path):
    file = tmp_path / "a.su2"
    markers = ["7", "lower wall", "8", "far"]  # meshio counts on from 7
    lines = "".join(f"MARKER_TAG= {name}\nMARKER_ELEMS= 1\n3 {i} {(i + 1) % 4}\n"
                    for i, name in enumerate(markers))  # fmt: skip
    file.write_text(
        "NDIME= 2\nNELEM= 2\n5 0 1 2 0\n5 0 2 3 1\nNPOIN= 4\n0 0 0\n1 0 1\n1 1 2\n0 1 3\n"
        f"NMARK= 4\n{lines}"
    )
    mesh = read(file)
    assert_array_equal(mesh.facet_tags, [7, 1, 8, 2])
    assert mesh.tag_names == {(1, 1): "lower wall", (1, 2): "far"}


@pytest.mark.parametrize("of_line", ["1 11", "0"])
def test_gmsh_4_files_give_physical_groups(tmp_path, of_line):
    file = tmp_path / "groups.msh"
    file.write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
        f"$Entities\n0 1 1 0\n1 0 0 0 1 0 0 {of_line} 0\n1 0 0 0 1 1 0 1 22 0\n$EndEntities\n"
        "$Nodes\n1 3 1 3\n2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n$EndNodes\n"
        "$Elements\n2 2 1 2\n1 1 1 1\n1 1 2\n2 1 2 1\n2 1 2 3\n$EndElements\n"
    )
    mesh = read(file)
    assert_array_equal(mesh.cell_tags, [22])
    if of_line == "1 11":
        assert_array_equal(mesh.tagged_facets, [[0, 1]])
        assert_array_equal(mesh.facet_tags, [11])


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3 4",
        "f 1//1 2//1 3//1\nf 1//1 3//1 4//1",
        "f -4 -3 -2\nf -4 -2 -1",
        "f 1/1 2/2 3/3\nf 1/2 3/1 4/1",  # texture seam: still one node per corner
    ],
)
@pytest.mark.filterwarnings("ignore::adaptsize.errors.InputWarning")
def test_obj_faces_in_all_spellings_give_the_same_surface(tmp_path, faces):
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 1\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n"
    file = tmp_path / "square.obj"
    file.write_text(f"# comment\no square\n{corners}{faces}\n")
    mesh = read(file)
    assert mesh.n_points == 4
    assert mesh.n_cells == 2
    assert mesh.measures.sum() == pytest.approx(np.sqrt(2), rel=1e-14)


def test_off_with_comments_colours_and_polygons_is_read(tmp_path):
    file = tmp_path / "square.off"
    file.write_text(
        "COFF # by hand\n5 1 0\n0 0 1 9 9 9\n1 0 1 9 9 9 # corner\n2 0.5 1 9 9 9\n"
        "1 1 1 9 9 9\n0 1 1 9 9 9\n5 0 1 2 3 4 0.5 0.5 0.5\n"
    )
    with pytest.warns(InputWarning, match="1 polygons split into 3 triangles"):
        mesh = read(file)
    assert {2} < set(mesh.cells.ravel().tolist())
    assert mesh.n_cells == 3
    assert mesh.measures.sum() == 1.5
