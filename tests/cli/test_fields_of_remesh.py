"""``remesh`` transfers the fields of the file, as ``adapt`` does, and names the others."""

import json

import numpy as np
import pytest
from command_line import call
from shapes import CORNERS, CUBE_CELLS

from adaptsize import CartesianGrid, SimplexMesh, read, remesh, transfer_fields, write
from adaptsize.errors import InputWarning
from adaptsize.remeshing import preparation

pytest.importorskip("mmgpy")

SQUARE = [[0, 0], [2, 0], [2, 2], [0, 2], [1, 1]]
CELLS = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]


def plane(**more):
    points = np.array(SQUARE, float)
    u = 1.0 + points @ [2.0, -3.0]
    nodal = {"u": u, "flow": np.column_stack([u, -u, 0 * u]), "h": np.ones(5)}
    by_cell = {"heat": [1.0, 2.0, 4.0, 8.0], "owner_rank": np.array([7, 7, 9, 9])}
    return SimplexMesh(points, CELLS, point_data={**nodal, **more}, cell_data=by_cell)


def remeshed(tmp_path, mesh, *words, suffix=".vtu"):
    write(tmp_path / "in.vtu", mesh)
    output = tmp_path / f"out{suffix}"
    code = call("remesh", tmp_path / "in.vtu", "-o", output, "--hmax", "0.3", *words)
    assert code == 0
    return read(output)


def test_fields_of_the_file_are_on_the_new_mesh(tmp_path):
    old = plane()
    new = remeshed(tmp_path, old)
    assert new.n_cells > 50
    u = 1.0 + new.points @ [2.0, -3.0]
    np.testing.assert_allclose(new.point_data["u"], u, atol=1e-9)
    np.testing.assert_allclose(new.point_data["flow"], np.column_stack([u, -u, 0 * u]), atol=1e-9)
    kept = (new.cell_data["heat"] * new.measures).sum()
    np.testing.assert_allclose(kept, (old.cell_data["heat"] * old.measures).sum(), rtol=1e-9)
    assert set(new.cell_data["owner_rank"].tolist()) == {7, 9}
    assert new.point_data["h"].max() <= 0.3 + 1e-12  # the new sizes, not the old field h
    expected = transfer_fields(old, new, fields={"u": old.point_data["u"]}).fields["u"]
    np.testing.assert_allclose(new.point_data["u"], expected, atol=1e-12)


def test_fields_none_leaves_them(tmp_path):
    new = remeshed(tmp_path, plane(), "--fields", "none")
    assert (list(new.point_data), dict(new.cell_data)) == (["h"], {})


def test_fields_that_give_the_sizes_are_not_fields_of_the_solution(tmp_path):
    new = remeshed(tmp_path, plane(bound=np.full(5, 0.4)), "--field", "bound")
    assert set(new.point_data) == {"u", "flow", "h"}
    matrices = np.tile(np.eye(2).ravel() / 0.3**2, (5, 1))
    new = remeshed(tmp_path, plane(requirement=matrices), "--metric", "requirement")
    assert set(new.point_data) == {"u", "flow", "metric", "metric.lengths"}
    assert set(new.cell_data) == {"heat", "owner_rank"}


def test_what_cannot_be_transferred_is_named(tmp_path, capsys):
    new = remeshed(tmp_path, plane(part=[1.0, np.nan, 2.0, np.nan, 0.0]), "--json")
    assert "part" not in new.point_data
    (warning,) = json.loads(capsys.readouterr().out)["warnings"]
    assert warning == "field 'part' is left out: 2 of its values are not finite"
    for suffix, missing in (
        (".su2", "fields: u, flow, heat, owner_rank are not written"),
        (".msh", "cell fields: heat, owner_rank are not written"),
    ):
        remeshed(tmp_path, plane(), suffix=suffix)
        assert f"out{suffix} holds no {missing}" in capsys.readouterr().err


def test_fields_of_a_surface_stay_on_it(tmp_path, capsys):
    z = CORNERS[:, 2]
    cube = SimplexMesh(
        CORNERS, CUBE_CELLS, point_data={"z": z}, cell_data={"k_rank": np.arange(12)}
    )
    new = remeshed(tmp_path, cube, "--target", "triangles")
    np.testing.assert_allclose(new.point_data["z"], new.points[:, 2], atol=1e-9)
    assert set(new.cell_data["k_rank"].tolist()) <= set(range(12))
    assert "left out" not in capsys.readouterr().err
    new = remeshed(tmp_path, cube)
    assert (new.cell_dim, "z" in new.point_data) == (3, False)
    message = "fields of a surface are not known inside, and are left out: z, k_rank"
    assert message in capsys.readouterr().err


