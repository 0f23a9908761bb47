"""``adaptsize remesh``: the mesh, the report on it, its files, and open surfaces."""

import json
import re
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import call
from fake_generators import FakeBackend
from meshes import random_sphere
from shapes import CORNERS as UNIT
from shapes import CUBE_CELLS, block

from adaptsize import BoxSource, SimplexMesh, SizeFunction, read, remesh, size_function, write
from adaptsize._checks import length_text
from adaptsize._records import read_record, write_record
from adaptsize.background.bisection import resolved
from adaptsize.cli.console import Console
from adaptsize.cli.size import print_outcome
from adaptsize.errors import InputWarning
from adaptsize.quality import check_mesh, size_conformity
from adaptsize.quality.by_place import RequestedElements
from adaptsize.remeshing import register_backend, registry
from adaptsize.remeshing.attempts import Attempts
from adaptsize.remeshing.driver import Remeshed, remeshed
from adaptsize.remeshing.preparation import repair_mesh
from adaptsize.reporting.outcome import Outcome, outcome_of_remeshing

DATA = Path(__file__).parents[2] / "data"
CORNERS = UNIT * [2.0, 1.0, 1.0]
GENERAL = "json", "quiet", "verbose"  # options of all commands
TWO = np.concatenate([CUBE_CELLS, CUBE_CELLS + 8])  # bodies


@pytest.fixture
def box(tmp_path):
    write(tmp_path / "box.stl", SimplexMesh(CORNERS, CUBE_CELLS))
    return tmp_path / "box.stl"


@pytest.fixture
def open_box(tmp_path):
    write(tmp_path / "open.stl", SimplexMesh(CORNERS, CUBE_CELLS[:10]))
    return tmp_path / "open.stl"


@pytest.fixture
def no_generator(monkeypatch):
    """Return tetrahedra at once, too large for the sizes, and keep the surfaces to be filled."""
    filled = []

    def fill(mesh, size, **_):
        filled.append(mesh)
        cells = [[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]]
        return Remeshed(SimplexMesh(CORNERS, cells), Attempts((), None, is_cut_short=False))

    monkeypatch.setattr("adaptsize.domain_size.elements.remeshed", fill)
    return filled


def test_a_mesh_above_a_cap_is_written_with_exit_code_1(tmp_path, capsys, monkeypatch):
    from adaptsize.domain_size.elements import Maker

    def with_excess(maker, most):
        made = Maker.meshed(maker, maker.sized())
        return made._replace(excess="the mesh has 90 elements, more than max_elements = 80")

    monkeypatch.setattr("adaptsize.domain_size.elements.within_cap", with_excess)
    output = tmp_path / "new.vtu"
    arguments = ("remesh", DATA / "lshape.vtu", "-o", output, "--max-elements", "2000")
    assert call(*arguments) == 1
    assert "warning: the mesh has 90 elements" in capsys.readouterr().err
    assert call(*arguments, "--quiet") == 1
    assert "error: the mesh has 90 elements" in capsys.readouterr().err
    assert output.exists()


def test_remesh_is_read_size_function_and_remesh(tmp_path):
    pytest.importorskip("mmgpy")
    output = tmp_path / "new.vtu"
    assert call("remesh", DATA / "lshape.vtu", "-o", output, "--backend", "mmg") == 0
    mesh = read(DATA / "lshape.vtu")
    size = size_function(mesh)
    new = remesh(mesh, size, backend="mmg")
    written = read(output)
    np.testing.assert_array_equal(written.points, new.points)
    np.testing.assert_array_equal(written.cells, new.cells)
    np.testing.assert_array_equal(written.point_data["h"], size(new.points))


def test_elements_is_the_number_of_elements_of_the_mesh(capsys, tmp_path):
    pytest.importorskip("mmgpy")
    output = tmp_path / "new.vtu"
    page = tmp_path / "new.html"
    words = ["--elements", 900, "--source", "point:0,0=0.01", "--report", page, "--json"]
    assert call("remesh", DATA / "lshape.vtu", "-o", output, *words) == 0
    assert ", 900 requested (" in page.read_text()
    assert read(output).n_cells == pytest.approx(900, rel=0.15)
    result = json.loads(capsys.readouterr().out)
    assert result["mesh"]["n_cells_requested"] == 900
    assert "n_cells_predicted" not in result["mesh"]
    assert call("size", DATA / "lshape.vtu", "-o", output, "--elements", 900, "--json") == 0
    assert json.loads(capsys.readouterr().out)["size"]["n_elements"] == pytest.approx(900, rel=0.03)


