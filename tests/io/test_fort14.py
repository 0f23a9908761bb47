"""fort.14 and hgrid.gr3: triangles with a depth, as ADCIRC and SCHISM read them."""

import numpy as np
import pytest
from meshes import random_sphere, random_square
from numpy.testing import assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh, read, write
from adaptsize.errors import InputWarning, MeshFileError

# Numbers of nodes with gaps and in any order, and lists of boundaries after the elements.
FOREIGN = b"""A lake
2 4
10  0.0 0.0 5.5
30  1.0 1.0 7.5
20  1.0 0.0 6.5
40  0.0 1.0 -1.0
1 3 10 20 30
2 3 10 30 40
1 = Number of open boundaries
2 = Total number of open boundary nodes
2 = Number of nodes for open boundary 1
10
20
0 = Number of land boundaries
0 = Total number of land boundary nodes
"""


@pytest.mark.parametrize("name", ["fort.14", "hgrid.gr3", "lake.grd"])
def test_points_cells_and_depths_come_back_to_the_last_bit(tmp_path, name):
    mesh = random_square(50, 2)
    depth = np.random.default_rng(0).normal(size=mesh.n_points)
    with pytest.warns(InputWarning, match="the mesh has no tagged facets, so no boundaries$"):
        write(tmp_path / name, mesh.with_data(point_data={"depth": depth}))
    back = read(tmp_path / name)
    assert_array_equal(back.points, mesh.points)
    assert_array_equal(back.cells, mesh.cells)
    assert_array_equal(back.point_data["depth"], depth)


def test_boundaries_are_open_land_or_islands_by_name_and_come_back(tmp_path):
    # Nine squares without the one in the middle; the left side is the sea.
    grid = CartesianGrid([0.0, 0.0], 1.0, (4, 4)).mesh
    middle = grid.points[grid.cells].mean(axis=1)
    ring = SimplexMesh(grid.points, grid.cells[(np.abs(middle - 1.5) > 0.5).any(axis=1)])
    boundary = ring.boundary()
    facets = boundary.nodes[boundary.mesh.cells]
    at = ring.points[facets].mean(axis=1)
    tags = np.where(at[:, 0] == 0.0, 1, np.where((np.abs(at - 1.5) < 1.0).all(axis=1), 3, 2))
    names = {(1, 1): "open sea", (1, 2): "land", (1, 3): "island"}
    options = {"tagged_facets": facets, "facet_tags": tags, "tag_names": names}
    with pytest.warns(
        InputWarning, match=r"the mesh has no depth \(the nodal field 'depth'\), 0 is written$"
    ):
        write(tmp_path / "fort.14", SimplexMesh(ring.points, ring.cells, **options))
    lines = (tmp_path / "fort.14").read_text().splitlines()
    first = lines.index("1 = number of open boundaries")
    assert lines[first + 1] == "4 = total number of open boundary nodes"
    assert lines[first + 2] == "4 = number of nodes for open boundary 1: open sea"
    nodes = np.array(lines[first + 3 : first + 7], int) - 1
    assert_array_equal(ring.points[nodes], [[0, 3], [0, 2], [0, 1], [0, 0]])  # domain to the left
    assert lines[first + 7] == "2 = number of land boundaries"
    # The mainland is of type 0 and ends where the sea begins; an island, of type 1, is closed.
    found = {line.split(": ")[1]: line.split(" =")[0] for line in lines[first + 8 :] if ":" in line}
    assert found == {"land": "10 0", "island": "4 1"}
    back = read(tmp_path / "fort.14")
    ends = back.points[back.tagged_facets]
    lengths = np.bincount(back.facet_tags, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    assert {name: lengths[tag] for (_, tag), name in back.tag_names.items()} == {
        "open sea": 3.0, "land": 9.0, "island": 4.0,
    }  # fmt: skip


def test_files_of_other_programs(tmp_path):
    (tmp_path / "fort.14").write_bytes(FOREIGN)
    mesh = read(tmp_path / "fort.14")
    assert_array_equal(mesh.points, [[0, 0], [1, 1], [1, 0], [0, 1]])
    assert_array_equal(mesh.cells, [[0, 2, 1], [0, 1, 3]])
    assert_array_equal(mesh.point_data["depth"], [5.5, 7.5, 6.5, -1.0])


def test_a_cut_before_the_last_element_is_noticed(tmp_path):
    whole = FOREIGN.index(b"1 = Number")
    for end in range(whole):
        (tmp_path / "cut.14").write_bytes(FOREIGN[:end])
        with pytest.raises(MeshFileError):
            read(tmp_path / "cut.14")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"1 3 10 20 30", b"1 4 10 20 30", "no triangles"),
        (b"1 3 10 20 30", b"1 3 10 20 50", "which is not in the file"),
        (b"0.0 0.0 5.5", b"0.0 0.0", "line with 3 numbers, where 4 are required"),
        (b"7.5", b"deep", "holds b?'deep' where float64 is required"),
    ],
)
def test_damaged_files_are_refused(tmp_path, old, new, message):
    (tmp_path / "fort.14").write_bytes(FOREIGN.replace(old, new))
    with pytest.raises(MeshFileError, match=message):
        read(tmp_path / "fort.14")


