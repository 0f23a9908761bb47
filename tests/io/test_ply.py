"""PLY files with elements, lists and fields of all kinds."""

import struct

import numpy as np
import pytest

from adaptsize import read
from adaptsize.errors import InputWarning

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
property list uchar float texcoord
end_header
9 1 0.5
9 2 0.5 0.5
0 0 0 1 10
0 1 0 1 11
0 2 0.5 1 12
0 1 1 1 13
0 0 1 1 14
7 3 0 1 3 0
8 4 0 1 3 4 2 0.5 0.5
6 5 0 1 2 3 4 0
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
            n = int(row[1])
            corners, rest = row[: 2 + n], row[2 + n :]
            packed.append(struct.pack(f"{order}BB{n}I", *map(int, corners)))
            packed.append(struct.pack(f"{order}B{rest[0]}f", int(rest[0]), *map(float, rest[1:])))
    return header.replace("ascii", name).encode() + b"end_header\n" + b"".join(packed)


@pytest.mark.parametrize("order", ["ascii", "<", ">"])
def test_ply_elements_lists_and_fields_of_all_kinds_are_read(tmp_path, order):
    file = tmp_path / "a.ply"
    content = PLY_OF_ALL_TYPES
    file.write_bytes(content.encode() if order == "ascii" else as_binary_ply(content, order))
    with pytest.warns(InputWarning, match="1 quadrilaterals split"):
        mesh = read(file)
    assert mesh.points.tolist() == [[0, 0, 1], [1, 0, 1], [2, 0.5, 1], [1, 1, 1], [0, 1, 1]]
    cells, tags = mesh.cells.tolist(), mesh.cell_tags.tolist()
    assert cells[0] == [0, 1, 3]
    assert mesh.measures[-3:].sum() == 1.5  # the pentagon
    assert {tuple(sorted(cell)) for cell in cells[1:3]} == {(0, 1, 3), (0, 3, 4)}
    assert tags == [7, 8, 8, 6, 6, 6]
    assert mesh.point_data["id"].tolist() == [10, 11, 12, 13, 14]
    assert mesh.point_data["id"].dtype == np.int32
