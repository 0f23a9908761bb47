"""Metrics in files: round trips, the order of entries, and damaged files."""

import re
import struct

import numpy as np
import pytest
from shapes import block, two_region_rectangle

import adaptsize as ads
from adaptsize import Metric, MetricFunction
from adaptsize.errors import MeshFileError

MESHES = {"plane": two_region_rectangle(2), "tetrahedra": block(1), "surface": None}
MESHES["surface"] = MESHES["tetrahedra"].boundary().mesh


def random_metric(mesh, seed=1123):
    rng = np.random.default_rng(seed)
    directions = np.linalg.qr(rng.standard_normal((mesh.n_points, mesh.dim, mesh.dim)))[0]
    return Metric(10.0 ** rng.uniform(-3, 0, (mesh.n_points, mesh.dim)), directions)


@pytest.mark.parametrize("suffix", [".sol", ".vtu", ".vtk", ".xdmf", ".msh"])
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_a_metric_comes_back_as_it_was_written(tmp_path, mesh, suffix):
    metric = random_metric(mesh)
    file = tmp_path / f"part{suffix}"
    ads.write(file, MetricFunction(mesh, metric))
    back = ads.read_metric(file)
    # Condition numbers up to 1e6: sizes are recovered to 1e-16 times that.
    assert back.sizes == pytest.approx(metric.sizes, rel=1e-9)
    assert back.matrices == pytest.approx(metric.matrices, rel=1e-12, abs=1e-6)


def test_paraview_finds_nine_components_and_the_lengths(tmp_path):
    mesh = MESHES["plane"]
    metric = random_metric(mesh)
    ads.write(tmp_path / "part.vtu", MetricFunction(mesh, metric))
    fields = ads.read(tmp_path / "part.vtu").point_data
    assert fields["metric"].shape == fields["metric.lengths"].shape == (mesh.n_points, 9)
    lengths = fields["metric.lengths"].reshape(-1, 3, 3)
    assert lengths[:, :2, :2] == pytest.approx(metric.lengths)
    assert (lengths[:, 2] == 0.0).all()
    assert (lengths[:, :, 2] == 0.0).all()


