"""Data and groups of Gmsh's files belong to the numbers of nodes and elements, not to places."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, random_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import SimplexMesh, read, write
from adaptsize.errors import InputWarning, MeshFileError

FORMS = ["2.2", "2.2 binary", "4.1", "4.1 binary", "4.0"]


class File:
    """A file of Gmsh in one of its forms, made part by part."""

    def __init__(self, form):
        self.version, _, binary = form.partition(" ")
        self.binary = bool(binary)
        self.content = f"$MeshFormat\n{self.version} {int(self.binary)} 8\n".encode()
        self.content += np.array([1], "<i4").tobytes() + b"\n" if self.binary else b""
        self.content += b"$EndMeshFormat\n"

    def section(self, name, *parts):
        """Append a section of texts, and of pairs of a type and numbers."""
        self.content += f"${name}\n".encode()
        for part in parts:
            if isinstance(part, str):
                self.content += part.encode()
                continue
            kind, values = part
            if self.binary:
                self.content += np.asarray(values, f"<{kind}").tobytes()
            else:
                words = (f"{x:.17g}" if kind == "f8" else f"{x}" for x in np.ravel(values).tolist())
                self.content += (" ".join(words) + "\n").encode()
        self.content += f"{chr(10) if self.binary else ''}$End{name}\n".encode()

    def mesh(self, numbers, points, cells, groups=(5,)):
        """Append nodes and the elements: rows of a number and nodes, all of one entity."""
        dim, n = cells.shape[1] - 2, len(points)
        kind = {2: 2, 3: 4}[dim]
        if self.version.startswith("2"):
            rows = [
                part
                for k, x in zip(numbers, points, strict=True)
                for part in (("i4", [k]), ("f8", x))
            ]
            self.section("Nodes", f"{n}\n", *rows)
            rows = []
            for group in groups:  # repeats the elements
                first = 0 if group == groups[0] else 10**6
                for row in cells:
                    numbers = [row[0] + first, kind, 2, group, 1, *row[1:]]
                    if self.binary:
                        numbers = [kind, 1, 2, row[0] + first, group, 1, *row[1:]]
                    rows.append(("i4", numbers))
            self.section("Elements", f"{len(cells) * len(groups)}\n", *rows)
            return
        box = [0.0] * 6
        counts = [int(d == dim) for d in range(4)]
        self.section(
            "Entities", ("u8", counts), ("i4", [9]), ("f8", box), ("u8", [len(groups)]),
            ("i4", groups), ("u8", [0]),
        )  # fmt: skip
        if self.version == "4.0":
            rows = [
                part
                for k, x in zip(numbers, points, strict=True)
                for part in (("u8", [k]), ("f8", x))
            ]
            self.section("Nodes", ("u8", [1, n]), ("i4", [9, dim, 0]), ("u8", [n]), *rows)
            head = ("u8", [1, len(cells)]), ("i4", [9, dim, kind]), ("u8", [len(cells)])
        else:
            least, most = min(numbers), max(numbers)
            self.section(
                "Nodes", ("u8", [1, n, least, most]), ("i4", [dim, 9, 0]), ("u8", [n]),
                ("u8", numbers), ("f8", points),
            )  # fmt: skip
            least, most = cells[:, 0].min(), cells[:, 0].max()
            head = (
                ("u8", [1, len(cells), least, most]),
                ("i4", [dim, 9, kind]),
                ("u8", [len(cells)]),
            )
        self.section("Elements", *head, ("u8", cells))

    def data(self, kind, name, numbers, values, step=0):
        """Append a section of data; values of ElementNodeData have three dimensions."""
        values = np.asarray(values, float)
        width = 1 if values.ndim == 1 else values.shape[-1]
        rows = []
        for number, own in zip(numbers, values, strict=True):
            rows.append(("i4", [number, len(own)] if kind == "ElementNodeData" else [number]))
            rows.append(("f8", own))
        head = f'1\n"{name}"\n1\n0.5\n3\n{step}\n{width}\n{len(numbers)}\n'
        self.section(kind, head, *rows)


def renumbered(mesh, rng, most=10_000):
    """Numbers for the nodes, and elements with numbers, both with gaps and in no order."""
    numbers = rng.choice(most, mesh.n_points, replace=False) + 1
    elements = rng.choice(most, mesh.n_cells, replace=False) + 1
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
    return numbers, points, np.column_stack([elements, numbers[mesh.cells]])


@given(st.integers(0, 2**32 - 1), st.sampled_from(FORMS), st.sampled_from([2, 3]))
def test_values_belong_to_numbers(tmp_path_factory, seed, form, dim):
    rng = np.random.default_rng(seed)
    mesh = random_square(20, seed) if dim == 2 else jittered_cube(3, seed)
    numbers, points, cells = renumbered(mesh, rng)
    file = File(form)
    file.mesh(numbers, points, cells)
    some, few = rng.permutation(mesh.n_points), rng.permutation(mesh.n_cells)
    file.data("NodeData", "x", numbers[some], mesh.points[some, 0])
    file.data("NodeData", "place", numbers[some], points[some])
    file.data("ElementData", "rank", cells[few, 0], few)
    path = tmp_path_factory.mktemp("gmsh") / "a.msh"
    path.write_bytes(file.content)
    found = read(path)
    assert_array_equal(found.points, mesh.points)
    assert_array_equal(found.cells, mesh.cells)
    assert_array_equal(found.point_data["x"], mesh.points[:, 0])
    assert_array_equal(found.point_data["place"], points)
    assert_array_equal(found.cell_data["rank"], np.arange(mesh.n_cells))
    assert set(found.cell_tags) == {5}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", [5191, 5192])
def test_where_there_is_no_value_is_nan_and_a_warning(tmp_path, form, seed):
    rng = np.random.default_rng(seed)
    mesh = random_square(30, seed)
    numbers, points, cells = renumbered(mesh, rng)
    file = File(form)
    file.mesh(numbers, points, cells)
    some = rng.permutation(mesh.n_points)[:21]
    few = rng.permutation(mesh.n_cells)[:7]
    file.data("NodeData", "x", numbers[some], mesh.points[some, 0])
    file.data("ElementData", "eta", cells[few, 0], 0.5 + few)
    (tmp_path / "a.msh").write_bytes(file.content)
    text = rf"'x' has no value at 9 of 30 nodes .*'eta' has no value at {mesh.n_cells - 7} of"
    with pytest.warns(InputWarning, match=text):
        found = read(tmp_path / "a.msh")
    wanted = np.full(30, np.nan)
    wanted[some] = mesh.points[some, 0]
    assert_array_equal(found.point_data["x"], wanted)
    wanted = np.full(mesh.n_cells, np.nan)
    wanted[few] = 0.5 + few
    assert_array_equal(found.cell_data["eta"], wanted)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("width", [1, 3])
def test_values_at_the_nodes_of_elements_become_their_mean(tmp_path, form, width):
    rng = np.random.default_rng(5193)
    mesh = random_square(25, 5194)
    numbers, points, cells = renumbered(mesh, rng)
    file = File(form)
    file.mesh(numbers, points, cells)
    values = rng.random((mesh.n_cells, 3, width))
    order = rng.permutation(mesh.n_cells)
    file.data("ElementNodeData", "stress", cells[order, 0], values[order])
    (tmp_path / "a.msh").write_bytes(file.content)
    with pytest.warns(InputWarning, match="'stress', given at the nodes of each element, has the"):
        found = read(tmp_path / "a.msh").point_data["stress"]
    for node in range(mesh.n_points):
        wanted = values[mesh.cells == node].mean(axis=0)
        assert_allclose(found[node], wanted[0] if width == 1 else wanted, rtol=1e-14)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
def test_of_several_time_steps_the_last_is_kept(tmp_path, form, order):
    mesh = random_square(12, 5195)
    numbers, points, cells = renumbered(mesh, np.random.default_rng(5196))
    file = File(form)
    file.mesh(numbers, points, cells)
    for step in order:
        file.data("NodeData", "T", numbers, np.full(12, 10.0 * step), step=step)
    (tmp_path / "a.msh").write_bytes(file.content)
    with pytest.warns(InputWarning, match="of the 3 time steps of 'T' the last is kept"):
        assert set(read(tmp_path / "a.msh").point_data["T"]) == {20.0}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("groups", [(5, 2), (2, 5, 7)])
def test_elements_in_several_groups_have_the_first_in_all_versions(tmp_path, form, groups):
    mesh = random_square(12, 5197)
    numbers, points, cells = renumbered(mesh, np.random.default_rng(5198))
    file = File(form)
    file.section("PhysicalNames", '2\n2 5 "a part"\n2 2 "other"\n')
    file.mesh(numbers, points, cells, groups)
    # Data of an element that is listed twice may be given for either.
    file.data("ElementData", "rank", cells[:, 0], np.arange(mesh.n_cells))
    (tmp_path / "a.msh").write_bytes(file.content)
    names = {5: "a part", 2: "other", 7: "7"}
    listed = ", ".join(rf"{names[g]} \({mesh.n_cells}\)" for g in sorted(groups[1:]))
    with pytest.warns(InputWarning, match=f"keep the first; left out are {listed}"):
        found = read(tmp_path / "a.msh")
    assert set(found.cell_tags) == {groups[0]}
    assert found.n_cells == mesh.n_cells
    assert_array_equal(found.cell_data["rank"], np.arange(mesh.n_cells))


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.filterwarnings("ignore::adaptsize.errors.InputWarning")
def test_views_of_gmsh_after_it_renumbered_the_nodes(tmp_path, version, binary):
    gmsh = pytest.importorskip("gmsh")
    file = str(tmp_path / "a.msh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addRectangle(0, 0, 0, 2, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1], 1)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.3)
        gmsh.model.mesh.generate(2)
        old, new = gmsh.model.mesh.computeRenumbering("RCMK")
        gmsh.model.mesh.renumberNodes(old, new)
        tags, points, _ = gmsh.model.mesh.getNodes()
        x = points.reshape(-1, 3)[:, :1]
        elements, nodes = gmsh.model.mesh.getElementsByType(2)
        place = dict(zip(tags.tolist(), x[:, 0].tolist(), strict=True))
        corners = np.array([place[tag] for tag in nodes.tolist()]).reshape(-1, 3)
        middles = corners.mean(axis=1)[:, None]
        for kind, name, numbers, values in [
            ("NodeData", "x", tags, x), ("ElementData", "middle", elements, middles),
            ("ElementNodeData", "x of nodes", elements, corners),
        ]:  # fmt: skip
            view = gmsh.view.add(name)
            gmsh.view.addModelData(view, 0, gmsh.model.getCurrent(), kind, numbers, values)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("PostProcessing.SaveMesh", 0)
        gmsh.write(file)
        for view in gmsh.view.getTags():
            gmsh.view.write(view, file, append=True)
    finally:
        gmsh.finalize()
    mesh = read(file)
    assert_allclose(mesh.point_data["x"], mesh.points[:, 0], atol=1e-14)
    assert_allclose(mesh.point_data["x of nodes"], mesh.points[:, 0], atol=1e-14)
    assert_allclose(mesh.cell_data["middle"], mesh.points[mesh.cells][:, :, 0].mean(1), atol=1e-14)


@pytest.mark.parametrize("parametric", [0, 1])
def test_nodes_may_have_parameters_of_their_entity(tmp_path, parametric):
    more = " 0.5 0.5" * parametric
    rows = "".join(f"{x}{more}\n" for x in ("0 0 0", "1 0 0", "0 1 0"))
    (tmp_path / "a.msh").write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Comments\nof a person\n$EndComments\n"
        f"$Nodes\n1 3 1 3\n2 1 {parametric} 3\n1\n2\n3\n{rows}$EndNodes\n"
        "$Elements\n1 1 1 1\n2 1 2 1\n1 1 2 3\n$EndElements\n"
    )
    assert_array_equal(read(tmp_path / "a.msh").points, [[0, 0], [1, 0], [0, 1]])


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("1 0 0\n", "1 0 x\n", r"a word in \$Nodes that is no number"),
        ("1 0 0\n", "1 0\n", r"fewer numbers in \$Nodes than it promises"),
        ("2 1 2 1\n", "2 1 99 1\n", "elements of Gmsh's type 99"),
        ("1 1 2 3\n$EndE", "1 1 2 7\n$EndE", "an element with node 7, which is not in the file"),
        ("4.1 0 8", "3 0 8", "Gmsh's format 3 as text; 2.2, 4.0 as text and 4.1 can be"),
    ],
)
def test_damage_is_one_line(tmp_path, old, new, reason):
    text = (
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
        "$Nodes\n1 3 1 3\n2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n$EndNodes\n"
        "$Elements\n1 1 1 1\n2 1 2 1\n1 1 2 3\n$EndElements\n"
    )
    assert old in text
    (tmp_path / "a.msh").write_text(text.replace(old, new))
    with pytest.raises(MeshFileError, match=reason):
        read(tmp_path / "a.msh")


def test_negative_tags_are_kept(tmp_path):
    mesh = SimplexMesh(
        [[0, 0], [1, 0], [1, 1], [0, 1]],
        [[0, 1, 2], [0, 2, 3]],
        cell_tags=[-3, 3],
        tagged_facets=[[0, 1], [2, 3]],
        facet_tags=[5, -5],
    )
    write(tmp_path / "a.msh", mesh)
    found = read(tmp_path / "a.msh")
    assert_array_equal(found.cell_tags, [-3, 3])
    assert_array_equal(found.facet_tags, [5, -5])


def test_elements_that_are_points_are_left_out(tmp_path):
    lines = ["1 15 2 3 1 1", "2 2 2 5 1 1 2 3"]
    nodes = "1 0 0 0\n2 1 0 0\n3 0 1 0"
    (tmp_path / "a.msh").write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n{nodes}\n$EndNodes\n"
        f"$Elements\n{len(lines)}\n" + "\n".join(lines) + "\n$EndElements\n"
    )
    with pytest.warns(InputWarning, match=r"1 tagged nodes dropped \(3\)"):
        mesh = read(tmp_path / "a.msh")
    assert_array_equal(mesh.cells, [[0, 1, 2]])
    assert_array_equal(mesh.cell_tags, [5])
