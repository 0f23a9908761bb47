"""Input files as Abaqus/CAE, CalculiX and people write them."""

import pytest
from numpy.testing import assert_array_equal

from adaptsize import read
from adaptsize.errors import InputWarning, MeshFileError

PART = """*Part, name={0}
*Node
1, {1}., 0., 0.
2, {2}., 0., 0.
** a comment inside a list
3, {1}., 1., 0.
4, {1}., 0., 1.
*Element, type=C3D4H
7, 1, 2, 3, 4
*Elset, elset=_inner, generate
1, 9000000000, 1
*Elset, elset="Set {0}"
_inner
*Solid Section, elset="set {0}", material=steel
,
*End Part
"""
ASSEMBLY = """*Assembly, name=Assembly
*Instance, name=A-1, part=a
*End Instance
*Instance, name=A-2, part=A
10., 0., 0.
*End Instance
*Instance, name=B-1, part=B
*End Instance
*Elset, elset=load, instance=A-1
7
*End Assembly
"""
FLAT = """*HEADING
*NODE, NSET=all
1, 0., 0.
2, 1., 0.,
*NODE
30, , 1.
*node
4, 1., 1.
*NODE PRINT
U
*ELEMENT, TYPE=CPE3, ELSET=left
1, 1, 2, 30
** a comment
*ELEMENT, ELSET=right,
 TYPE=cax3
2, 2, 4,
   30
*ELSET, ELSET=both
left, right
*NSET, NSET=bottom
1, 2
"""


def test_parts_are_repeated_for_each_instance_and_sections_are_regions(tmp_path):
    file = tmp_path / "job.inp"
    file.write_text("*Heading\n" + PART.format("A", 0, 1) + PART.format("B", 5, 7) + ASSEMBLY)
    mesh = read(file)
    assert_array_equal(mesh.points[::4, 0], [0.0, 10.0, 5.0])
    assert_array_equal(mesh.measures * 6.0, [1.0, 1.0, 2.0])
    assert [mesh.tag_names[3, tag] for tag in mesh.cell_tags] == ["Set A", "Set A", "Set B"]


def test_lists_of_nodes_are_one_and_sets_of_sets_are_no_regions(tmp_path):
    file = tmp_path / "flat.inp"
    file.write_text(FLAT)
    mesh = read(file)
    assert_array_equal(mesh.points, [[0, 0], [1, 0], [0, 1], [1, 1]])
    assert_array_equal(mesh.cells, [[0, 1, 2], [1, 3, 2]])
    assert [mesh.tag_names[2, tag] for tag in mesh.cell_tags] == ["left", "right"]


def test_an_included_file_is_a_part_of_the_text(tmp_path):
    nodes, elements = FLAT.split("*ELEMENT", 1)
    (tmp_path / "nodes ü.inp").write_text(nodes)
    (tmp_path / "a.inp").write_text(f"*INCLUDE, input=nodes ü.inp\n*ELEMENT{elements}")
    assert read(tmp_path / "a.inp").n_cells == 2


@pytest.mark.parametrize(
    "more",
    {
        "MASS": "*ELEMENT, TYPE=MASS, ELSET=m\n50, 1\n51, 2\n*MASS, ELSET=m\n1.\n",
        "SPRINGA": "*ELEMENT, TYPE=SPRINGA, ELSET=s\n50, 1, 4\n51, 30, 4\n*SPRING, ELSET=s\n\n9.\n",
        "CONN3D2": "*ELEMENT, TYPE=CONN3D2\n50, 1, 4\n51, , 4\n",
        "DASHPOTA": "*ELEMENT, TYPE=DASHPOTA, ELSET=d\n50, 1, 4\n51, 2, 4\n",
    }.items(),
)
def test_elements_that_are_no_cells_are_left_out_and_counted(tmp_path, more):
    kind, text = more
    (tmp_path / "a.inp").write_text(FLAT + text)
    with pytest.warns(InputWarning, match=f"elements that are not cells left out: 2 {kind}$"):
        mesh = read(tmp_path / "a.inp")
    assert_array_equal(mesh.cells, [[0, 1, 2], [1, 3, 2]])
    assert [mesh.tag_names[2, tag] for tag in mesh.cell_tags] == ["left", "right"]


