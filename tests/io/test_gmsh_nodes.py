"""Gmsh files whose nodes have large numbers."""

import meshio
import numpy as np
import pytest

from adaptsize import read

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
CELLS = [("triangle", [[0, 1, 2], [1, 3, 2]])]


def with_number(folder, form, binary, number):
    """Write two triangles, the last node of which has another number."""
    path = folder / "mesh.msh"
    if form == "gmsh40":
        path.write_text(
            "$MeshFormat\n4.0 0 8\n$EndMeshFormat\n$Nodes\n1 4\n1 2 0 4\n"
            f"1 0 0 0\n2 1 0 0\n3 0 1 0\n{number} 1 1 0\n$EndNodes\n"
            f"$Elements\n1 2\n1 2 2 2\n1 1 2 3\n2 2 {number} 3\n$EndElements\n"
        )
        return path
    mesh = meshio.Mesh(POINTS, CELLS)
    meshio.write(path, mesh, file_format=form, binary=binary)
    content = path.read_bytes()
    if binary:
        old, new = (np.array([n], "<u8").tobytes() for n in (4, number))
        head, begin, rest = content.partition(b"$Nodes\n")
        numbers = rest.index(np.arange(1, 4, dtype="<u8").tobytes()) + 24
        assert rest[numbers : numbers + 8] == old
        rest = rest[:numbers] + new + rest[numbers + 8 :]
        old, new = (np.array([2, n, 3], "<u8").tobytes() for n in (4, number))
        assert rest.count(old) == 1
        content = head + begin + rest.replace(old, new)
    elif form == "gmsh22":
        content = content.replace(b"\n4 1.0", b"\n%d 1.0" % number).replace(
            b" 2 4 3\n", b" 2 %d 3\n" % number
        )
    else:
        content = content.replace(b"\n4\n0.0", b"\n%d\n0.0" % number).replace(
            b" 2 4 3", b" 2 %d 3" % number
        )
    assert binary or str(number).encode() in content
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("number", [123_456, 2_000_000_000])
@pytest.mark.parametrize(
    ("form", "binary"), [("gmsh22", False), ("gmsh40", False), ("gmsh", False), ("gmsh", True)]
)
def test_numbers_with_gaps_are_read(form, binary, number, tmp_path):
    mesh = read(with_number(tmp_path, form, binary, number))
    assert mesh.n_points == 4
    assert mesh.measures.sum() == pytest.approx(1.0)
