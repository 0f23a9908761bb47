"""Files that cannot be written are refused before anything is read or computed."""

import numpy as np
import pytest

from adaptsize import SimplexMesh
from adaptsize.cli import files
from adaptsize.errors import OptionError


@pytest.fixture
def nothing_is_read(monkeypatch):
    monkeypatch.setattr("adaptsize.io.read", lambda *_: pytest.fail("the input was read"))
    monkeypatch.setattr("adaptsize.io.read_image", lambda *_: pytest.fail("the input was read"))


COMMANDS = {
    "size": ["size"],
    "limit": ["limit", "--field", "h0", "-g", "0.3"],
    "remesh": ["remesh"],
}


@pytest.mark.usefixtures("nothing_is_read")
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("name", "code", "printed"),
    [
        ("missing/out.vtu", 1, "there is no directory"),
        ("out.doc", 2, "error: --output must end in a suffix that can be written"),
        (".", 1, "is a directory"),
        ("out", 2, "out has no suffix, which gives the format; write "),
        ("out.vti", 2, "out.vti holds grids, not meshes"),
        ("square.vtu", 2, "square.vtu is also the input; give another name"),
        ("../{folder}/square.vtu", 2, "square.vtu is also the input; give another name"),
    ],
)
def test_bad_output_is_refused_before_the_work_starts(
    refused, square, command, name, code, printed
):
    output = square.parent / name.format(folder=square.parent.name)
    first, *words = COMMANDS[command]
    assert printed in refused(first, square, "-o", output, *words, code=code)
    assert [path.name for path in square.parent.iterdir()] == ["square.vtu"]


@pytest.mark.usefixtures("nothing_is_read")
@pytest.mark.parametrize(
    ("command", "name", "printed"),
    [
        ("size", "o.mesh", "o.mesh cannot hold nodal fields such as the sizes; write .sol"),
        ("limit", "o.stl", "o.stl cannot hold nodal fields such as the sizes; write .sol"),
        ("remesh", "o.sol", "o.sol would hold sizes but no mesh"),
        ("remesh", "o.pos", "o.pos would hold sizes but no mesh"),
    ],
)
def test_a_format_that_cannot_hold_the_result_is_refused(refused, square, command, name, printed):
    first, *words = COMMANDS[command]
    assert printed in refused(first, square, "-o", square.with_name(name), *words)


@pytest.mark.usefixtures("nothing_is_read")
@pytest.mark.parametrize(
    ("words", "printed"),
    [
        (["--plot", "out.doc"], "--plot must end in .png"),
        (["--plot", "a.png", "--plot-causes", "a.png"], "--plot-causes a.png is also --plot"),
    ],
)
def test_files_of_other_options_are_refused_too(refused, square, monkeypatch, words, printed):
    monkeypatch.chdir(square.parent)
    assert printed in refused("size", "square.vtu", "-o", "out.vtu", *words)


@pytest.mark.usefixtures("nothing_is_read")
def test_sizes_beside_a_mesh_may_not_replace_the_input(refused, tmp_path):
    (tmp_path / "part.sol").touch()
    err = refused("remesh", tmp_path / "part.sol", "-o", tmp_path / "part.mesh")
    assert "part.sol is also the input" in err


def test_a_field_of_one_column_is_one_number_per_node():
    mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    column = mesh.with_data(point_data={"u": [[1.0], [2.0], [3.0]], "v": np.ones((3, 2))})
    assert files.nodal_field(column, "u").tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(OptionError, match="'v' must have one number per node"):
        files.nodal_field(column, "v")
