"""Files for solvers: numbers, sets, surfaces, the orientation of cells, and cells of order 2."""

import re
from dataclasses import replace

import meshio
import numpy as np
import pytest
from command_line import call
from meshes import jittered_cube, random_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import SimplexMesh, read, write
from adaptsize.errors import InputWarning

#: Corners of the faces S1, S2, ... of Abaqus, as its manual draws them.
FACES = {
    3: ["1 2", "2 3", "3 1"],
    4: ["1 2 3", "1 4 2", "2 4 3", "3 4 1"],
}


def two_regions(dim, seed=5171):
    """A mesh of two regions with its boundary and their interface as tagged facets."""
    mesh = random_square(60, seed) if dim == 2 else jittered_cube(4, seed)
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.0
    tags = np.where(right, 7, 3)
    beside = np.array([tags[(mesh.cell_facets == f).any(axis=1)] for f in range(len(mesh.facets))],
                      dtype=object)  # fmt: skip
    outer = np.array([len(own) == 1 for own in beside])
    between = np.array([len(set(own)) == 2 for own in beside])
    facets = np.concatenate([mesh.facets[outer], mesh.facets[between]])
    facet_tags = np.repeat([1, 2], [outer.sum(), between.sum()])
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(facets))
    facets = rng.permuted(facets[order], axis=1)
    names = {(dim - 1, 1): "skin", (dim - 1, 2): "inner wall", (dim, 3): "3rd part", (dim, 7): "b"}
    return SimplexMesh(
        mesh.points, mesh.cells, cell_tags=tags, tagged_facets=facets,
        facet_tags=facet_tags[order], tag_names=names,
    )  # fmt: skip


def keyword(text, head):
    """The rows of numbers below a keyword."""
    block = text.partition(f"\n{head}\n")[2].partition("\n*")[0]
    return [[word.strip() for word in line.split(",")] for line in block.splitlines()]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_surfaces_of_abaqus_are_the_tagged_facets_seen_from_one_element(tmp_path, dim, order):
    mesh = two_regions(dim)
    write(tmp_path / "a.inp", mesh, order=order)
    text = (tmp_path / "a.inp").read_text()
    kind = {2: f"CPS{3 * order}", 3: f"C3D{4 if order == 1 else 10}"}[dim]
    elements = np.array(keyword(text, f"*ELEMENT, TYPE={kind}, ELSET=Eall"), int)
    assert (elements[:, 0] == np.arange(1, mesh.n_cells + 1)).all()
    corners = elements[:, 1 : dim + 2] - 1
    turned = replace(mesh, cells=corners)
    assert (turned.signed_measures > 0.0).all()
    total = np.zeros(dim)
    for name, tag in (("skin", 1), ("inner_wall", 2)):
        sides = keyword(text, f"*SURFACE, NAME={name}, TYPE=ELEMENT")
        cells = np.array([int(element) - 1 for element, _ in sides])
        local = [np.array(FACES[dim + 1][int(face[1:]) - 1].split(), int) - 1 for _, face in sides]
        facets = np.array([corners[cell][face] for cell, face in zip(cells, local, strict=True)])
        wanted = mesh.tagged_facets[mesh.facet_tags == tag]
        assert_array_equal(np.sort(facets, axis=1), np.sort(wanted, axis=1))
        if tag == 2:  # from the region of the lower tag
            assert set(mesh.cell_tags[cells]) == {3}
        else:  # a pressure on a closed surface has no resultant
            ends = mesh.points[facets]
            normals = (
                np.cross(ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0])
                if dim == 3
                else (ends[:, 1] - ends[:, 0]) @ np.array([[0, -1], [1, 0]])
            )
            total = np.abs(normals.sum(axis=0))
            assert total.max() < 1e-9 * np.abs(normals).sum()
        nodes = np.array(keyword(text, f"*NSET, NSET={name}"), int).ravel() - 1
        assert set(np.unique(wanted)) == {node for node in nodes if node < mesh.n_points}
    assert len(keyword(text, "*ELSET, ELSET=region_3rd_part")) == (mesh.cell_tags == 3).sum()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.filterwarnings("ignore::adaptsize.errors.InputWarning")
