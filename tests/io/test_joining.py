"""Cells with nodes of their own, slits, hanging nodes, errors of split cells, and plane meshes."""

import meshio
import numpy as np
import pytest
from command_line import call
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, random_square, slit_square
from numpy.testing import assert_allclose, assert_array_equal

import adaptsize as ads
from adaptsize import SimplexMesh, read, write
from adaptsize.errors import InputWarning
from adaptsize.quality.connections import unconnected


def grid(n, dim, rng):
    """Quads or hexahedra in n^dim cells of different sizes."""
    lines = [np.sort(rng.random(n + 1)) + np.arange(n + 1) for _ in range(dim)]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, dim)
    at = np.arange(len(points)).reshape((n + 1,) * dim)
    if dim == 2:
        corners = [at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]]
    else:
        lower = [at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]]
        corners = [c[..., k] for k in (slice(None, -1), slice(1, None)) for c in lower]
    return points, np.stack([c.ravel() for c in corners], axis=1)


def apart(points, cells):
    """Points and cells, each with nodes of its own."""
    return points[cells].reshape(-1, points.shape[1]), np.arange(cells.size).reshape(cells.shape)


def write_cells(path, points, cells, point_data=None, cell_data=None):
    kind = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}
    points = np.asarray(points, float)
    name = kind[points.shape[1], cells.shape[1]]
    padded = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    fields = {key: [values] for key, values in (cell_data or {}).items()}
    meshio.write(path, meshio.Mesh(padded, [(name, cells)], point_data or {}, fields))


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.sampled_from(["boxes", "simplices"]))
def test_cells_with_own_nodes_are_connected_with_the_mean_of_fields(
    tmp_path_factory, seed, dim, kind
):
    path, rng = tmp_path_factory.mktemp("apart") / "a.vtu", np.random.default_rng(seed)
    if kind == "boxes":
        points, cells = grid(3, dim, rng)
    else:
        mesh = random_square(20, seed) if dim == 2 else jittered_cube(3, seed)
        points, cells = mesh.points, mesh.cells
    own, own_cells = apart(points, cells)
    order = rng.permutation(len(own))
    back = np.argsort(order)
    jumps = rng.random(len(own))
    fields = {"x": own[:, 0], "u": jumps, "number": cells.ravel().astype(np.int32)}
    write_cells(path, own[order], back[own_cells], {k: v[order] for k, v in fields.items()})
    with pytest.warns(InputWarning, match="most facets are double: nodes at one place joined"):
        found = read(path)
    write_cells(path, points, cells)
    if kind == "boxes":
        with pytest.warns(InputWarning, match="split into"):
            wanted = read(path)
    else:
        wanted = read(path)
    assert (found.n_points, found.n_cells) == (wanted.n_points, wanted.n_cells)
    # Boxes are split by the numbers of nodes, so only their faces are the same.
    assert_allclose(found.measures.sum(), wanted.measures.sum())
    assert_allclose(found.boundary().mesh.measures.sum(), wanted.boundary().mesh.measures.sum())
    assert_array_equal(found.point_data["x"], found.points[:, 0])
    for node in range(len(points)):
        here = cells.ravel() == node
        place = np.flatnonzero(found.point_data["number"] == node)
        assert_allclose(found.point_data["u"][place], jumps[here].mean())
        assert_array_equal(found.points[place[0]], points[node])


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
def test_slits_are_kept_and_told_by_info(tmp_path, capsys, suffix):
    mesh = slit_square(6)
    write(tmp_path / f"a{suffix}", mesh)
    assert read(tmp_path / f"a{suffix}").n_points == mesh.n_points
    assert call("info", tmp_path / f"a{suffix}") == 0
    assert "facet(s) on another, the first at (" in capsys.readouterr().err
    (found,) = unconnected(mesh)
    assert found.kind == "slits"
    assert found.number == len(mesh.boundary().mesh.cells) - len(
        np.unique(np.sort(np.unique(mesh.boundary().mesh.points, axis=0, return_inverse=True)[1]
                          .ravel()[mesh.boundary().mesh.cells], axis=1), axis=0)
    )  # fmt: skip


def test_nodes_at_one_place_can_be_kept(tmp_path):
    mesh = random_square(20, 5231)
    write_cells(tmp_path / "a.vtu", *apart(mesh.points, mesh.cells))
    assert read(tmp_path / "a.vtu", keep_slits=True).n_points == 3 * mesh.n_cells


@pytest.mark.parametrize("dim", [2, 3])
def test_hanging_nodes_are_named_with_their_place(tmp_path, capsys, dim):
    rng = np.random.default_rng(5232)
    coarse, cells = grid(2, dim, rng)
    mesh = SimplexMesh(*_simplices(coarse, cells))
    cell = mesh.cells[0]
    # One cell is bisected, its neighbours are not.
    middle = mesh.points[cell[:2]].mean(axis=0)
    new = np.array([cell, cell])
    new[0, 0], new[1, 1] = mesh.n_points, mesh.n_points
    hanging = SimplexMesh(np.vstack([mesh.points, middle]), np.vstack([mesh.cells[1:], new]))
    assert unconnected(mesh) == []
    (found,) = unconnected(hanging)
    assert (found.kind, found.number) == ("hanging", 1)
    assert_allclose(found.place, middle)
    write(tmp_path / "a.vtu", hanging)
    with pytest.warns(InputWarning, match=r"1 node\(s\) in the middle of an edge"):
        read(tmp_path / "a.vtu")
    assert "1 node(s) in the middle" in str(ads.check_mesh(hanging))
    assert call("info", tmp_path / "a.vtu") == 0
    assert f"the first at ({middle[0]:.6g}" in capsys.readouterr().err


