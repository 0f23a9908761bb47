"""Files made by other programs: read equal to the program's own arrays, or refused with a reason.

Each file is made here by the program, never stored.
"""

import contextlib

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adaptsize import SimplexMesh, read
from adaptsize.errors import MeshFileError

pytestmark = pytest.mark.filterwarnings("ignore::adaptsize.errors.InputWarning")

_RNG = np.random.default_rng(7411)
TETRAHEDRA = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]])
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [0.5, 1.25, 1]])
POINTS = POINTS + 0.1 * _RNG.random((6, 3))
TRIANGLES = np.array([[0, 1, 2], [1, 2, 4], [2, 4, 5], [0, 1, 3]])
NUMBERS = np.arange(6, dtype=np.int32)
HEIGHTS = _RNG.random(6).astype(np.float32)
REGIONS = np.array([4, 5, 5])


def corners(points, cells, digits):
    """The corners of each cell, in an order that does not depend on numbers."""
    found = np.asarray(points, float)[np.asarray(cells)]
    order = np.round(found, min(digits or 16, 10) - 1) + 0.0
    inner = np.array([np.lexsort(cell.T) for cell in order])[:, :, None]
    found, order = (np.take_along_axis(array, inner, axis=1) for array in (found, order))
    return found[np.lexsort(order.reshape(len(order), -1).T)]


def check(path, points, cells, digits=None):
    """Compare the mesh in a file; ``digits`` are those that the file holds."""
    mesh = read(path, flatten=False)
    wanted = SimplexMesh(points, cells)
    if digits is not None and digits < 6:  # too few to recognise the cells
        assert mesh.n_cells == wanted.n_cells
        assert mesh.measures.sum() == pytest.approx(wanted.measures.sum(), rel=1e-3)
        return mesh
    pair = [corners(each.points, each.cells, digits) for each in (mesh, wanted)]
    if digits is None:
        assert_array_equal(*pair)
    else:
        np.testing.assert_allclose(*pair, rtol=0, atol=2.0 * 10.0**-digits)
    return mesh


# --- pyvista and VTK ------------------------------------------------------------------------------


def vtk_mesh(cells, **fields):
    pyvista = pytest.importorskip("pyvista")
    cell_type = {3: 5, 4: 10}[cells.shape[1]]
    grid = pyvista.UnstructuredGrid(
        np.insert(cells, 0, cells.shape[1], axis=1).ravel(), [cell_type] * len(cells), POINTS
    )
    grid.point_data["number"] = NUMBERS
    grid.point_data["height"] = HEIGHTS
    if len(cells) == len(REGIONS):
        grid.cell_data["region"] = REGIONS
    return grid


VTK_MODES = {
    "binary.vtk": {"binary": True},
    "text.vtk": {"binary": False},
    "binary.vtu": {"binary": True},
    "text.vtu": {"binary": False},
    "a.vtkhdf": {},
}


@pytest.mark.parametrize("cells", [TETRAHEDRA, TRIANGLES], ids=["tetrahedra", "triangles"])
@pytest.mark.parametrize("name", VTK_MODES)
def test_unstructured_grids_of_pyvista(tmp_path, name, cells):
    grid = vtk_mesh(cells)
    grid.save(tmp_path / name, **VTK_MODES[name])
    digits = 10 if name == "text.vtk" else None
    mesh = check(tmp_path / name, POINTS, cells, digits)
    assert_array_equal(mesh.point_data["number"], NUMBERS)
    assert mesh.point_data["number"].dtype == np.int32
    np.testing.assert_allclose(mesh.point_data["height"], HEIGHTS, rtol=1e-5 if digits else 0)
    assert mesh.point_data["height"].dtype == np.float32
    if cells is TETRAHEDRA:
        assert_array_equal(mesh.cell_tags, REGIONS)