def test_remesh_exits_1_where_check_does_and_names_the_boundary(capsys, tmp_path):
    pytest.importorskip("mmgpy")
    new = tmp_path / "new.vtu"
    command = ["remesh", DATA / "shell.vtu", "-o", new, "--target", "triangles"]
    command += ["--hmin", "0.5", "--hmax", "0.6", "--tolerance", "1e-4"]
    assert call(*command, "--json") == 1
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert result["mesh"]["tolerance"] == 1e-4
    assert result["mesh"]["hausdorff_relative"] > 1e-4
    assert "adaptsize: warning: boundary: within " in printed.err
    assert any(text.startswith("boundary: ") for text in result["warnings"])
    assert call("check", new, "--original", DATA / "shell.vtu", "-q") == 1
    assert call(*command, "-q") == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("adaptsize: error: the mesh does not pass adaptsize check: bound")


@pytest.fixture
def fakes(monkeypatch):
    """Return a function that replaces all generators by functions of `misbehaving`."""
    monkeypatch.setattr(registry, "_BACKENDS", {})
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "support"))

    def register(**functions):
        for name, (function, options) in functions.items():
            register_backend(FakeBackend(function, tuple(options.items()), name=name))

    return register


@pytest.fixture
def cube(tmp_path):
    write(tmp_path / "cube.vtu", block(2))
    return ["remesh", tmp_path / "cube.vtu", "-o", tmp_path / "new.vtu", "--hmax", "0.6"]


def test_the_attempts_and_their_reasons_are_in_the_json_object_and_in_verbose_output(
    capsys, fakes, cube
):
    fakes(first=("fail", {}), second=("copy", {}))
    call(*cube, "--json")
    attempts = json.loads(capsys.readouterr().out)["attempts"]
    assert [(one["route"], one["status"]) for one in attempts] == [
        ("first", "failed"), ("second", "made"),
    ]  # fmt: skip
    assert attempts[0]["reason"] == "there are cells to start from"
    assert "no luck" in attempts[0]["text"]
    assert all(one["seconds"] > 0.0 for one in attempts)
    call(*cube, "-v")
    err = capsys.readouterr().err
    assert "adaptsize: first: there are cells to start from" in err
    assert "adaptsize: first: failed, first failed: RuntimeError: no luck" in err
    assert "adaptsize: second: another generator" in err


def test_at_the_time_limit_the_best_mesh_is_written_and_the_exit_code_is_1(
    capsys, fakes, cube, tmp_path
):
    fakes(bad=("one_twice", {}), hang=("hang_with_stray", {"pid_file": str(tmp_path / "pids")}))
    began = time.monotonic()
    assert call(*cube, "--timeout", "3", "--json") == 1
    assert time.monotonic() - began < 15.0
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert [one["status"] for one in result["attempts"]] == ["missed", "timeout"]
    with pytest.warns(InputWarning, match="the cells there are not connected"):
        assert read(tmp_path / "new.vtu").n_cells == block(2).n_cells + 1
    text = "warning: stopped at the time limit of 3 s with the mesh by bad; not reached: overlaps 2"
    assert printed.err.count(text) == 1


SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    ("mesh", "size", "predicted", "change", "warned"),
    [
        (SQUARE, 1.0, 2.5, 0.009, []),
        (SQUARE, 3.0, 2.0, 0.0, ["edges: 0.0% within a factor sqrt 2 of the size"]),
        (SQUARE, 1.0, 1.0, 0.0, ["2 triangles are 100% more than predicted"]),
        (SQUARE, 1.0, 4.0, 0.0, ["2 triangles are 50% fewer than predicted"]),
        (SQUARE, 1.0, 2.0, -0.2, ["the area has changed by -20.0%"]),
        (SQUARE, 1.0, 2.0, None, []),
    ],
)
def test_what_is_out_of_bounds_is_a_warning(mesh, size, predicted, change, warned):
    check, conformity = check_mesh(mesh, size=size), size_conformity(mesh, size)
    outcome = Outcome("triangles", conformity, check, predicted, False, 1e-3, change)
    printed = [text for text in outcome.warnings() if "edges" not in text or warned]
    assert len(printed) >= len(warned)
    assert all(any(text.startswith(part) for text in printed) for part in warned)
    if not warned:
        assert printed == []