def _simplices(points, boxes):
    """Simplices around the centre of the first box, which is inside."""
    from scipy.spatial import Delaunay

    centre = points[boxes[0]].mean(axis=0)
    inner = np.vstack([points, centre])
    return inner, Delaunay(inner).simplices[::-1]


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_parts_of_a_cell_share_its_error(tmp_path_factory, seed, dim):
    path, rng = tmp_path_factory.mktemp("shared") / "a.vtu", np.random.default_rng(seed)
    points, cells = grid(3, dim, rng)
    eta, density = rng.random((2, len(cells)))
    write_cells(path, points, cells, cell_data={"eta": eta, "density": density})
    with pytest.warns(InputWarning, match="split into"):
        mesh = read(path, errors="eta")
    assert np.sum(mesh.cell_data["eta"] ** 2) == pytest.approx(np.sum(eta**2))
    per_area = mesh.cell_data["eta"] ** 2 / mesh.measures
    lengths = np.ptp(points[cells], axis=1).prod(axis=1)
    assert_allclose(np.unique(per_area.round(9)), np.unique((eta**2 / lengths).round(9)))
    assert set(mesh.cell_data["density"]) == set(density)


def test_the_command_adapt_takes_the_errors_of_quads(tmp_path, capsys):
    pytest.importorskip("mmgpy")
    points, cells = grid(4, 2, np.random.default_rng(5233))
    write_cells(tmp_path / "a.vtu", points, cells, cell_data={"eta": np.full(16, 0.25)})
    words = ["--field", "eta", "--elements", "60", "-o", tmp_path / "b.vtu"]
    assert call("adapt", tmp_path / "a.vtu", *words) == 0
    assert "estimated error of the old mesh 1\n" in capsys.readouterr().out


@pytest.mark.parametrize("height", [5.0, -0.125])
def test_triangles_at_one_height_are_plane_with_a_warning(tmp_path, height):
    mesh = random_square(20, 5234)
    space = np.column_stack([mesh.points, np.full(20, height)])
    for name in ("a.vtk", "a.mesh"):
        meshio.write(tmp_path / name, meshio.Mesh(space, [("triangle", mesh.cells)]))
        with pytest.warns(InputWarning, match=f"z is {height:g} everywhere"):
            found = read(tmp_path / name)
        assert_array_equal(found.points, mesh.points)
        assert_array_equal(read(tmp_path / name, flatten=False).points, space)
    meshio.write(tmp_path / "a.obj", meshio.Mesh(space, [("triangle", mesh.cells)]))
    assert read(tmp_path / "a.obj").dim == 3


@pytest.mark.parametrize("size", [1e-17, 3e-9])
def test_rounding_of_z_is_left_out_but_relief_is_not(tmp_path, size):
    mesh = random_square(20, 5235)
    noise = size * np.random.default_rng(5236).standard_normal(20)
    for factor, dim in ((1.0, 2), (1e3, 3 if size > 1e-12 else 2)):
        space = np.column_stack([mesh.points, factor * noise])
        meshio.write(tmp_path / "a.vtu", meshio.Mesh(space, [("triangle", mesh.cells)]))
        assert read(tmp_path / "a.vtu").dim == dim


@pytest.mark.parametrize("dim", [2, 3])
def test_cells_with_the_nodes_of_another_are_dropped_with_one_message(tmp_path, dim):
    mesh = random_square(20, 5237) if dim == 2 else jittered_cube(3, 5238)
    rng = np.random.default_rng(5239)
    again = rng.permuted(mesh.cells[:4], axis=1)
    write_cells(tmp_path / "a.vtu", mesh.points, np.vstack([mesh.cells, again]))
    with pytest.warns(InputWarning, match="4 cells with the same nodes as another dropped"):
        found = read(tmp_path / "a.vtu")
    assert_array_equal(found.cells, mesh.cells)
    assert ads.check_mesh(found).failures is not None


@pytest.mark.parametrize("normal", [0, 1])
@pytest.mark.parametrize("height", [0.0, 3.25])
def test_triangles_in_another_plane_of_the_axes_keep_the_other_coordinates(
    tmp_path, normal, height
):
    mesh = random_square(20, 5240)
    space = np.insert(mesh.points, normal, height, axis=1)
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(space, [("triangle", mesh.cells)]))
    name, plane = "xy"[normal], ["y-z", "x-z"][normal]
    with pytest.warns(InputWarning, match=f"in the {plane} plane: {name} is {height:g} everywhere"):
        found = read(tmp_path / "a.vtu")
    assert_array_equal(found.points, mesh.points)
    meshio.write(tmp_path / "a.obj", meshio.Mesh(space, [("triangle", mesh.cells)]))
    assert read(tmp_path / "a.obj").dim == 3
    own = apart(space, mesh.cells)
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(own[0], [("triangle", own[1])]))
    with pytest.warns(InputWarning, match="most facets are double"):
        assert read(tmp_path / "a.vtu").n_points == mesh.n_points