@pytest.mark.parametrize("compressor", ["None", "ZLib", "LZ4", "LZMA"])
@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended", "raw"])
def test_data_modes_and_compressors_of_vtk(tmp_path, mode, compressor):
    grid = vtk_mesh(TETRAHEDRA)
    names = np.array(["a", "b & <c>", "d", "e", "f", "g"])
    grid.point_data["texts"] = names  # strings are left out
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(tmp_path / "a.vtu"))
    getattr(writer, f"SetDataModeTo{'Appended' if mode == 'raw' else mode}")()
    writer.SetEncodeAppendedData(mode != "raw")
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    writer.Write()
    mesh = check(tmp_path / "a.vtu", POINTS, TETRAHEDRA)
    assert set(mesh.point_data) == {"number", "height"}


SURFACE_MODES = {
    "binary.vtp": ({"binary": True}, None),
    "text.vtp": ({"binary": False}, None),
    "binary.vtk": ({"binary": True}, None),
    "text.vtk": ({"binary": False}, 10),
    "a.vtkhdf": ({}, None),
    "binary.stl": ({"binary": True}, 6),
    "text.stl": ({"binary": False}, 5),
    "binary.ply": ({"binary": True}, 6),
    "text.ply": ({"binary": False}, 5),
    "a.obj": ({}, 5),
}


@pytest.mark.parametrize("name", SURFACE_MODES)
def test_surfaces_of_pyvista(tmp_path, name):
    pyvista = pytest.importorskip("pyvista")
    surface = pyvista.PolyData(POINTS, np.insert(TRIANGLES, 0, 3, axis=1).ravel())
    surface.cell_data["tag"] = np.arange(1, 5)
    options, digits = SURFACE_MODES[name]
    surface.save(tmp_path / name, **options)
    mesh = check(tmp_path / name, POINTS, TRIANGLES, digits)
    if name.endswith((".vtp", ".vtk", ".vtkhdf")):
        assert_array_equal(mesh.cell_tags, np.arange(1, 5))


@pytest.mark.parametrize("suffix", [".vtk", ".vts", ".vtr"])
def test_structured_data_of_pyvista(tmp_path, suffix):
    pyvista = pytest.importorskip("pyvista")
    x = np.array([0.0, 0.5, 2.0])
    grid = pyvista.RectilinearGrid(x, x, x)
    if suffix == ".vts":
        grid = grid.cast_to_structured_grid()
    grid.cell_data["region"] = np.arange(1, 9)
    grid.save(tmp_path / f"a{suffix}")
    mesh = read(tmp_path / f"a{suffix}")
    assert mesh.measures.sum() == pytest.approx(8.0)
    assert_array_equal(np.bincount(mesh.cell_tags), [0, *[6] * 8])