@pytest.mark.parametrize(("top", "code"), [(0.98, 1), (0.88, 0), (0.6, 0)])
def test_cells_below_five_degrees_end_with_exit_code_1_and_those_below_ten_with_a_warning(
    capsys, top, code
):
    cube = block(2)
    points = cube.points.copy()
    points[(points == 0.5).all(axis=1), 2] = top
    flat = cube.moved(points).with_data(point_data={"h": np.full(len(points), 0.5)})
    outcome = outcome_of_remeshing(flat, cube, size_function(cube, hmin=0.5, hmax=0.5), 1e-2)
    outcome = replace(
        outcome, check=replace(outcome.check, requirements=outcome.check.requirements[-1:])
    )
    console = Console()
    console.configure("remesh", {"backend": "--backend"}, dict.fromkeys(GENERAL, False))
    assert print_outcome(console, outcome) == code
    lines = [line for line in capsys.readouterr().err.splitlines() if "degrees" in line]
    least, angles = flat.minimum_angles().min(), flat.minimum_angles()
    assert len(lines) == (least < 10.0)
    assert (least < 5.0) == (code == 1)
    if code == 1:
        n = f"{(angles < 5.0).sum()} of {flat.n_cells}"
        found = (
            f"warning: angles: {n} below 5 degrees, the least {least:.2g}, the worst at \\(.*\\)"
        )
        assert re.search(f"{found}; smaller sizes there, or --backend tetwild, may help$", lines[0])


@pytest.mark.parametrize(
    ("move", "status", "text"),
    [
        (1.0, "met", None),
        (1.05, "near", "near, which is accepted up to 10 % beyond the limit"),
        (1.2, "missed", "smaller sizes or --strict keep it closer"),
    ],
)
def test_a_requirement_that_is_near_is_said_and_accepted(capsys, move, status, text):
    cube = block(2)
    tolerance = 0.01
    moved = cube.moved(cube.points + np.array([move * tolerance * cube.diagonal, 0.0, 0.0]))
    check = check_mesh(moved, original=cube, size=0.6, tolerance=tolerance)
    found = Outcome("tetrahedra", size_conformity(moved, 0.6), check, tolerance=tolerance)
    console = Console()
    console.configure("remesh", {"strict": "--strict"}, dict.fromkeys(GENERAL, False))
    assert print_outcome(console, found) == (status == "missed")
    lines = [line for line in capsys.readouterr().err.splitlines() if " boundary: " in line]
    if text is None:
        assert lines == []
    else:
        place = r"the worst at \(.*\)"
        length = length_text(move * tolerance * cube.diagonal, cube.diagonal)
        figures = f"within {length}, {0.01 * cube.diagonal:.3g} (0.01) allowed"
        assert re.search(f"warning: boundary: {re.escape(figures)}, {place}; {text}$", lines[0])
    values = found.as_dict()
    assert values["status"] == status
    assert next(d for d in values["requirements"] if d["name"] == "boundary")["status"] == status


def test_the_report_says_which_requested_elements_are_missing():
    def h(x, least):
        away = np.linalg.norm(x - np.clip(x, 0.4, 0.44), axis=1)
        return np.minimum(least + 0.25 * away, 0.2)

    fine, coarse = (
        resolved(SQUARE, partial(h, least=least), g=0.25, factor=1.9, accuracy=0.0).mesh
        for least in (2e-3, 3e-2)
    )
    source = BoxSource([0.4, 0.4], [0.44, 0.44], 2e-3)
    size = size_function(fine, sources=source, hmin=2e-3, hmax=0.2)
    # The nodal sizes know little of the box: there is hardly a node in it.
    coarse = coarse.with_data(point_data={"h": size(coarse.points)})
    outcome = outcome_of_remeshing(coarse, SQUARE, size, 1e-3)
    assert "served" in [requirement.name for requirement in outcome.check.failures]
    values = outcome.as_dict()
    assert values["served"] < 0.5 < values["too_coarse"]
    assert values["worst"]["cause"] == "sources"
    assert values["worst"]["size"] == pytest.approx(2e-3, rel=0.2)
    assert all(0.39 < x < 0.45 for x in values["worst"]["point"])
    assert dict(outcome.rows)["served"].startswith(f"{values['served']:.1%} of the requested")
    assert "for size 0.002 (sources) at (0.4" in str(outcome)
    missing = [text for text in outcome.warnings() if "requested elements are missing" in text]
    assert len(missing) == 1
    assert missing[0].startswith("sources: ")
    right = outcome_of_remeshing(fine, SQUARE, size, 1e-3)
    assert right.as_dict()["served"] > 0.9
    assert right.unserved == ()


