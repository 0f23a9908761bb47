"""PLY files with elements, lists and fields of all kinds."""

import struct

import numpy as np
import pytest

from adaptsize import read
from adaptsize.errors import InputWarning, MeshFileError

PLY_OF_ALL_TYPES = """ply
format ascii 1.0
comment by hand
element material 2
property uchar red
property list uchar float weights
element vertex 5
property float nx
property double x
property double y
property double z
property int id
element face 3
property uchar region
property list uchar uint vertex_index
end_header
9 1 0.5
9 2 0.5 0.5
0 0 0 1 10
0 1 0 1 11
0 2 0.5 1 12
0 1 1 1 13
0 0 1 1 14
7 3 0 1 3
8 4 0 1 3 4
6 5 0 1 2 3 4
"""


def as_binary_ply(content, order):
    """Return the bytes of PLY_OF_ALL_TYPES in binary."""
    header, body = content.split("end_header\n")
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    rows = [row.split() for row in body.splitlines()]
    packed = []
    for i, row in enumerate(rows):
        if i < 2:
            packed.append(
                struct.pack(f"{order}BB{row[1]}f", *map(int, row[:2]), *map(float, row[2:]))
            )
        elif i < 7:
            packed.append(struct.pack(f"{order}fdddi", *map(float, row[:4]), int(row[4])))
        else:
            packed.append(struct.pack(f"{order}BB{row[1]}I", *map(int, row)))
    return header.replace("ascii", name).encode() + b"end_header\n" + b"".join(packed)


def test_text_ply_with_elements_lists_and_fields_of_all_kinds_is_read(tmp_path):
    (tmp_path / "a.ply").write_text(PLY_OF_ALL_TYPES)
    with pytest.warns(InputWarning, match="1 quadrilaterals split"):
        mesh = read(tmp_path / "a.ply")
    assert mesh.points.tolist() == [[0, 0, 1], [1, 0, 1], [2, 0.5, 1], [1, 1, 1], [0, 1, 1]]
    cells, tags = mesh.cells.tolist(), mesh.cell_tags.tolist()
    assert cells[0] == [0, 1, 3]
    assert mesh.measures[-3:].sum() == 1.5  # the pentagon
    assert {tuple(sorted(cell)) for cell in cells[1:3]} == {(0, 1, 3), (0, 3, 4)}
    assert tags == [7, 8, 8, 6, 6, 6]
    assert mesh.point_data["id"].tolist() == [10, 11, 12, 13, 14]
    assert mesh.point_data["id"].dtype == np.int32


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_of_triangles_is_read_with_fields_of_nodes_and_faces(tmp_path, order):
    content = PLY_OF_ALL_TYPES.replace("9 2 0.5 0.5", "9 1 0.5")
    content = content.replace("8 4 0 1 3 4", "8 3 1 2 3").replace("6 5 0 1 2 3 4", "6 3 0 3 4")
    (tmp_path / "a.ply").write_bytes(as_binary_ply(content, order))
    mesh = read(tmp_path / "a.ply")
    assert mesh.cells.tolist() == [[0, 1, 3], [1, 2, 3], [0, 3, 4]]
    assert mesh.cell_tags.tolist() == [7, 8, 6]
    assert mesh.point_data["id"].tolist() == [10, 11, 12, 13, 14]


def test_binary_ply_of_polygons_of_different_sizes_is_refused(tmp_path):
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty float z\nelement face 2\n"
        "property list uchar int vertex_index\nend_header\n"
    )
    points = struct.pack("<12f", 0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1)
    faces = struct.pack("<B3i", 3, 0, 2, 1) + struct.pack("<B4i", 4, 0, 1, 2, 3)
    (tmp_path / "a.ply").write_bytes(head.encode() + points + faces)
    with pytest.raises(MeshFileError, match=r"a\.ply: .*cannot be read"):
        read(tmp_path / "a.ply")