def test_blocks_of_pyvista(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    blocks = pyvista.MultiBlock({"wall": pyvista.Cube(), "ball": pyvista.Sphere()})
    blocks.save(tmp_path / "a.vtm")
    mesh = read(tmp_path / "a.vtm")
    assert mesh.tag_names == {(2, 1): "wall", (2, 2): "ball"}
    assert mesh.measures.sum() == pytest.approx(6.0 + pyvista.Sphere().area, rel=1e-5)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
@pytest.mark.parametrize("kind", ["quadratic", "hexahedra", "polyhedron"])
def test_cells_of_volumes(tmp_path, suffix, kind):
    pyvista = pytest.importorskip("pyvista")
    examples = pytest.importorskip("pyvista.examples").cells
    grid = {
        "quadratic": examples.QuadraticTetrahedron,
        "hexahedra": lambda: pyvista.ImageData(dimensions=(3, 3, 2)).cast_to_unstructured_grid(),
        "polyhedron": examples.Polyhedron,
    }[kind]()
    grid.save(tmp_path / f"a{suffix}")
    if kind == "polyhedron":
        with pytest.raises(MeshFileError, match=r"type 42 \(polyhedron\)"):
            read(tmp_path / f"a{suffix}")
        return
    volume = {"quadratic": 1.0 / 6.0, "hexahedra": 4.0}[kind]
    assert read(tmp_path / f"a{suffix}").measures.sum() == pytest.approx(volume, rel=1e-6)


def test_pieces_of_a_parallel_file_are_joined_at_equal_points(tmp_path):
    grid = vtk_mesh(TETRAHEDRA)
    for i in range(3):
        grid.extract_cells([i]).save(tmp_path / f"a_{i}.vtu")
    pieces = "".join(f'<Piece Source="a_{i}.vtu"/>' for i in range(3))
    (tmp_path / "a.pvtu").write_text(
        '<VTKFile type="PUnstructuredGrid" version="0.1" byte_order="LittleEndian">'
        '<PUnstructuredGrid GhostLevel="0"><PPoints><PDataArray type="Float64" Name="Points" '
        'NumberOfComponents="3"/></PPoints><PPointData><PDataArray type="Int32" Name="number"/>'
        f"</PPointData>{pieces}</PUnstructuredGrid></VTKFile>"
    )
    mesh = check(tmp_path / "a.pvtu", POINTS, TETRAHEDRA)
    assert mesh.n_points == 6
    order = np.argsort(mesh.point_data["number"])
    assert_array_equal(mesh.points[order], POINTS)
    (tmp_path / "a_1.vtu").unlink()
    with pytest.raises(MeshFileError, match=r"a\.pvtu: cannot be read"):
        read(tmp_path / "a.pvtu")


# --- meshio ---------------------------------------------------------------------------------------

MESHIO_MODES = {
    "a.off": ("off", {}),
    "a.obj": ("obj", {}),
    "text.stl": ("stl", {"binary": False}),
    "binary.stl": ("stl", {"binary": True}),
    "text.ply": ("ply", {"binary": False}),
    "binary.ply": ("ply", {"binary": True}),
    "text42.vtk": ("vtk42", {"binary": False}),
    "binary42.vtk": ("vtk42", {"binary": True}),
    "text51.vtk": ("vtk51", {"binary": False}),
    "binary51.vtk": ("vtk51", {"binary": True}),
    "text.vtu": ("vtu", {"binary": False}),
    "zlib.vtu": ("vtu", {"compression": "zlib"}),
    "lzma.vtu": ("vtu", {"compression": "lzma"}),
    "plain.vtu": ("vtu", {"compression": None}),
    "text22.msh": ("gmsh22", {"binary": False}),
    "binary22.msh": ("gmsh22", {"binary": True}),
    "text41.msh": ("gmsh", {"binary": False}),
    "binary41.msh": ("gmsh", {"binary": True}),
    "a.mesh": ("medit", {}),
    "a.meshb": ("medit", {}),
    "a.inp": ("abaqus", {}),
    "small.bdf": ("nastran", {"point_format": "fixed-small"}),
    "large.bdf": ("nastran", {"point_format": "fixed-large"}),
    "free.bdf": ("nastran", {"point_format": "free"}),
    "a.su2": ("su2", {}),
}
MESHIO_DIGITS = {"text.vtu": 10, "text.stl": 6, "binary.stl": 6, "small.bdf": 3, "large.bdf": 9}
MESHIO_DIGITS["free.bdf"] = 9
ONLY_SURFACES = (".off", ".obj", ".stl", ".ply")


@pytest.mark.parametrize("kind", ["triangle", "tetra"])
@pytest.mark.parametrize("name", MESHIO_MODES)
def test_every_writer_of_meshio(tmp_path, name, kind):
    import meshio

    if name.endswith({"tetra": ONLY_SURFACES, "triangle": ".su2"}[kind]):
        return
    cells = {"triangle": TRIANGLES, "tetra": TETRAHEDRA}[kind]
    file_format, options = MESHIO_MODES[name]
    mesh = meshio.Mesh(POINTS, [(kind, cells)])
    with contextlib.redirect_stdout(None), contextlib.redirect_stderr(None):
        meshio.write(tmp_path / name, mesh, file_format=file_format, **options)
    check(tmp_path / name, POINTS, cells, MESHIO_DIGITS.get(name))


# --- trimesh --------------------------------------------------------------------------------------

TRIMESH_KINDS = {"stl": 6, "stl_ascii": 6, "ply": 6, "off": 8, "obj": 7, "glb": 6, "gltf": 6}


@pytest.mark.parametrize("kind", TRIMESH_KINDS)
def test_exports_of_trimesh(tmp_path, kind):
    import trimesh

    mesh = trimesh.Trimesh(POINTS, TRIANGLES, process=False)
    data = mesh.export(file_type=kind)
    if isinstance(data, dict):
        for name, content in data.items():
            (tmp_path / name).write_bytes(content)
        path = tmp_path / "model.gltf"
    else:
        path = tmp_path / f"a.{kind.split('_')[0]}"
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
    check(path, POINTS, TRIANGLES, TRIMESH_KINDS[kind])


# --- Gmsh -----------------------------------------------------------------------------------------

GMSH_FILES = {
    **{f"{form}{'b' if binary else 't'}.msh": {"Mesh.MshFileVersion": form, "Mesh.Binary": binary}
       for form in (2.2, 4.0, 4.1) for binary in (0, 1) if (form, binary) != (4.0, 1)},
    "text.vtk": {"Mesh.Binary": 0},
    "binary.vtk": {"Mesh.Binary": 1},
    "small.bdf": {"Mesh.BdfFieldFormat": 1},
    "large.bdf": {"Mesh.BdfFieldFormat": 2},
    "free.bdf": {"Mesh.BdfFieldFormat": 0},
    "a.inp": {},
    "a.mesh": {},
    "a.su2": {},
    "text.stl": {"Mesh.Binary": 0},
    "binary.stl": {"Mesh.Binary": 1},
    "a.off": {},
    "a.ply2": {},
    "a.unv": {},
}  # fmt: skip
#: What is refused, and why.
GMSH_REFUSED = {"a.ply2": "no reader knows", "a.unv": "no reader knows"}
GMSH_DIGITS = {
    "small.bdf": 3,
    "a.off": 5,
    "large.bdf": 8,
    "free.bdf": 5,
    "binary.stl": 6,
    "text.stl": 6,
}


@pytest.fixture(scope="module")
def gmsh_box(tmp_path_factory):
    """Files of a box with two groups, and its arrays."""
    gmsh = pytest.importorskip("gmsh")
    folder = tmp_path_factory.mktemp("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addBox(0, 0, 0, 1, 0.5, 0.25)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], 7, "body")
        gmsh.model.addPhysicalGroup(2, [1, 2, 3, 4, 5, 6], 9, "skin")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
        gmsh.model.mesh.generate(3)
        tags, points, _ = gmsh.model.mesh.getNodes()
        numbers = np.zeros(int(tags.max()) + 1, int)
        numbers[tags.astype(int)] = np.arange(len(tags))
        arrays = {dim: numbers[gmsh.model.mesh.getElementsByType(kind)[1].astype(int)]
                  .reshape(-1, dim + 1) for dim, kind in ((2, 2), (3, 4))}  # fmt: skip
        for name, options in GMSH_FILES.items():
            for key, value in {"Mesh.Binary": 0, **options}.items():
                gmsh.option.setNumber(key, value)
            gmsh.write(str(folder / name))
    finally:
        gmsh.finalize()
    return folder, points.reshape(-1, 3), arrays


@pytest.mark.parametrize("name", GMSH_FILES)
def test_every_writer_of_gmsh(gmsh_box, name):
    folder, points, arrays = gmsh_box
    if name in GMSH_REFUSED:
        with pytest.raises(MeshFileError, match=GMSH_REFUSED[name]) as caught:
            read(folder / name)
        assert "\n" not in str(caught.value)
        return
    dim = 2 if name.endswith((".stl", ".off")) else 3
    mesh = check(folder / name, points, arrays[dim], GMSH_DIGITS.get(name, 12))
    if name.endswith(".msh"):
        assert set(mesh.cell_tags) == {7}
        assert set(mesh.facet_tags) == {9}
        assert mesh.tag_names == {(3, 7): "body", (2, 9): "skin"}