def test_regions_and_faces_come_back_from_abaqus(tmp_path, dim, order):
    mesh = two_regions(dim)
    write(tmp_path / "a.inp", mesh, order=order)
    back = read(tmp_path / "a.inp")
    assert_array_equal(np.sort(back.cells, axis=1), np.sort(mesh.cells, axis=1))
    assert back.tag_names == {
        (dim, 1): "region_3rd_part",
        (dim, 2): "b",
        (dim - 1, 1): "skin",
        (dim - 1, 2): "inner_wall",
    }
    assert_array_equal(back.cell_tags, np.where(mesh.cell_tags == 3, 1, 2))
    for tag in (1, 2):
        found, wanted = (
            np.unique(np.sort(m.tagged_facets[m.facet_tags == tag], axis=1), axis=0)
            for m in (back, mesh)
        )
        assert_array_equal(found, wanted)


def test_numbers_for_calculix_have_at_most_20_characters(tmp_path):
    rng = np.random.default_rng(5172)
    points = rng.standard_normal((4000, 3)) * 10.0 ** rng.integers(-9, 9, (4000, 3))
    points[:4] = [[1.0, 0.1, -2.0 / 3.0], [1e-150, -1e-300, 0.0], [0, 1, 0], [0, 0, 3]]
    mesh = SimplexMesh(points, np.arange(4000).reshape(-1, 4))
    write(tmp_path / "a.inp", mesh)
    text = (tmp_path / "a.inp").read_text()
    words = [word for row in keyword(text, "*NODE, NSET=Nall") for word in row]
    assert max(map(len, words)) <= 20
    found = read(tmp_path / "a.inp", keep_slits=True).points
    assert_allclose(found, points, rtol=1e-12, atol=0)
    short = np.array([[len(repr(x)) <= 20 for x in row] for row in points.tolist()])
    assert_array_equal(found[short], points[short])


EDGES = {3: "01 12 20", 4: "01 12 20 03 13 23"}  # whose middles follow the corners


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("suffix", [".inp", ".bdf", ".vtu", ".vtk", ".vtkhdf", ".msh"])
def test_cells_of_order_2_are_straight_and_reduce_to_the_mesh(tmp_path, suffix, dim):
    mesh = replace(two_regions(dim, 5173), tag_names={})  # meshio reads no names in files of VTK
    file = tmp_path / f"a{suffix}"
    fields = {} if suffix in (".inp", ".bdf") else {"x": mesh.points[:, 0]}
    write(file, mesh, order=2, fields=fields)
    with pytest.warns(InputWarning, match="of higher order reduced to their corners"):
        back = read(file)
    assert_allclose(back.points, mesh.points, atol=1e-9 * mesh.diagonal)
    assert_array_equal(np.sort(back.cells, axis=1), np.sort(mesh.cells, axis=1))
    if suffix not in (".inp", ".bdf", ".vtkhdf"):
        held = meshio.read(file)
        nodes = next(block.data for block in held.cells if block.type in ("triangle6", "tetra10")
                     and len(block.data) == mesh.n_cells)  # fmt: skip
        points = held.points[nodes][:, :, :dim]
        for middle, (a, b) in enumerate(EDGES[dim + 1].split(), start=dim + 1):
            mean = 0.5 * (points[:, int(a)] + points[:, int(b)])
            assert_allclose(points[:, middle], mean, atol=1e-9 * mesh.diagonal)
        assert len(held.points) == mesh.n_points + len(mesh.edges)
    if fields and suffix != ".vtkhdf":
        assert_allclose(held.point_data["x"], held.points[:, 0], atol=1e-12 * mesh.diagonal)