def test_what_remesh_has_compared_is_not_compared_again(capsys, box, monkeypatch):
    pytest.importorskip("mmgpy")
    pytest.importorskip("netgen")
    old = repair_mesh(read(box)).mesh
    size = size_function(old, hmax=0.5)
    made = remeshed(old, size, tolerance=2e-3)
    found = made.attempts.check, made.elements
    with_it, without = (
        outcome_of_remeshing(made.mesh, old, size, 2e-3, None, *known).as_dict()
        for known in (found, (None, None))
    )
    assert None not in found
    assert with_it.pop("measure_change") == pytest.approx(without.pop("measure_change"), abs=1e-12)
    assert with_it == without
    monkeypatch.setattr("adaptsize.quality.check_mesh", None)
    compared, compare = [], RequestedElements.of.__func__

    def of(cls, mesh, size, *others):
        compared.append(type(size))
        return compare(cls, mesh, size, *others)

    monkeypatch.setattr(RequestedElements, "of", classmethod(of))
    assert call("remesh", box, "-o", box.with_name("new.vtu"), "--hmax", "0.5") == 0
    assert "boundary  " in capsys.readouterr().out
    assert compared.count(SizeFunction) == 1


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".off"])
def test_a_surface_written_to_a_format_of_triangles_stays_a_surface(capsys, box, suffix):
    pytest.importorskip("mmgpy")
    output = box.with_name(f"new{suffix}")
    assert call("remesh", box, "-o", output, "--hmax", "0.3") == 0
    printed = capsys.readouterr()
    assert "holds triangles: the surface is remeshed" in printed.err
    count = int(printed.out.split("triangles")[0].split()[-1])
    assert read(output).n_cells == count
    assert read(output).measures.sum() == pytest.approx(10.0, rel=1e-6)


@pytest.mark.parametrize("suffix", [".vtu", ".msh", ".mesh", ".vtk"])
def test_check_takes_the_tolerance_with_which_a_mesh_was_made(capsys, tmp_path, suffix):
    pytest.importorskip("mmgpy")
    output = tmp_path / f"new{suffix}"
    words = ["remesh", DATA / "curved.vtu", "-o", output, "--tolerance", "2e-3", "--json"]
    assert call(*words) == 0
    tolerance = json.loads(capsys.readouterr().out)["mesh"]["tolerance"]
    assert tolerance == 2e-3
    check = ["check", output, "--original", DATA / "curved.vtu"]
    assert call(*check) == 0
    printed = capsys.readouterr()
    assert "curved.vtu on 20" in printed.err
    assert f"({tolerance:.3g}) allowed" in printed.out
    assert call(*check, "--tolerance", "1e-4") == 1
    record = read_record(output)
    assert record["tolerance"] == tolerance
    assert record["options"] == {"tolerance": "0.002"}
    assert record["n_cells"] == read(output).n_cells


def test_a_record_of_another_mesh_counts_for_nothing(capsys, tmp_path):
    path = tmp_path / "mesh.vtu"
    write(path, SQUARE)
    assert read_record(path) == {}
    write_record(path, {"tolerance": 0.5, "n_cells": 7, "input": "größe"})
    assert read_record(path)["input"] == "größe"
    assert call("check", path, "--original", path) == 0
    assert "made by" not in capsys.readouterr().err
    for damage in ("[1]", '{"tolerance": 0'):
        (tmp_path / "mesh.vtu.json").write_text(damage)
        assert read_record(path) == {}


def test_an_open_surface_is_reported(capsys, open_box, no_generator):
    assert call("remesh", open_box, "-o", open_box.with_name("o.vtu"), "--json") == 1
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert result["open_boundary"] == {
        "n_edges": 4,
        "n_loops": 1,
        "n_loose": 0,
        "length": 6.0,
        "place": [1.0, 0.5, 1.0],
        "area": 2.0,
    }
    (text,) = (text for text in result["warnings"] if "open" in text)
    assert "4 open edges in 1 loop with an area of 2, 6 long around (1, 0.5, 1)" in text
    assert "; --close-holes closes the holes, --target triangles keeps a surface" in text
    assert printed.err.count("the surface is open") == 1


def test_overlapping_bodies_are_named_before_the_work(capsys, tmp_path, no_generator):
    points = np.concatenate([CORNERS, CORNERS + np.array([0.5, 0.3, 0.4])])
    write(tmp_path / "two.stl", SimplexMesh(points, TWO))
    words = ["remesh", tmp_path / "two.stl", "-o", tmp_path / "o.vtu"]
    assert call(*words, "--json") == 1
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert result["overlapping_bodies"]["pairs"] == [[1, 2]]
    named = "bodies 1 and 2 overlap: 12 triangles cross others, by up to "
    assert len([text for text in result["warnings"] if named in text]) == 1
    assert "near_bodies" not in result
    assert call(*words, "--strict") == 1
    assert "join the bodies before meshing" in capsys.readouterr().err
    assert call("size", tmp_path / "two.stl", "-o", tmp_path / "h.vtu") == 0
    assert named in capsys.readouterr().err