def test_the_function_warns_of_fields_that_it_drops():
    old = plane()
    with pytest.warns(InputWarning, match="the fields u, flow, heat, owner_rank: transfer_fi"):
        new = remesh(old, 0.3)
    assert not new.point_data
    remesh(
        SimplexMesh(SQUARE, CELLS, point_data={"h": np.ones(5), "h0": np.ones(5)}), 0.3
    )  # without a warning


def test_sides_of_periodic_files_match(tmp_path):
    grid = CartesianGrid([0.0, 0.0], 0.1, (11, 11)).mesh
    write(tmp_path / "in.vtu", grid)
    output = tmp_path / "out.vtu"
    words = ("--hmax", "0.06", "--periodic", "1,0", "--periodic", "0,1")
    assert call("remesh", tmp_path / "in.vtu", "-o", output, *words) == 0
    new = read(output)
    assert new.n_points > 200
    for d in range(2):
        sides = [np.sort(new.points[new.points[:, d] == x, 1 - d]) for x in (0.0, 1.0)]
        assert len(sides[0]) > 14
        np.testing.assert_allclose(sides[0], sides[1], atol=1e-12)


def test_sizes_are_limited_across_periodic_sides(tmp_path, monkeypatch):
    repaired, repair = [], preparation._repaired
    monkeypatch.setattr(
        preparation, "_repaired", lambda mesh: repaired.append(mesh.points) or repair(mesh)
    )
    grid = CartesianGrid([0.0, 0.0], 0.1, (11, 11)).mesh
    write(tmp_path / "in.vtu", grid)
    output = tmp_path / "out.vtu"
    words = ("--hmax", "0.2", "--periodic", "1,0", "--source", "point:0.05,0.5=0.01")
    assert call("remesh", tmp_path / "in.vtu", "-o", output, *words) == 0
    new = read(output)
    beside = np.linalg.norm(new.points - [1.0, 0.5], axis=1) < 0.05
    assert new.point_data["h"][beside].max() < 0.05  # 0.2 if each side is alone
    assert sum(np.array_equal(points, grid.points) for points in repaired) == 1


def test_adapt_takes_translations(tmp_path):
    grid = CartesianGrid([0.0, 0.0], 0.1, (11, 11)).mesh
    eta = np.exp(-5.0 * grid.points[grid.cells].mean(axis=1)[:, 0])
    write(tmp_path / "in.vtu", grid.with_data(cell_data={"eta": eta}))
    output = tmp_path / "out.vtu"
    words = ("--field", "eta", "--elements", "400", "--periodic", "1,0")
    assert call("adapt", tmp_path / "in.vtu", "-o", output, *words) == 0
    new = read(output)
    sides = [np.sort(new.points[np.abs(new.points[:, 0] - x) < 1e-12, 1]) for x in (0.0, 1.0)]
    np.testing.assert_allclose(sides[0], sides[1], atol=1e-12)
    assert not np.allclose(np.diff(sides[0]), 0.1)


@pytest.mark.parametrize("word", ["1;0", "a,b"])
def test_a_bad_translation_is_named(tmp_path, capsys, word):
    write(tmp_path / "in.vtu", plane())
    assert call("remesh", tmp_path / "in.vtu", "-o", tmp_path / "x.vtu", "--periodic", word) == 2
    assert "--periodic must be X,Y" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("word", "code", "text"),
    [
        ("1,nan", 2, "--periodic must be finite, got ['1,nan']"),
        ("5,0", 1, "periodic[0] = [5.0, 0.0] maps no node"),
        ("1,0,0", 1, "periodic must hold 1 to 2 translations"),
    ],
)
def test_translations_that_do_not_fit_are_refused_before_sizes(tmp_path, capsys, word, code, text):
    write(tmp_path / "in.vtu", plane())
    output = tmp_path / "x.vtu"
    assert call("remesh", tmp_path / "in.vtu", "-o", output, "--periodic", word) == code
    error = capsys.readouterr().err
    assert text in error
    assert error.count("\n") == 1
    assert not output.exists()


@pytest.mark.parametrize("line", ["remesh", "adapt --elements 50", "limit -g 0.3", "size"])
def test_a_field_with_nan_is_named_with_its_node(tmp_path, capsys, line):
    write(tmp_path / "in.vtu", plane(thin=np.array([1.0, 1.0, np.nan, 1.0, np.nan])))
    command, *words = line.split()
    output = tmp_path / "x.vtu"
    assert call(command, tmp_path / "in.vtu", "-o", output, "--field", "thin", *words) == 1
    assert "got field 'thin'[2] = nan (and 1 more)" in capsys.readouterr().err
    assert not output.exists()