def test_vtk_reads_the_field_as_tensors(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    mesh = MESHES["tetrahedra"]
    metric = random_metric(mesh)
    ads.write(tmp_path / "part.vtu", MetricFunction(mesh, metric))
    array = pyvista.read(tmp_path / "part.vtu").point_data["metric"]
    assert array.reshape(-1, 3, 3) == pytest.approx(metric.matrices)


@pytest.mark.parametrize(
    ("mesh", "generator"), [("plane", "MmgMesh2D"), ("tetrahedra", "MmgMesh3D")]
)
def test_mmg_reads_the_entries_in_the_same_order(tmp_path, mesh, generator):
    mmgpy = pytest.importorskip("mmgpy")
    mesh = MESHES[mesh]
    metric = random_metric(mesh)
    ads.write(tmp_path / "part.sol", MetricFunction(mesh, metric))
    theirs = getattr(mmgpy, generator)()
    cells = {2: "triangles", 3: "tetrahedra"}[mesh.dim]
    theirs.set_mesh_size(vertices=mesh.n_points, **{cells: mesh.n_cells})
    theirs.set_vertices(np.array(mesh.points))
    theirs.load_sol(str(tmp_path / "part.sol"), channel="tensor")
    i, j = np.triu_indices(mesh.dim)  # the order that meshing uses
    assert np.asarray(theirs["tensor"]) == pytest.approx(metric.matrices[:, i, j], rel=1e-9)


@pytest.mark.parametrize(
    ("mesh", "element", "nodes"),
    [("plane", "TT", 3), ("tetrahedra", "TS", 4), ("surface", "TT", 3)],
)
def test_a_gmsh_view_holds_nine_numbers_per_node(tmp_path, mesh, element, nodes):
    mesh = MESHES[mesh]
    metric = random_metric(mesh)
    ads.write(tmp_path / "metric.pos", MetricFunction(mesh, metric))
    text = (tmp_path / "metric.pos").read_text()
    assert text.startswith('View "metric" {\n')
    lines = re.findall(rf"^{element}\(([^)]*)\)\{{([^}}]*)\}};$", text, re.M)
    assert len(lines) == mesh.n_cells
    places, values = (
        np.array([np.array(x.split(","), float) for x in part]) for part in zip(*lines, strict=True)
    )
    assert places.reshape(-1, nodes, 3)[..., : mesh.dim] == pytest.approx(mesh.points[mesh.cells])
    matrices = values.reshape(-1, nodes, 3, 3)[..., : mesh.dim, : mesh.dim]
    assert matrices == pytest.approx(metric.matrices[mesh.cells])


def test_sizes_are_read_as_an_isotropic_metric(tmp_path):
    mesh = MESHES["tetrahedra"]
    sizes = np.linspace(0.1, 0.5, mesh.n_points)
    ads.write(tmp_path / "h.sol", ads.SizeFunction(mesh, sizes))
    assert ads.read_metric(tmp_path / "h.sol").sizes == pytest.approx(np.tile(sizes[:, None], 3))
    ads.write(tmp_path / "h.vtu", ads.SizeFunction(mesh, sizes))
    assert ads.read_metric(tmp_path / "h.vtu", name="h").sizes[:, 0] == pytest.approx(sizes)


def test_infinite_sizes_have_no_lengths_but_a_matrix(tmp_path):
    mesh = MESHES["plane"]
    metric = Metric(np.tile([0.1, np.inf], (mesh.n_points, 1)), [np.eye(2)] * mesh.n_points)
    ads.write(tmp_path / "part.vtu", MetricFunction(mesh, metric))
    fields = ads.read(tmp_path / "part.vtu").point_data
    assert "metric.lengths" not in fields
    assert fields["metric"][0] == pytest.approx([100.0, 0, 0, 0, 0, 0, 0, 0, 0])


SOL = "MeshVersionFormatted 2\n\nDimension 2\n\nSolAtVertices\n2\n1 3\n4 0 9\n4 1 9\n\nEnd\n"


def test_the_undamaged_file_is_read(tmp_path):
    (tmp_path / "part.sol").write_text(SOL)
    expected = [[[4, 0], [0, 9]], [[4, 1], [1, 9]]]
    assert ads.read_metric(tmp_path / "part.sol").matrices == pytest.approx(np.array(expected))


def solb(version, order, values, *, dim=3, kinds=(3,), n=2):
    """Return a binary .solb as libMeshb writes it: places of 8 bytes from version 3 on."""
    place = order + ("i" if version < 3 else "q")
    count = order + ("i" if version < 4 else "q")
    head = struct.pack(order + "ii", 1, version)
    dimension = struct.pack(order + "i", 3)
    start = len(head) + 4 + struct.calcsize(place) + 4
    data = struct.pack(count, n) + struct.pack(order + f"{1 + len(kinds)}i", len(kinds), *kinds)
    data += np.asarray(values, order + ("f4" if version == 1 else "f8")).tobytes()
    end = start + 4 + struct.calcsize(place) + len(data)
    return (
        head + dimension + struct.pack(place, start) + struct.pack(order + "i", dim)
        + struct.pack(order + "i", 62) + struct.pack(place, end) + data
        + struct.pack(order + "i", 54) + struct.pack(place, 0)
    )  # fmt: skip


VALUES = [[4, 1, 9, 0.5, 0.25, 16], [1, 0, 1, 0, 0, 1]]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_binary_solutions_are_read(tmp_path, version, order):
    (tmp_path / "part.solb").write_bytes(solb(version, order, VALUES))
    expected = [[[4, 1, 0.5], [1, 9, 0.25], [0.5, 0.25, 16]], np.eye(3)]
    assert ads.read_metric(tmp_path / "part.solb").matrices == pytest.approx(np.array(expected))
    (tmp_path / "part.solb").write_bytes(solb(version, order, [0.5, 2.0], kinds=(1,)))
    sizes = ads.read_metric(tmp_path / "part.solb").sizes
    assert sizes == pytest.approx(np.array([[0.5] * 3, [2.0] * 3]))


@pytest.mark.parametrize("kind", MESHES)
def test_views_of_gmsh_are_read_as_meshes_with_a_field(tmp_path, kind):
    mesh = MESHES[kind] or MESHES["tetrahedra"].boundary().mesh
    metric = random_metric(mesh)
    ads.write(tmp_path / "view.pos", MetricFunction(mesh, metric))
    back = ads.read(tmp_path / "view.pos")
    assert back.n_cells == mesh.n_cells
    assert back.points[back.cells] == pytest.approx(mesh.points[mesh.cells])
    found = ads.read_metric(tmp_path / "view.pos")
    assert found.matrices[back.cells] == pytest.approx(metric.matrices[mesh.cells])


def test_views_of_sizes_are_read(tmp_path):
    mesh = MESHES["plane"]
    h = 0.1 + mesh.points[:, 0]
    ads.write(tmp_path / "view.pos", mesh, fields={"h": h})
    back = ads.read(tmp_path / "view.pos")
    assert back.point_data["h"] == pytest.approx(0.1 + back.points[:, 0])


VIEW = 'View "h" {\nST(0,0,0,1,0,0,0,1,0){1,2,3};\n};\n'


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("part.sol", SOL.replace("Dimension 2", ""), "lacks Dimension"),
        ("part.sol", SOL.replace("1 3", "1 2"), "must hold one size"),
        ("part.sol", SOL.replace("\n2\n", "\n3\n"), "something else than numbers, or ends early"),
        ("part.sol", SOL.replace("4 1 9\n\nEnd\n", "4 1"), "ends after 5 of 6 numbers"),
        ("part.sol", SOL.replace("4 1 9", "4 7 9"), "must be positive definite"),
        ("part.sol", SOL.replace("4 1 9", "4 nan 9"), "must be finite"),
        ("part.sol", SOL.replace("Dimension 2", "Dimension 4"), "must hold one size"),
        ("part.sol", "\xff", "not a text file"),
        ("part.solb", b"", "empty"),
        ("part.solb", b"MeshVersionFormatted 2", "does not begin as a binary"),
        ("part.solb", solb(2, "<", VALUES)[:60], "ends after 2 of 12"),
        ("part.solb", solb(2, "<", VALUES)[:20], "ends early, or is damaged"),
        ("part.solb", solb(5, "<", VALUES), "has version 5"),
        ("part.solb", solb(2, "<", VALUES, kinds=(3, 1)), "must hold one size"),
        ("part.solb", solb(2, "<", VALUES, kinds=(7,)), "types \\[7\\]"),
        ("part.solb", solb(2, "<", VALUES, n=-1), "has -1 nodes"),
        ("part.solb", solb(2, "<", VALUES, dim=4), "in 4-D"),
        ("part.pos", VIEW[:-4], "ends early, or holds something else"),
        ("part.pos", VIEW + VIEW, "must hold one list-based|something else"),
        ("part.pos", 'View "h" {};', "a view without elements"),
        ("part.pos", VIEW.replace("ST(", "SQ("), "holds elements SQ"),
        ("part.pos", VIEW.replace("1,2,3}", "1,2}"), "2 numbers instead of 3"),
        ("part.pos", VIEW.replace("1,2,3}", "1,two,3}"), "something else than numbers"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, name, content, message):
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode("latin1"))
    with pytest.raises(MeshFileError, match=message) as caught:
        ads.read_metric(file)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


def test_formats_without_tensors_and_missing_fields_are_refused(tmp_path):
    function = MetricFunction(MESHES["plane"], random_metric(MESHES["plane"]))
    for name in ("part.ply", "part.stl", "part.jig.msh", "part.mesh"):
        with pytest.raises(ValueError, match="cannot hold"):
            ads.write(tmp_path / name, function)
    ads.write(tmp_path / "plain.vtu", MESHES["plane"])
    with pytest.raises(MeshFileError, match="has no nodal field 'metric'"):
        ads.read_metric(tmp_path / "plain.vtu")
