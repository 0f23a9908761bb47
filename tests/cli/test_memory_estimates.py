"""The memory that large inputs need is printed before the work."""

import json

import numpy as np
import pytest

from adaptsize import SimplexMesh, write
from adaptsize.cli import files as memory
from adaptsize.cli.entry import run


@pytest.fixture
def tetrahedron(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    file = tmp_path / "part.stl"
    write(file, SimplexMesh(points, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    return file


def test_small_inputs_need_no_line(capsys, tetrahedron):
    assert run(["size", str(tetrahedron), "-o", str(tetrahedron.with_suffix(".vtu"))]) == 0
    assert "memory" not in capsys.readouterr().err


def test_large_inputs_are_announced_and_too_large_ones_are_a_warning(
    capsys, tetrahedron, monkeypatch
):
    words = ["size", str(tetrahedron), "-o", str(tetrahedron.with_suffix(".vtu")), "--json"]
    monkeypatch.setattr(memory, "_PER_TRIANGLE", 0.5e9)
    monkeypatch.setattr(memory, "_installed_memory", lambda: 3e9)
    assert run(words) == 0
    printed = capsys.readouterr()
    assert "the sizes of 4 triangles need about 2.0 GB of memory\n" in printed.err
    assert json.loads(printed.out)["warnings"] == []
    monkeypatch.setattr(memory, "_installed_memory", lambda: 1e9)
    assert run(words) == 0
    (text,) = json.loads(capsys.readouterr().out)["warnings"]
    assert text.endswith("need about 2.0 GB of memory; this machine has 1.0 GB")


def test_the_memory_of_a_mesh_is_announced_once_its_size_is_known(capsys, tetrahedron, monkeypatch):
    monkeypatch.setattr(memory, "_PER_ELEMENT", 1e9)
    monkeypatch.setattr("adaptsize.remeshing.remesh", lambda mesh, size, **_: mesh)
    output = tetrahedron.with_suffix(".vtu")
    assert run(["remesh", str(tetrahedron), "-o", str(output)]) == 0
    assert "elements need about " in capsys.readouterr().err


def test_the_memory_of_this_machine_is_a_positive_number():
    assert memory._installed_memory() > 1e7
    assert np.isinf(memory._installed_memory()) or memory._installed_memory() < 1e16