def test_nastran_continues_an_element_of_ten_nodes_on_a_second_line(tmp_path):
    mesh = SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]], cell_tags=[4])
    write(tmp_path / "a.bdf", mesh, order=2)
    text = (tmp_path / "a.bdf").read_text()
    card = text[text.index("CTETRA") : text.index("ENDDATA")].splitlines()
    fields = [card[0][k : k + 8].strip() for k in range(0, 80, 8)]
    assert fields[:7] == ["CTETRA", "1", "4", "1", "2", "3", "4"]
    assert (fields[9], card[1][:8].strip()) == ("+", "+")
    middles = [*fields[7:9], *card[1][8:].split()]
    assert sorted(map(int, middles)) == [5, 6, 7, 8, 9, 10]
    found = re.findall(r"GRID\*\s+(\d+)\s+(\S+)\s+(\S+)\n\*\s+(\S+)", text)
    nodes = {int(n): np.array(place, float) for n, *place in found}
    for number, (a, b) in zip(middles, EDGES[4].split(), strict=True):
        assert_allclose(nodes[int(number)], 0.5 * (nodes[int(a) + 1] + nodes[int(b) + 1]))


@pytest.mark.parametrize("suffix", [".su2", ".stl", ".mesh", ".ply", ".vtp", ".xdmf"])
def test_formats_without_cells_of_order_2_refuse_them(tmp_path, suffix):
    mesh = two_regions(2)
    with pytest.raises(ValueError, match=r"holds no cells of order 2; write \.vtu, .*\.inp"):
        write(tmp_path / f"a{suffix}", mesh, order=2)
    with pytest.raises(ValueError, match="order must be at most 2"):
        write(tmp_path / "a.vtu", mesh, order=3)


@pytest.mark.parametrize("dim", [2, 3])
def test_nodes_of_abaqus_elements_of_order_2_are_in_the_order_of_its_manual(tmp_path, dim):
    mesh = two_regions(dim, 5174)
    write(tmp_path / "a.inp", mesh, order=2)
    text = (tmp_path / "a.inp").read_text()
    points = np.array(keyword(text, "*NODE, NSET=Nall"), float)[:, 1:]
    kind = {2: "CPS6", 3: "C3D10"}[dim]
    nodes = np.array(keyword(text, f"*ELEMENT, TYPE={kind}, ELSET=Eall"), int)[:, 1:] - 1
    for middle, (a, b) in enumerate(EDGES[dim + 1].split(), start=dim + 1):
        mean = 0.5 * (points[nodes[:, int(a)]] + points[nodes[:, int(b)]])
        assert_allclose(points[nodes[:, middle]], mean, atol=1e-12 * mesh.diagonal)


def test_shells_have_sets_but_no_surfaces(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 1, 1]]
    shell = SimplexMesh(
        points, [[0, 1, 2], [0, 2, 3]], tagged_facets=[[0, 1]], facet_tags=[5], cell_tags=[1, 2]
    )
    write(tmp_path / "a.inp", shell, order=2)
    text = (tmp_path / "a.inp").read_text()
    assert "TYPE=S6, ELSET=Eall" in text
    assert len(keyword(text, "*NSET, NSET=boundary5")) == 3  # with the middle
    assert "*SURFACE" not in text


def test_the_command_writes_cells_of_order_2(tmp_path, capsys):
    pytest.importorskip("mmgpy")
    square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    write(tmp_path / "a.vtu", square)
    words = ["remesh", tmp_path / "a.vtu", "--hmax", "0.5", "--order", "2", "-o"]
    assert call(*words, tmp_path / "b.inp") == 0
    assert "TYPE=CPS6" in (tmp_path / "b.inp").read_text()
    capsys.readouterr()
    assert call(*words, tmp_path / "b.su2") == 2
    assert "b.su2 holds no cells of order 2" in capsys.readouterr().err
