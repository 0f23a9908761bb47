"""``adaptsize check``: what it prints, and its exit code."""

import json

import numpy as np
import pytest
from shapes import block

from adaptsize import SimplexMesh, write
from adaptsize.cli.entry import run

CUBE = block(2)


@pytest.fixture
def files(tmp_path):
    """A cube, its surface, and a cube that is a little larger."""
    write(tmp_path / "cube.vtu", CUBE)
    write(tmp_path / "cube.stl", CUBE)
    write(tmp_path / "large.vtu", SimplexMesh(CUBE.points * 1.01, CUBE.cells))
    return tmp_path


def test_a_mesh_that_meets_all_demands_exits_0(capsys, files):
    assert run(["check", str(files / "cube.vtu"), "--original", str(files / "cube.stl")]) == 0
    out, err = capsys.readouterr()
    names = [line.split()[:2] for line in out.splitlines()]
    wanted = ["cells", "facets", "boundary", "measure", "topology"]
    assert names == [[name, "ok"] for name in wanted]
    assert err == ""


def test_a_mesh_of_another_domain_exits_1_and_lists_the_worst_places(capsys, files):
    words = ["check", str(files / "large.vtu"), "--original", str(files / "cube.stl")]
    assert run(words) == 1
    lines = capsys.readouterr().out.splitlines()
    # The corner moves by 0.01 of the diagonal, measured between the two.
    (failed,) = (i for i, line in enumerate(lines) if line.startswith("boundary  FAILED"))
    assert "within 0.01 of the diagonal, 0.001 allowed" in lines[failed]
    assert lines[failed + 1].strip() == "0.01732 at (1.01, 1.01, 1.01)"
    assert run([*words, "--tolerance", "0.02"]) == 0


def test_sizes_of_the_mesh_are_checked_if_there_are_any(capsys, files):
    write(files / "sized.vtu", CUBE, fields={"h": np.full(CUBE.n_points, 5.0)})
    assert run(["check", str(files / "sized.vtu"), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert [d["name"] for d in result["demands"] if not d["is_met"]] == ["edges"]
    assert result["is_met"] is False
    assert result["n_inverted"] == 0
    assert "error" not in result
    assert run(["check", str(files / "cube.vtu"), "--field", "h"]) == 1
    assert "no nodal field 'h'" in capsys.readouterr().err