@pytest.mark.parametrize("kind", ["B31", "B31H", "PIPE31", "T3D2"])
def test_beams_beside_shells_and_membranes_are_cells_of_one_dimension_less(tmp_path, kind):
    nodes = "*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 1., 1., 0.5\n"
    cells = (
        "*ELEMENT, TYPE=M3D3, ELSET=skin\n1, 1, 2, 3\n*ELEMENT, TYPE=S3R, ELSET=skin\n2, 2, 4, 3\n"
    )
    beam = f"*ELEMENT, TYPE={kind}, ELSET=rim\n9, 1, 2\n"
    (tmp_path / "a.inp").write_text(nodes + cells + beam)
    mesh = read(tmp_path / "a.inp")
    assert_array_equal(mesh.cells, [[0, 1, 2], [1, 3, 2]])
    assert_array_equal(mesh.tagged_facets, [[0, 1]])
    assert set(mesh.tag_names.values()) == {"skin", "rim"}


@pytest.mark.parametrize("section", ["", "*SOLID SECTION, ELSET=Eall, MATERIAL=steel\n"])
def test_the_set_of_all_elements_is_no_region_beside_others(tmp_path, section):
    everything = "*ELSET, ELSET=Eall\n1, 2\n"
    flat = FLAT.replace("*ELSET, ELSET=both", everything + "*ELSET, ELSET=both")
    (tmp_path / "a.inp").write_text(flat + section)
    mesh = read(tmp_path / "a.inp")
    assert [mesh.tag_names[2, tag] for tag in mesh.cell_tags] == ["left", "right"]


@pytest.mark.parametrize("where", ["part", "assembly"])
def test_surfaces_of_elements_are_tagged_facets(tmp_path, where):
    part, assembly = (
        PART.format("A", 0, 1),
        ASSEMBLY.replace("B-1, part=B\n", "A-3, part=A\n5., 0., 0.\n"),
    )
    if where == "part":  # of three instances
        part = part.replace(
            "*End Part", "*Surface, type=ELEMENT, name=Top\n_inner, S2\n7, S3\n*End Part"
        )
    else:  # of one: the set is made by the assembly
        assembly = assembly.replace(
            "*End Assembly", "*Surface, name=Top\nload, S2\nload, S3\n*End Assembly"
        )
    (tmp_path / "a.inp").write_text(part + assembly)
    mesh = read(tmp_path / "a.inp")
    assert mesh.tag_names[2, 1] == "Top"
    first = [[0, 3, 1], [1, 3, 2]]
    wanted = [[n + 4 * k for n in row] for k in range(3) for row in first]
    assert_array_equal(mesh.tagged_facets, wanted if where == "part" else first)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (FLAT.replace("*NSET", "*ELGEN"), r"the keyword \*ELGEN"),
        (FLAT.replace("NSET=all", "SYSTEM=C"), r"the keyword \*NODE"),
        (FLAT.replace("30\n", "31\n"), "node 31, which is not in the file"),
        (FLAT.replace("CPE3", "XYZ3"), "elements of type 'XYZ3'"),
        (FLAT.replace("   30", "   30, 5"), "CAX3 of other than 3 nodes"),
        (FLAT + "*INCLUDE, INPUT=a.inp\n", "includes 'a.inp' twice"),
        (FLAT + "*INCLUDE, INPUT=absent.inp\n", "'absent.inp', which does not exist"),
        (PART.format("A", 0, 1) + ASSEMBLY.replace("0.\n", "0.\n0., 0., 0., 0., 0., 1., 9.\n"),
         "rotated instance"),
        (PART.format("A", 0, 1) + ASSEMBLY.replace("0.\n", "0., 0.\n"), "not three numbers"),
        (PART.format("A", 0, 1) + ASSEMBLY, "instance of the part 'B', which it does not hold"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused(tmp_path, text, reason):
    (tmp_path / "a.inp").write_text(text)
    with pytest.raises(MeshFileError, match=reason) as caught:
        read(tmp_path / "a.inp")
    assert "\n" not in str(caught.value)