def test_bodies_closer_than_the_tolerance_are_reported(capsys, tmp_path, no_generator):
    points = np.concatenate([CORNERS, CORNERS + np.array([0.0, 0.0, 1.001])])
    write(tmp_path / "two.stl", SimplexMesh(points, TWO))
    words = ["remesh", tmp_path / "two.stl", "-o", tmp_path / "o.vtu"]
    call(*words)
    err = capsys.readouterr().err
    assert "1 pair of bodies is only 0.001 apart at (0, 0, 1), less than the tolerance" in err
    assert call(*words, "--strict") == 1
    assert "lower the tolerance" in capsys.readouterr().err
    call(*words, "--tolerance", "1e-4")
    assert "of bodies" not in capsys.readouterr().err


def test_close_fills_the_holes_first(capsys, open_box, no_generator):
    call("remesh", open_box, "-o", open_box.with_name("o.vtu"), "--close-holes")
    err = capsys.readouterr().err
    assert "surface closed by 2 triangles; it had 4 open edges in 1 loop" in err
    assert "warning: the surface is open" not in err
    assert no_generator[0].is_closed


def test_a_tolerance_that_looks_like_a_length_is_a_warning(capsys, box, no_generator):
    words = ["remesh", box, "-o", box.with_name("o.vtu"), "--tolerance"]
    call(*words, "0.5")
    text = "adaptsize: warning: --tolerance = 0.5 is a share of the diagonal, not a length"
    moves = f"the boundary may move by {0.5 * read(box).diagonal:.3g}"
    assert f"{text}: {moves}" in capsys.readouterr().err
    call(*words, "0.05")
    assert "not a length" not in capsys.readouterr().err


def test_strict_refuses_an_open_surface_before_the_sizes(refused, open_box):
    err = refused("remesh", open_box, "-o", open_box.with_name("o.vtu"), "--strict", code=1)
    assert err.startswith("adaptsize: error: the surface is open: 4 open edges in 1 loop")


def test_faces_of_a_surface_get_the_sizes_that_name_them(box, no_generator):
    call("remesh", box, "-o", box.with_name("o.vtu"), "--size-of", "face 2=0.3")
    assert np.unique(no_generator[0].cell_tags).tolist() == [1, 2, 3, 4, 5, 6]


def test_a_cap_below_what_the_boundary_needs_is_refused_in_one_line(
    tmp_path, refused, no_generator
):
    ball, output = tmp_path / "ball.stl", tmp_path / "new.vtu"
    write(ball, random_sphere(400, 616))
    text = refused("remesh", ball, "-o", output, "--max-elements", "2000", code=1)
    message = (
        r"within the tolerance of [\d.]+ \(0\.001 of the diameter\) the boundary needs about \d+ "
        r"elements; 2000 are not enough: --tolerance 0\.00\d+\n"
    )
    assert re.search(message, text)
    assert no_generator == []
    assert not output.exists()


def test_details_are_removed_and_listed(capsys, tmp_path, no_generator):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("manifold3d")
    bore = trimesh.creation.cylinder(0.05, 4.0, sections=12).apply_translation((1.0, 0.5, 0.0))
    block = trimesh.creation.box((2.0, 1.0, 1.0)).apply_translation((1.0, 0.5, 0.5))
    part = trimesh.boolean.difference([block, bore])
    path = tmp_path / "part.stl"
    write(path, SimplexMesh(part.vertices, part.faces))
    words = ["remesh", path, "-o", path.with_name("new.vtu"), "--hmax", "0.5"]
    call(*words, "--least-detail", "0.2", "--json")
    printed = capsys.readouterr()
    assert "removed 1 cavities" in printed.err
    (detail,) = json.loads(printed.out)["removed_details"]
    assert detail["kind"] == "cavity"
    assert detail["place"] == pytest.approx([1.0, 0.5, 0.5], abs=1e-6)
    assert detail["volume"] == pytest.approx(2.0 - part.volume, rel=1e-6)
    assert no_generator[0].measures.sum() == pytest.approx(10.0, rel=1e-6)  # a plain box
    # The mesh is checked against the surface that it was made from.
    call("check", path.with_name("new.vtu"), "--original", path, "--json")
    printed = capsys.readouterr()
    assert "removed 1 cavities" in printed.err
    requirements = {
        requirement["name"]: requirement["is_met"]
        for requirement in json.loads(printed.out)["requirements"]
    }
    assert requirements["boundary"]