def test_only_plane_triangles_can_be_written(tmp_path):
    with pytest.raises(ValueError, match=r"fort\.14 holds triangles in the plane, got"):
        write(tmp_path / "fort.14", CartesianGrid((0, 0, 0), 1.0, (2, 2, 2)).mesh)
    assert list(tmp_path.iterdir()) == []


def weirs(ibtype, pairs):
    """A strip of squares with a wall of nodes in pairs in its middle, as a list of a type."""
    points = [(x, y) for x in (0, 1) for y in range(4)] + [(x, y) for x in (1, 2) for y in range(4)]
    nodes = "".join(f"{k} {x} {y} 5\n" for k, (x, y) in enumerate(points, 1))
    cells = [(a, b, c) for first in (1, 9) for k in range(first, first + 3)
             for a, b, c in ((k, k + 4, k + 5), (k, k + 5, k + 1))]  # fmt: skip
    elements = "".join(f"{k} 3 {a} {b} {c}\n" for k, (a, b, c) in enumerate(cells, 1))
    rows = [f"{a} {b} 3.5 1.0 1.0" if pairs else f"{a} 3.5 1.0"
            for a, b in zip(range(5, 9), range(9, 13), strict=True)]  # fmt: skip
    lists = f"1\n2\n2\n1\n2\n2\n{len(rows) + 2}\n2 20\n13\n14\n{len(rows)} {ibtype}\n"
    return f"weirs\n{len(cells)} {len(points)}\n{nodes}{elements}{lists}" + "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("ibtype", "name"),
    [(3, "barrier"), (13, "barrier"), (23, "barrier"), (4, "weir"), (24, "weir"), (25, "weir"),
     (2, "river"), (22, "river"), (20, "land"), (0, "land")],
)  # fmt: skip
def test_barriers_and_rivers_are_kept_apart_from_land(tmp_path, ibtype, name):
    pairs = name == "weir"
    (tmp_path / "fort.14").write_text(weirs(ibtype, pairs))
    mesh = read(tmp_path / "fort.14")
    named = {held: tag for (_, tag), held in mesh.tag_names.items()}
    assert set(named) == {"open", "land", name}
    if name == "land":
        return
    edges = mesh.tagged_facets[mesh.facet_tags == named[name]]
    wanted = [[4, 5], [5, 6], [6, 7]] + [[8, 9], [9, 10], [10, 11]] * pairs
    assert_array_equal(edges, wanted)
    if name == "river":
        write(tmp_path / "again.14", mesh)
        assert "4 22 = number of nodes for land" in (tmp_path / "again.14").read_text()
    else:
        with pytest.raises(ValueError, match=f"cannot hold '{name}': barriers have heights"):
            write(tmp_path / "again.14", mesh)


def test_a_mesh_without_depth_and_boundaries_draws_one_warning(tmp_path):
    text = r"no depth \(the nodal field 'depth'\), 0 is written and no tagged facets, so no bound"
    with pytest.warns(InputWarning, match=text):
        write(tmp_path / "a.14", random_square(20, 5241))


def test_a_view_of_a_surface_draws_a_warning(tmp_path):
    surface = random_sphere(30, 5242)
    with pytest.warns(InputWarning, match="sizes on the surface only, none inside"):
        write(tmp_path / "a.pos", surface, fields={"h": np.ones(30)})
